//! The recorded rays of a scene: all classes, the renderer's own rays, and the same every time.

use crate::support::backends::{self, on_both};
use lightpath::film::{Film, Window};
use lightpath::lab::rays::{PacketToTrace, RayClass, Recording, record};
use lightpath::monitor::Monitor;
use lightpath::ray::LANES;
use lightpath::render::render;
use lightpath::simd::Isa;
use lightpath::world::{LoadOptions, World};
use lightpath::{scene, scene::Backend};

fn world(width: u32, height: u32, spp: u32, lights: &str) -> World {
    let text = format!(
        r#"{{"nbounces": 1, "spp": {spp},
        "camera": {{"type": "pinhole", "width": {width}, "height": {height}, "fov": 50,
            "position": [0, 1, 4], "target": [0, 0.5, 0], "up": [0, 1, 0]}},
        "scene": {{"lightsources": [{lights}], "shapes": [
            {{"type": "sphere", "center": [0, 0.6, 0], "radius": 0.6, "material": {{"kd": 0.5, "kr": 0.5}}}},
            {{"type": "plane", "v0": [-9, 0, -9], "v1": [9, 0, -9], "v2": [9, 0, 9], "v3": [-9, 0, 9],
                "material": {{"kd": 0.8}}}}]}}}}"#
    );
    loaded(&text)
}

fn loaded(text: &str) -> World {
    let folder = std::path::Path::new(".");
    let source = scene::Source::Text { name: "test", text: text.as_bytes(), folder };
    let scene = scene::load(source, &[]).unwrap().scene;
    World::load(&scene, LoadOptions::default(), &Monitor::default()).unwrap().0
}

const POINT: &str = r#"{"type": "pointlight", "position": [2, 4, 3], "id": [1, 1, 1]}"#;
const AREA: &str = r#"{"type": "arealight", "v0": [-2, 4, 0], "v1": [-1, 4, 0], "v2": [-2, 4, 1],
    "id": [1, 1, 1], "samples": 4}"#;

fn recorded(backend: Backend, world: &World, packets: usize, seed: i64) -> Recording {
    let accelerator = backends::build(&world.geometry, backend);
    record(world, &*accelerator, packets, seed, &Monitor::default()).unwrap()
}

fn bits(packets: &[PacketToTrace]) -> Vec<[u32; 8]> {
    let lanes = packets.iter().flat_map(|p| (0..LANES).map(move |i| (p, i)));
    lanes
        .filter(|(p, i)| p.active.0[*i] != 0)
        .map(|(p, i)| {
            let ([a, b, c], [x, y, z]) = (p.rays.org.map(|o| o[i]), p.rays.dir.map(|d| d[i]));
            let [a, b, c, x, y, z, t] = [a, b, c, x, y, z, p.rays.tfar[i]].map(f32::to_bits);
            [a, b, c, x, y, z, t, p.rays.leaving[i]]
        })
        .collect()
}

on_both! {
    fn a_scene_with_everything_has_rays_of_every_class_and_all_are_possible(backend: Backend) {
        let world = world(100, 70, 1, &format!("{POINT}, {AREA}"));
        let rays = recorded(backend, &world, usize::MAX >> 8, 1);
        for class in RayClass::ALL {
            assert!(rays.count(class) > 0, "{}", class.name());
            for packet in rays.packets(class) {
                assert_eq!(packet.rays.possible(&packet.active), packet.active, "{}", class.name());
                assert!(packet.active.any());
            }
        }
        assert_eq!(rays.count(RayClass::Primary), 100 * 70);
    }
}

on_both! {
    fn the_whole_frame_is_what_the_renderer_traces(backend: Backend) {
        for (lights, of) in [(POINT, RayClass::ShadowPoint), (AREA, RayClass::ShadowArea)] {
            for spp in [1, 5] {
                let world = World { nbounces: 0, ..world(50, 40, spp, lights) };
                let rays = recorded(backend, &world, usize::MAX >> 8, 1);
                let mut film = Film::new([50, 40], Window::full(50, 40)).unwrap();
                let accelerator = backends::build(&world.geometry, backend);
                let monitor = Monitor::default();
                let counts = render(&world, &*accelerator, Isa::detect(), &mut film, &monitor).unwrap();
                assert_eq!(rays.count(RayClass::Primary), counts.primary);
                assert_eq!(rays.count(of), counts.shadow);
                let shadow = [RayClass::ShadowPoint, RayClass::ShadowArea].map(|c| rays.count(c));
                assert_eq!(shadow.iter().sum::<u64>(), counts.shadow);
                assert_eq!(rays.count(RayClass::Mirror), 0);
            }
        }
    }
}

