//! A backend with wrong answers is detected, and only that one.

use crate::support::backends::{self, on_both};
use lightpath::accel::{Accelerator, BuildInfo};
use lightpath::lab::agreement::compare;
use lightpath::lab::rays::{RayClass, Recording, record};
use lightpath::lab::replay::{Mode, Replay};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, Mask, NONE, RayPacket, Rays};
use lightpath::scene;
use lightpath::world::{LoadOptions, World};

fn world() -> World {
    let text = r#"{"nbounces": 1,
        "camera": {"type": "pinhole", "width": 96, "height": 96, "fov": 50,
            "position": [0.3, 1.2, 4], "target": [0, 0.5, 0], "up": [0, 1, 0]},
        "scene": {"lightsources": [
            {"type": "pointlight", "position": [2, 4, 3], "id": [1, 1, 1]},
            {"type": "arealight", "v0": [-2, 4, 0], "v1": [-1, 4, 0], "v2": [-2, 4, 1], "id": [1, 1, 1]}],
        "shapes": [
            {"type": "trimesh", "path": "assets/spot.ply", "fit": 1.5, "center": [0.5, 0.8, 0],
                "material": {"kd": 1, "kr": 0.5}},
            {"type": "sphere", "center": [-1, 0.6, 0], "radius": 0.6, "material": {"kd": 0.5, "kr": 0.5}},
            {"type": "plane", "v0": [-9, 0, -9], "v1": [9, 0, -9], "v2": [9, 0, 9], "v3": [-9, 0, 9],
                "material": {"kd": 0.8}}]}}"#;
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let source = scene::Source::Text { name: "test", text: text.as_bytes(), folder };
    let scene = scene::load(source, &[]).unwrap().scene;
    World::load(&scene, LoadOptions::default(), &Monitor::default()).unwrap().0
}

/// A defect of a backend.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    /// Every hit of every lane 3 is lost.
    Leaks,
    /// Every miss of every lane 3 becomes a hit of the first primitive.
    Invents,
    /// Every t of every lane 3 is 1 % too large.
    Far,
}

struct Faulty<'a>(&'a dyn Accelerator, Fault);

impl Accelerator for Faulty<'_> {
    fn info(&self) -> BuildInfo {
        self.0.info()
    }
    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        let before = packet.rays.tfar[3];
        self.0.closest(active, packet, coherence);
        let hit = packet.hits.geom[3] != NONE;
        match self.1 {
            Fault::Leaks => (packet.hits.geom[3], packet.rays.tfar[3]) = (NONE, before),
            Fault::Invents if !hit => {
                (packet.hits.geom[3], packet.hits.prim[3]) = (0, 0);
                packet.rays.tfar[3] = 1.0;
            }
            Fault::Far if hit => packet.rays.tfar[3] *= 1.01,
            _ => {}
        }
    }
    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        let before = rays.tfar[3];
        self.0.occluded(active, rays, coherence);
        match self.1 {
            Fault::Leaks => rays.tfar[3] = before,
            Fault::Invents if active.0[3] != 0 => rays.tfar[3] = f32::NEG_INFINITY,
            _ => {}
        }
    }
}

/// Returns how many rays of lane 3 hit and how many miss.
fn in_lane_3(
    recording: &Recording,
    class: RayClass,
    mode: Mode,
    right: &dyn Accelerator,
) -> [u64; 2] {
    let replay = Replay { class, mode, packets: recording.packets(class) };
    let answers = replay.answers(right);
    let rays = replay.packets.iter().zip(answers).filter(|(p, _)| p.active.0[3] != 0);
    rays.fold([0, 0], |[hit, miss], (_, a)| match a[3].is_hit() {
        true => [hit + 1, miss],
        false => [hit, miss + 1],
    })
}

on_both! {
    fn only_wrong_answers_are_counted(backend: Backend) {
        let world = world();
        let right = backends::build(&world.geometry, backend);
        let recording = record(&world, &*right, usize::MAX >> 8, 1, &Monitor::default()).unwrap();
        for class in RayClass::ALL {
            for mode in Mode::ALL {
                let replay = Replay { class, mode, packets: recording.packets(class) };
                let rays = recording.count(class);
                let [hit, miss] = in_lane_3(&recording, class, mode, &*right);
                assert!(hit > 0 && miss > 0, "{} {hit} {miss}", class.name());
                for fault in [Fault::Leaks, Fault::Invents, Fault::Far] {
                    let expected = match fault {
                        Fault::Leaks => hit,
                        Fault::Invents => miss,
                        Fault::Far if class.is_shadow() => 0,
                        Fault::Far => hit,
                    };
                    let backends: [&dyn Accelerator; 2] = [&*right, &Faulty(&*right, fault)];
                    let (scores, pairs) = compare(&replay, &world.geometry, &backends);
                    let (_, _, agreement) = pairs[0];
                    assert_eq!(agreement.disagreements(), expected, "{}", class.name());
                    assert_eq!(agreement.same, rays - expected);
                    assert_eq!(scores[0].wrong, 0, "{}", class.name());
                    // The few rays along edges refute no backend.
                    let found = scores[1].wrong;
                    assert!(
                        found <= expected && 1000 * (expected - found) <= 5 * expected,
                        "{found} of {expected}"
                    );
                    assert_eq!(
                        scores[1].hits as i64 - scores[0].hits as i64,
                        match fault {
                            Fault::Leaks => -(hit as i64),
                            Fault::Invents => miss as i64,
                            Fault::Far => 0,
                        }
                    );
                }
            }
        }
    }
}
