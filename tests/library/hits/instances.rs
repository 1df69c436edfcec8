//! Instances give the hits and the pictures of copies of their mesh.

use crate::support::backends;
use crate::support::random::Random;
use glam::{DMat3, DVec3};
use lightpath::accel::Accelerator;
use lightpath::film::{Film, Window};
use lightpath::geometry::{Geometry, Nearby, doubles};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, Mask, NONE, RayPacket, Rays};
use lightpath::render;
use lightpath::scene::{self, Backend, Source};
use lightpath::simd::Isa;
use lightpath::world::{LoadOptions, World};
use serde_json::{Value, json};

/// Rows of the matrix `linear p + offset`.
fn rows(linear: DMat3, offset: DVec3) -> Value {
    let row = |k: usize| [linear.row(k).to_array().as_slice(), &[offset[k]]].concat();
    json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}

/// Rotated, scaled, sheared, mirrored and overlapping instances. One lies far from the others.
fn transforms() -> Vec<Value> {
    let turn = |x, y, z| DMat3::from_euler(glam::EulerRot::XYZ, x, y, z);
    let scale = |x, y, z| DMat3::from_diagonal(DVec3::new(x, y, z));
    let mut shear = DMat3::IDENTITY;
    shear.y_axis.x = 0.7;
    vec![
        rows(DMat3::IDENTITY, DVec3::ZERO),
        rows(turn(0.3, 1.1, -0.4), DVec3::new(1.3, 0.1, -0.5)),
        rows(turn(2.0, -0.7, 0.2) * scale(1.4, 0.5, 0.8), DVec3::new(-1.2, 0.3, 0.2)),
        rows(scale(-0.7, 0.7, 0.7), DVec3::new(0.2, 1.2, 0.1)),
        rows(shear * turn(0.1, 0.2, 0.3), DVec3::new(0.4, -1.1, 0.3)),
        rows(turn(0.5, 0.5, 0.5) * 0.02, DVec3::new(0.9, 0.9, 0.9)),
        rows(turn(1.5, 0.4, 0.9), DVec3::new(0.3, 0.2, 0.1)),
        rows(turn(0.5, 0.4, 0.9) * 40.0, DVec3::new(300.0, -200.0, -700.0)),
    ]
}

/// A scene with instances of the teapot. `copies` loads them as copies.
fn world(smooth: bool, copies: bool) -> World {
    let scene = json!({
        "nbounces": 2,
        "camera": { "type": "pinhole", "width": 96, "height": 80, "fov": 50,
                    "position": [1, 1.5, 4.5], "target": [0.1, 0, 0], "up": [0, 1, 0] },
        "scene": {
            "lightsources": [
                { "type": "pointlight", "position": [5, 8, 9], "id": [2, 2, 2] },
                { "type": "arealight", "v0": [-3, 5, 2], "v1": [-2, 5, 2], "v2": [-3, 5, 3],
                  "id": [1, 1, 1], "samples": 2 }
            ],
            "attenuation": "none",
            "shapes": [
                { "type": "trimesh", "name": "pot", "path": "assets/teapot.ply", "fit": 1.2,
                  "rotate": [-90, 0, 0], "smooth": smooth, "material": { "ks": 0.3, "kr": 0.2 },
                  "instances": transforms() },
                { "type": "plane", "material": { "kr": 0.3 }, "v0": [-9, -2, -9], "v1": [-9, -2, 9],
                  "v2": [9, -2, 9], "v3": [9, -2, -9] },
                { "type": "sphere", "center": [-1, 1.2, 1], "radius": 0.4, "material": { "kr": 0.5 } }
            ]
        },
        "output": { "layers": ["N", "P", "primid", "objectid"] }
    });
    let text = scene.to_string();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder };
    let scene = scene::load(source, &[]).unwrap().scene;
    let options = LoadOptions { copy_instances: copies, ..LoadOptions::default() };
    World::load(&scene, options, &Monitor::default()).unwrap().0
}

/// A packet of rays near the instances: from one origin, from several, and from one origin exactly
/// to a corner or the middle of an edge of any triangle.
fn packet(random: &mut Random, geometry: &Geometry) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    let mut near = |middle: DVec3, size: f64| {
        middle + DVec3::from([(); 3].map(|()| random.within(-size, size)))
    };
    let middle = -geometry.origin;
    let (eye, goal) = (near(middle, 4.0), near(middle, 1.5));
    let mut pick = Random(goal.x.to_bits());
    for i in 0..LANES {
        let (from, to) = match i % 4 {
            0 => (eye, near(goal, 0.3)),
            1 => (near(middle, 3.0), near(middle, 1.5)),
            2 => (eye, near(middle, 2.0)),
            _ => {
                let (geom, prim) = geometry.place(pick.below(geometry.count() as usize) as u32);
                match geometry.triangles(geom, prim).next() {
                    Some(([a, _, _], _)) if i < 8 => (eye, a),
                    Some(([a, b, _], _)) => (eye, a.lerp(b, 0.5)),
                    None => (eye, goal),
                }
            }
        };
        packet.rays.set(i, from.as_vec3(), (to - from).as_vec3());
    }
    packet
}

