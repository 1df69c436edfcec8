//! A block whose frustum reaches no leaf is filled without tracing rays. Squares of pixels from
//! which nothing occludes a light trace no shadow rays. Both get the same bits as with rays.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::support::program::{PYRAMID, Scratch};
use lightpath::{
    accel::{Accelerator, BuildInfo, BuildOptions, Cone, Shaft, bvh::Bvh},
    film::{Film, Window},
    monitor::Monitor,
    ray::{Coherence, Mask, RayPacket, Rays},
    render,
    scene::{self, Source},
    simd::Isa,
    world::{LoadOptions, World},
};

/// Objects with much sky around them, in different colours.
const SCENE: &str = r#"{
  "seed": 2,
  "camera": { "type": "pinhole", "width": 150, "height": 110, "fov": 60,
              "position": [0.5, 2, 7], "target": [0.2, 1, 0], "up": [0.1, 1, 0] },
  "scene": {
    "backgroundcolor": [0.1, 0.2, 0.7], "ambient": [0.1, 0.1, 0.1],
    "lightsources": [{ "type": "arealight", "v0": [-1, 6, 3], "v1": [1, 6, 3], "v2": [-1, 6, 5],
                       "id": [1, 1, 1], "samples": 1 }],
    "shapes": [
      { "type": "plane", "v0": [-2, 0, 2], "v1": [2, 0, 2], "v2": [2, 0, -2], "v3": [-2, 0, -2],
        "material": { "kd": 0.7, "ka": 1 } },
      { "type": "plane", "v0": [-3, 3, 0], "v1": [3, 3, 0], "v2": [3, 3.004, 0], "v3": [-3, 3.004, 0],
        "material": { "kd": 1, "ka": 1 } },
      { "type": "sphere", "center": [1.5, 1, 0], "radius": 0.5,
        "material": { "kd": 0.4, "kr": 0.5, "ka": 1 } },
      { "type": "trimesh", "path": "p.ply", "size": 1.5, "center": [-1, 1, 0], "material": { "ka": 1 } }]
  }
}"#;

/// A tree that counts how often it reports an empty cone, or never reports an empty cone or shaft.
struct Telling<'a> {
    tree: &'a Bvh<'a>,
    tells: bool,
    told: AtomicU64,
    traced: AtomicU64,
    shadows: AtomicU64,
}

impl Accelerator for Telling<'_> {
    fn info(&self) -> BuildInfo {
        self.tree.info()
    }
    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.traced.fetch_add(u64::from(active.count()), Relaxed);
        self.tree.closest(active, packet, coherence);
    }
    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.shadows.fetch_add(u64::from(active.count()), Relaxed);
        self.tree.occluded(active, rays, coherence);
    }
    fn cone(&self, active: &Mask, rays: &Rays) -> Option<Cone> {
        let told = self.tells.then(|| self.tree.cone(active, rays)).flatten();
        self.told.fetch_add(u64::from(told == Some(Cone::Empty)), Relaxed);
        told
    }
    fn is_shaft_empty(&self, shaft: &Shaft) -> Option<bool> {
        self.tells.then(|| self.tree.is_shaft_empty(shaft)).flatten()
    }
}

fn world(spp: u32, transparent: bool) -> World {
    let scratch = Scratch::new();
    scratch.write("p.ply", PYRAMID);
    let mut scene: serde_json::Value = serde_json::from_str(SCENE).unwrap();
    scene["spp"] = spp.into();
    scene["output"]["transparent"] = transparent.into();
    let (text, folder) = (scene.to_string(), scratch.path(""));
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: &folder };
    let scene = scene::load(source, &[]).unwrap().scene;
    World::load(&scene, LoadOptions::default(), &Monitor::default()).unwrap().0
}

#[test]
fn pictures_are_the_same_bit_for_bit() {
    let isa = Isa::detect();
    let options = BuildOptions { threads: 1, max_bytes: None };
    let monitor = Monitor::default();
    for spp in [1, 3, 4, 16, 50, 64, 300] {
        for (transparent, overscan) in [(false, 0), (true, 37)] {
            let world = world(spp, transparent).with_overscan(overscan);
            let tree = Bvh::build(&world.geometry, isa, &options, &monitor).unwrap();
            let [width, height] = world.frame;
            let crop = Window { x0: 21, y0: 5, x1: 90, y1: 78 };
            // Most samples are slow, and the whole frame has no further kind of square.
            let windows = [crop, Window::full(width, height)];
            for window in windows.into_iter().take(if spp == 300 { 1 } else { 2 }) {
                let render = |tells: bool| {
                    let (told, traced, shadows) = Default::default();
                    let telling = Telling { tree: &tree, tells, told, traced, shadows };
                    let mut film = Film::new(world.frame, window).unwrap();
                    let counts =
                        render::render(&world, &telling, isa, &mut film, &monitor).unwrap();
                    let bits: Vec<_> = film.pixels.iter().map(|p| p.map(f32::to_bits)).collect();
                    let traced = [telling.traced, telling.shadows].map(AtomicU64::into_inner);
                    (bits, counts, telling.told.into_inner(), traced)
                };
                let (bits, counts, told, [traced, shadows]) = render(true);
                let (expected, one_by_one, _, [all, all_shadows]) = render(false);
                let what = format!("{spp} spp, {transparent}, {window:?}");
                assert!(bits == expected, "{what}");
                assert_eq!(counts, one_by_one, "{what}");
                // In the crop, no square has 1024 rays with few samples each.
                let few = window == crop && spp < 16;
                assert!(few || (told > 0 && traced < all), "{what}: {told}, {traced} of {all}");
                // The crop hardly shows the plane. Part of the plane is in shadow.
                let some = 0 < shadows && shadows < all_shadows;
                assert!(window == crop || some, "{what}: {shadows} of {all_shadows}");
            }
        }
    }
}

#[test]
fn layers_parts_and_passes_do_not_depend_on_empty_cones() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch.write("p.ply", PYRAMID);
    for (name, flags) in [
        ("layers", &["--spp", "20", "--aov", "all"][..]),
        ("part", &["--spp", "40", "--samples", "13..29"]),
        ("overscan", &["--spp", "4", "--overscan", "33", "--aov", "Z,samples"]),
        ("noise", &["--noise", "0.1", "--spp", "16", "--aov", "samples"]),
        ("picture", &["--noise", "0.1", "--noise-of", "picture", "--spp", "16"]),
    ] {
        let rays = ["bvh", "brute"].map(|backend| {
            let fixed = ["render", "s.json", "-o", backend, "--backend", backend, "--float"];
            let done = scratch.run(&[&fixed[..], &["--quiet", "--json"], flags].concat());
            assert_eq!(done.code(), 0, "{name}: {}", done.stderr());
            let stats: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
            stats["rays"].to_string()
        });
        assert_eq!(rays[0], rays[1], "{name}");
        assert!(scratch.channels("bvh.exr") == scratch.channels("brute.exr"), "{name}");
    }
}
