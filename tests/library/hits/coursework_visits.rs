//! Numbers of visits of the coursework's BVH for the camera rays of the report's two meshes. They
//! are the baseline of every comparison, so this backend must neither improve nor degrade.

use std::path::Path;

use lightpath::{
    accel::{BuildOptions, Visits, coursework::Coursework, lane::LaneRay},
    monitor::Monitor,
    ray::NONE,
    scene::{self, Source},
    world::{LoadOptions, World},
};

/// Counts visits of one camera ray through the middle of each pixel of a 90 x 60 frame: with the
/// report's trees, and without trees inside the meshes.
fn visits(name: &str) -> [Visits; 2] {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let sets = ["/camera/width=90", "/camera/height=60"].map(String::from);
    let monitor = Monitor::default();
    let mut all = [Visits::default(); 2];
    let mut hits = [0; 2];
    for (case, loop_only) in [false, true].into_iter().enumerate() {
        let loaded = scene::load(Source::File(&path), &sets).expect("the scene");
        let (mut world, _) =
            World::load(&loaded.scene, LoadOptions::default(), &monitor).expect("its files");
        let geometry = std::sync::Arc::get_mut(&mut world.geometry).expect("one owner");
        geometry.meshes.iter_mut().for_each(|mesh| mesh.loop_only = loop_only);
        let options = BuildOptions { threads: 1, max_bytes: None };
        let tree = Coursework::build(&world.geometry, &options, &monitor).expect("a tree");
        for (x, y) in (0..60).flat_map(|y| (0..90).map(move |x| (x as f32 + 0.5, y as f32 + 0.5))) {
            let (origin, direction) = world.camera.pinhole_ray(x, y);
            let ray = LaneRay {
                origin: origin.as_dvec3(),
                direction: direction.as_dvec3(),
                tnear: 0.0,
                tfar: f64::INFINITY,
                leaving: NONE,
            };
            hits[case] += u64::from(tree.closest_hit(&ray, &mut all[case]).is_some());
        }
    }
    assert!(hits.iter().all(|&h| h == hits[0]), "{hits:?}");
    all
}

#[test]
fn a_mesh_with_bvh_false_has_no_tree() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/fig12-octahedron.json");
    for bvh in [true, false] {
        let set = format!("/scene/shapes/0/bvh={bvh}");
        let loaded = scene::load(Source::File(&path), &[set]).expect("the scene");
        let world = World::load(&loaded.scene, LoadOptions::default(), &Monitor::default());
        let geometry = world.expect("its files").0.geometry;
        let without = geometry.meshes.iter().filter(|mesh| mesh.loop_only);
        // The other mesh is that of the scene's single triangles.
        let sizes: Vec<usize> = without.map(|mesh| mesh.triangles().len()).collect();
        assert_eq!(sizes, if bvh { &[][..] } else { &[8] });
    }
}

fn visit(nodes: u64, primitives: u64) -> Visits {
    Visits { nodes, primitives }
}

#[test]
fn the_octahedron() {
    // The octahedron is symmetric. Which boxes a ray through its middle planes hits depends on the
    // last bits of the coordinates, and so on the scene's origin.
    let found = visits("fig12-octahedron.json");
    assert_eq!(found, [visit(39_880, 14_712), visit(10_800, 64_800)]);
}

#[test]
fn the_teapot() {
    let found = visits("fig13-teapot.json");
    assert_eq!(found, [visit(82_872, 16_925), visit(21_600, 7_346_480)]);
}