/// What a ray hits, independent of the order of geometries: t, its shape and the number of the
/// primitive.
fn hits(world: &World, packet: &RayPacket) -> [Option<(u32, u32, u32)>; LANES] {
    std::array::from_fn(|i| {
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        (geom != NONE).then(|| {
            let number = world.geometry.number(world.geometry.primitive(geom, prim));
            (packet.rays.tfar[i].to_bits(), world.shapes.shape(geom, prim), number)
        })
    })
}

#[test]
fn hits_and_shadows_are_those_of_copies() {
    let [shared, copies] = [false, true].map(|copies| world(true, copies));
    assert_eq!(shared.geometry.instances.len(), 8);
    assert_eq!((copies.geometry.instances.len(), copies.geometry.copies), (0, 8));
    assert_eq!(shared.geometry.count(), copies.geometry.count());
    for &isa in Isa::compiled() {
        let [one, other] =
            [&shared, &copies].map(|world| backends::build(&world.geometry, Backend::Bvh(isa)));
        let mut random = Random(3);
        let (mut found, mut occluded) = (0, 0);
        for _ in 0..4000 {
            let first = packet(&mut random, &copies.geometry);
            for coherence in [Coherence::Coherent, Coherence::Unordered] {
                let trace = |world: &World, accelerator: &dyn Accelerator| {
                    let mut packet = first.clone();
                    accelerator.closest(&Mask::ALL, &mut packet, coherence);
                    hits(world, &packet)
                };
                let (a, b) = (trace(&shared, &*one), trace(&copies, &*other));
                assert_eq!(a, b, "{isa} {coherence:?} {:?}", first.rays);
                found += a.iter().flatten().count();
                let shadow = |accelerator: &dyn Accelerator| -> Rays {
                    let mut rays = first.rays.clone();
                    rays.tfar = [0.7; LANES];
                    accelerator.occluded(&Mask::ALL, &mut rays, coherence);
                    rays
                };
                let (a, b) = (shadow(&*one), shadow(&*other));
                assert_eq!(a.tfar, b.tfar, "{isa} {coherence:?} {:?}", first.rays);
                occluded += a.tfar.iter().filter(|&&t| t < 0.0).count();
            }
        }
        assert!(found > 40_000 && occluded > 20_000, "{found} {occluded}");
    }
}

#[test]
fn the_oracle_agrees() {
    let world = world(false, false);
    let bvh = backends::build(&world.geometry, Backend::Bvh(Isa::detect()));
    let brute = backends::build(&world.geometry, Backend::Brute);
    let mut random = Random(9);
    let mut found = 0;
    for _ in 0..100 {
        let first = packet(&mut random, &world.geometry);
        let trace = |accelerator: &dyn Accelerator| {
            let mut packet = first.clone();
            accelerator.closest(&Mask::ALL, &mut packet, Coherence::Coherent);
            hits(&world, &packet)
        };
        let (a, b) = (trace(&*bvh), trace(&*brute));
        // The last of four rays is aimed at an edge, which may be the border of the mesh.
        for i in (0..LANES).filter(|i| i % 4 != 3) {
            let hit = |hit: Option<(u32, u32, u32)>| hit.map(|(_, shape, number)| (shape, number));
            assert_eq!(hit(a[i]), hit(b[i]), "lane {i}: {:?}", first.rays);
            if let (Some((a, ..)), Some((b, ..))) = (a[i], b[i]) {
                assert!(a.abs_diff(b) <= 2, "lane {i}: t {a:x} {b:x}: {:?}", first.rays);
                found += 1;
            }
        }
    }
    assert!(found > 500, "{found}");
}

#[test]
fn pictures_are_those_of_copies() {
    for smooth in [false, true] {
        let films = [false, true].map(|copies| {
            let world = world(smooth, copies);
            let accelerator = backends::build(&world.geometry, Backend::Bvh(Isa::detect()));
            let mut film = Film::new(world.frame, Window::full(96, 80)).unwrap();
            render::render(&world, &*accelerator, Isa::detect(), &mut film, &Monitor::default())
                .unwrap();
            film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect::<Vec<_>>()
        });
        assert!(films[0] == films[1], "smooth {smooth}");
        assert!(films[0].iter().filter(|pixel| f32::from_bits(pixel[0]) > 0.05).count() > 2000);
    }
}

/// Around vertices: the triangles that share the vertex are found.
#[test]
fn near_finds_the_triangles_of_instances() {
    let world = world(false, false);
    let geometry = &world.geometry;
    let bvh = backends::build(geometry, Backend::Bvh(Isa::detect()));
    for index in 0..geometry.instances.len() {
        let (mesh, _) = geometry.instance(index);
        for (prim, triangle) in (0u32..).zip(mesh.triangles()).step_by(97) {
            let corners = geometry.instance_corners(index, prim).map(doubles);
            let near = Nearby::new(corners[0], corners);
            let mut found = Vec::new();
            bvh.near(geometry, &near, &mut |primitive| found.push(primitive));
            let around = (0u32..).zip(mesh.triangles());
            let around = around.filter(|(_, other)| other.contains(&triangle[0]));
            for (other, _) in around {
                let other = geometry.primitive(geometry.instance_id(index), other);
                assert!(found.contains(&other), "instance {index}, triangle {prim}");
            }
            assert!((found.len() as u64) < geometry.count() / 20);
        }
    }
}