// Near the corner of wall and ceiling, shadow rays to a light in the ceiling run along it, and are
// traced one by one for their closest hits.
on_both! {
    fn shadow_rays_in_a_corner_are_not_mirrored_rays(backend: Backend) {
        let world = loaded(
            r#"{"nbounces": 0, "camera": {"type": "pinhole", "width": 8, "height": 8, "fov": 1e-4,
                "position": [0, 1, 0], "target": [-1, 2, 0], "up": [0, 1, 0]},
            "scene": {"lightsources": [{"type": "arealight", "v0": [-0.3, 2, -0.3],
                "v1": [0.3, 2, -0.3], "v2": [-0.3, 2, 0.3], "id": [1, 1, 1], "samples": 4}],
            "shapes": [{"type": "plane", "v0": [-1, 2, -1], "v1": [1, 2, -1], "v2": [1, 2, 1],
                "v3": [-1, 2, 1], "material": {"kd": 1}},
            {"type": "plane", "v0": [-1, 0, -1], "v1": [-1, 0, 1], "v2": [-1, 2, 1],
                "v3": [-1, 2, -1], "material": {"kd": 1}}]}}"#,
        );
        let rays = recorded(backend, &world, usize::MAX >> 8, 1);
        assert_eq!(rays.count(RayClass::Mirror), 0);
        assert!(rays.count(RayClass::ShadowArea) > 0);
    }
}

on_both! {
    fn a_limited_recording_is_spread_over_the_frame(backend: Backend) {
        let world = world(320, 256, 1, &format!("{POINT}, {AREA}"));
        for packets in [1, 7, 80, 100, 1000] {
            let rays = recorded(backend, &world, packets, 1);
            for class in RayClass::ALL {
                assert!(rays.packets(class).len() <= packets, "{} {packets}", class.name());
            }
            let primary = rays.packets(RayClass::Primary);
            assert!(2 * primary.len() > packets, "{} of {packets}", primary.len());
            if packets >= 80 {
                // Directions reach into all four corners of the picture.
                for (right, up) in [(true, true), (true, false), (false, true), (false, false)] {
                    let corner = |p: &PacketToTrace| {
                        let (x, y) = (p.rays.dir[0][0], p.rays.dir[1][0]);
                        (x > 0.25) == right && x.abs() > 0.25 && (y > 0.0) == up
                    };
                    assert!(primary.iter().any(corner), "{packets} {right} {up}");
                }
            }
        }
    }
}

on_both! {
    fn only_diffuse_rays_depend_on_the_seed_and_the_same_seed_gives_the_same(backend: Backend) {
        let world = world(64, 64, 1, &format!("{POINT}, {AREA}"));
        let [a, b, c] = [1, 1, 2].map(|seed| recorded(backend, &world, 64, seed));
        for class in RayClass::ALL {
            assert_eq!(bits(a.packets(class)), bits(b.packets(class)), "{}", class.name());
            let same = bits(a.packets(class)) == bits(c.packets(class));
            assert_eq!(same, class != RayClass::Diffuse);
        }
    }
}

on_both! {
    fn diffuse_rays_are_cosine_distributed(backend: Backend) {
        let world = world(128, 128, 1, "");
        let rays = recorded(backend, &world, usize::MAX >> 8, 3);
        // Rays that leave the ground, whose normal is y: their mean cosine is 2/3.
        let (mut sum, mut n) = (0.0, 0.0f64);
        for packet in rays.packets(RayClass::Diffuse) {
            for i in (0..LANES).filter(|&i| packet.active.0[i] != 0 && packet.rays.leaving[i] == 0) {
                assert!(packet.rays.dir[1][i] >= 0.0);
                sum += f64::from(packet.rays.dir[1][i]);
                n += 1.0;
            }
        }
        // The cosine's variance is 1/18: five standard deviations of independent samples.
        assert!((sum / n - 2.0 / 3.0).abs() < 5.0 * (1.0 / 18.0 / n).sqrt(), "{} of {n}", sum / n);
        assert!(n > 1000.0);
    }
}
