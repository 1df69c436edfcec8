//! Surfaces that must not shadow themselves, and occluders in contact that must shadow them, at
//! scales from 1e-6 to 1e6 and up to 1e7 times the object's size away from the world's origin.

use std::path::Path;
use std::time::Instant;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::case::{Case, Mark, Run};
use super::column::Built;
use super::judge::trace;
use super::shadow::Points;
use super::tally::{Kind, Tally, ulp};
use crate::accel::Accelerator;
use crate::accel::lane::lanes;
use crate::error::Result;
use crate::geometry::{Geometry, NONE};
use crate::measure::random::Random;
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, RayPacket};
use crate::scene::{self, Source};
use crate::shading::{Area, set_lane};
use crate::world::{LoadOptions, World};

const GROUP: &str = "contact";

/// What objects are multiplied by.
const SCALES: [f64; 5] = [1e-6, 1e-3, 1.0, 1e3, 1e6];

/// Distances from the world's origin, in sizes of the object.
const OFFSETS: [f64; 3] = [0.0, 1e3, 1e7];

/// Packets of each world in the quick run.
const PACKETS: u64 = 24;

/// Slow columns trace every so many-th packet.
const SLOW: u64 = 3;

/// Occluders at least so many ulp of the largest coordinate above a surface must shadow it.
const CONTACT: f64 = 4.0;

/// The primitives that objects are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Made {
    Triangles,
    Quads,
    Spheres,
}

const MADE: [Made; 3] = [Made::Triangles, Made::Quads, Made::Spheres];

/// An object in its world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    scale: f64,
    offset: DVec3,
    turn: DMat3,
}

impl Place {
    fn new(scale: f64, offset: f64, tilted: bool) -> Self {
        let turn = match tilted {
            true => DMat3::from_rotation_x(0.7) * DMat3::from_rotation_y(0.6),
            false => DMat3::IDENTITY,
        };
        let offset = DVec3::new(0.6, -0.5, 0.62) * scale * offset;
        Self { scale, offset, turn }
    }

    fn point(&self, v: [f64; 3]) -> Value {
        json!((self.offset + self.turn * DVec3::from(v) * self.scale).to_array())
    }

    fn sphere(&self, center: [f64; 3], radius: f64) -> Value {
        json!({ "type": "sphere", "material": {}, "center": self.point(center),
                "radius": radius * self.scale })
    }

    fn triangle(&self, [a, b, c]: [[f64; 3]; 3]) -> Value {
        json!({ "type": "triangle", "material": {}, "v0": self.point(a), "v1": self.point(b),
                "v2": self.point(c) })
    }

    fn plane(&self, [a, b, c, d]: [[f64; 3]; 4]) -> Value {
        json!({ "type": "plane", "material": {}, "v0": self.point(a), "v1": self.point(b),
                "v2": self.point(c), "v3": self.point(d) })
    }

    /// A world of these shapes.
    fn world(&self, shapes: &[Value]) -> Result<World> {
        world(shapes, &self.offset, self.scale)
    }
}

/// A world of shapes, as it would be read from a file.
pub(super) fn world(shapes: &[Value], offset: &DVec3, scale: f64) -> Result<World> {
    let at = |v: DVec3| json!((*offset + v * scale).to_array());
    let scene = json!({
        "camera": { "type": "pinhole", "width": 16, "height": 16, "fov": 50,
                    "position": at(DVec3::Z * 5.0), "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "shapes": shapes, "lightsources": [
            { "type": "pointlight", "position": at(DVec3::splat(9.0)), "id": [1, 1, 1] }] }
    });
    let text = scene.to_string();
    let source = Source::Text { name: "contact", text: text.as_bytes(), folder: Path::new("") };
    let loaded = scene::load(source, &[])?;
    Ok(World::load(&loaded.scene, LoadOptions::default(), &Monitor::default())?.0)
}

/// Corners of a cube by bits of their number.
fn corner(k: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { -1.0 } else { 1.0 })
}

/// Scene shapes of a convex object around the origin.
fn convex(made: Made, place: &Place) -> Vec<Value> {
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    match made {
        Made::Spheres => vec![place.sphere([0.0; 3], 1.0)],
        Made::Quads => sides.map(|side| place.plane(side.map(corner))).to_vec(),
        Made::Triangles => {
            // An octahedron.
            let tip = |axis: usize, k: usize| {
                let mut v = [0.0; 3];
                v[axis] = corner(k)[axis];
                v
            };
            (0..8).map(|k| place.triangle([0, 1, 2].map(|axis| tip(axis, k)))).collect()
        }
    }
}

/// A direction within the hemisphere around `normal`, its cosine at least `least`.
pub(super) fn above(random: &mut Random, normal: DVec3, least: f64) -> DVec3 {
    let side = random.direction().cross(normal).normalize_or(normal.any_orthonormal_vector());
    let cosine = random.within(least, 1.0);
    normal * cosine + side * (1.0 - cosine * cosine).sqrt()
}

/// 16 rays from around to the object of size `scale`.
fn looks(
    random: &mut Random,
    scale: f64,
    target: impl Fn(&mut Random) -> DVec3,
    down: bool,
) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    let from = random.direction() * random.within(2.0, 6.0);
    for i in 0..LANES {
        let mut from = from;
        if down {
            from.z = from.z.abs().max(1.0);
        }
        let origin = (from * scale).as_vec3();
        set_lane(&mut packet.rays.org, i, origin);
        let direction = (target(random) - origin.as_dvec3()).as_vec3();
        set_lane(&mut packet.rays.dir, i, direction);
    }
    packet
}

/// Traces packets through a world: `looks` makes them, `judge` aims at lights from what a column
/// saw and says what is wrong.
pub(super) fn check(
    run: &mut Run,
    geometry: &Geometry,
    salt: u64,
    looks: impl Fn(&mut Random) -> RayPacket + Sync,
    judge: impl Fn(&mut Random, &Seen, &mut Tally) + Sync,
) -> Result<()> {
    let mut sums = vec![Tally::default(); run.tallies.len()];
    {
        let run = &*run;
        let built: Built = run.build(geometry)?;
        let portion: Vec<Vec<Tally>> = (0..PACKETS * run.settings.times)
            .into_par_iter()
            .filter(|_| !run.monitor.stopped())
            .map(|index| {
                let first = looks(&mut run.random(salt << 40 | index << 1));
                let mut tallies = Vec::new();
                for (column, accelerator) in &built.columns {
                    let mut tally = Tally::default();
                    if !column.slow() || index % SLOW == 0 {
                        // The same lights for all columns.
                        let mut random = run.random(salt << 40 | index << 1 | 1);
                        let mut packet = first.clone();
                        let all = Mask([-1; LANES]);
                        tally.nanoseconds +=
                            trace(&**accelerator, &all, &mut packet, false, Coherence::Coherent);
                        let scene = (geometry, &**accelerator);
                        let points = Points::new(scene, &packet.hit(&all), &mut packet);
                        let seen = Seen {
                            geometry,
                            column,
                            accelerator: &**accelerator,
                            packet: &packet,
                            points,
                        };
                        judge(&mut random, &seen, &mut tally);
                    }
                    tallies.push(tally);
                }
                tallies
            })
            .collect();
        run.monitor.check()?;
        for tallies in &portion {
            sums.iter_mut().zip(tallies).for_each(|(sum, tally)| sum.add(tally));
        }
    }
    run.keep(geometry, sums)
}

/// What a column saw of a packet.
pub(super) struct Seen<'a> {
    geometry: &'a Geometry,
    pub column: &'a super::column::Column,
    accelerator: &'a dyn Accelerator,
    packet: &'a RayPacket,
    pub points: Points,
}

impl Seen<'_> {
    /// For each way to ask: which lanes have a shadow ray, and which of them are occluded.
    pub fn occluded(
        &self,
        lights: &[DVec3; LANES],
        area: Option<&Area>,
        tally: &mut Tally,
    ) -> Vec<(Mask, [bool; LANES])> {
        let mut q = [[0.0; LANES]; 3];
        for (i, light) in lights.iter().enumerate() {
            set_lane(&mut q, i, light.as_vec3());
        }
        let backend = self.column.backend();
        let (aimed, rays) = self.points.shadow_rays(backend, (&q, area));
        let ways = self.column.ways(Coherence::Coherent).into_iter();
        ways.map(|way| {
            let (mut rays, started) = (rays.clone(), Instant::now());
            self.points.trace(backend, self.scene(), &aimed, &mut rays, way);
            tally.nanoseconds += started.elapsed().as_nanos() as u64;
            (aimed.active, rays.tfar.map(|tfar| tfar == f32::NEG_INFINITY))
        })
        .collect()
    }

    /// What rays are traced in.
    pub fn scene(&self) -> (&Geometry, &dyn Accelerator) {
        (self.geometry, self.accelerator)
    }

    /// Which points lie below a light's plane, on the side of the scene's middle, by more than rounding.
    pub fn is_below(&self, area: &Area) -> [bool; LANES] {
        std::array::from_fn(|i| {
            let at = self.points.position(i) - area.corner.as_dvec3();
            at.dot(area.plane).abs() > 1e-4 * at.length()
        })
    }

    /// Primitive of lane `i`, if it hit one.
    pub fn primitive(&self, i: usize) -> Option<u32> {
        let hits = &self.packet.hits;
        (hits.geom[i] != NONE).then(|| self.geometry.primitive(hits.geom[i], hits.prim[i]))
    }
}

/// Convex objects alone: no light above a surface is hidden.
fn self_shadow(scale: f64) -> Case {
    let name = format!("self-intersection, scale {scale:e}");
    let what = format!(
        "an octahedron, a cube of quads, a sphere of size {scale:e}, at 0, 1e3 and 1e7 times that from \
         the world's origin: lights above the surface must reach it. `coursework` with its offset of 1e-4"
    );
    let mark = Mark::Zero("shadow rays have no t");
    Case::new(GROUP, name, what, mark, move |run| {
        let mut salt = 0;
        for made in MADE {
            for offset in OFFSETS {
                salt += 1;
                let place = Place::new(scale, offset, salt % 2 == 0);
                let world = place.world(&convex(made, &place))?;
                let target = |random: &mut Random| random.cube() * 0.55 * scale;
                check(
                    run,
                    &world.geometry,
                    salt,
                    |random| looks(random, scale, target, false),
                    |random, seen, tally| {
                        let lights = std::array::from_fn(|i| {
                            let distance = 10f64.powf(random.within(-1.0, 3.0)) * scale;
                            let normal = seen.points.normal(i);
                            seen.points.position(i) + above(random, normal, 0.01) * distance
                        });
                        for (active, occluded) in seen.occluded(&lights, None, tally) {
                            for i in lanes(&active) {
                                tally.rays += 1;
                                let (at, normal) = (seen.points.position(i), seen.points.normal(i));
                                // Seen from within: the ray has come through the side that faces it.
                                if normal.dot(at) < 0.0 {
                                    tally.fail(Kind::Leak, at);
                                } else if occluded[i] {
                                    tally.fail(Kind::SelfShadow, at);
                                }
                            }
                        }
                    },
                )?;
            }
        }
        Ok(())
    })
}

/// A floor, and an occluder `ulps` above it; the occluder comes last of its kind.
fn stack(made: Made, place: &Place, gap: f64) -> Vec<Value> {
    let triangle = |size: f64, z: f64| {
        place.triangle([[-size, -size, z], [2.0 * size, -size, z], [-size, 2.0 * size, z]])
    };
    let quad = |size: f64, z: f64| {
        place.plane([[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]])
    };
    match made {
        Made::Triangles => vec![triangle(1.0, 0.0), triangle(2.0, gap)],
        Made::Quads => vec![quad(1.0, 0.0), quad(2.0, gap)],
        Made::Spheres => vec![place.sphere([0.0, 0.0, -1.0], 1.0), quad(2.0, gap)],
    }
}

/// The occluder's planes, as f32 corners have them.
fn planes(geometry: &Geometry, made: Made) -> (u32, Vec<[DVec3; 3]>) {
    let f64s = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    match made {
        Made::Triangles => {
            let corners = geometry.meshes[0].corners(1).map(f64s);
            (geometry.primitive(0, 1), vec![corners])
        }
        Made::Quads | Made::Spheres => {
            let prim = geometry.quads.len() as u32 - 1;
            let [a, b, c, d] = geometry.quads[prim as usize].map(f64s);
            (geometry.primitive(geometry.quads_id(), prim), vec![[a, b, d], [c, d, b]])
        }
    }
}

/// The largest coordinate of anything.
fn largest(geometry: &Geometry) -> f64 {
    let vertices = geometry.meshes.iter().flat_map(|mesh| mesh.vertices());
    let corners = geometry.quads.iter().flatten();
    let of = |v: &[f32; 3]| v.iter().fold(0.0, |most: f64, x| most.max(f64::from(x.abs())));
    vertices.chain(corners).map(of).fold(0.0, f64::max)
}

/// Occluders `ulps` above a surface: at least [`CONTACT`] ulp they must shadow it.
fn contact(name: String, what: String, scales: Vec<f64>, ulps: Vec<f64>) -> Case {
    let mark = Mark::Zero("occluders nearer than 4 ulp are counted, not failed");
    Case::new(GROUP, name, what, mark, move |run| {
        let mut salt = 0;
        for (&scale, &ulps) in scales.iter().flat_map(|s| ulps.iter().map(move |u| (s, u))) {
            for (made, offset) in MADE.into_iter().flat_map(|m| OFFSETS.map(|o| (m, o))) {
                salt += 1;
                let place = Place::new(scale, offset, salt % 2 == 0);
                // The recentred coordinates do not depend on so small a gap.
                let flat = place.world(&stack(made, &place, 0.125))?;
                let unit = ulp(largest(&flat.geometry));
                let world = place.world(&stack(made, &place, ulps * unit / scale))?;
                in_contact(run, &world.geometry, made, &place, unit, salt)?;
            }
        }
        Ok(())
    })
}

fn in_contact(
    run: &mut Run,
    geometry: &Geometry,
    made: Made,
    place: &Place,
    unit: f64,
    salt: u64,
) -> Result<()> {
    let (occluder, planes) = planes(geometry, made);
    let [a, b, c] = planes[0];
    let up = (b - a).cross(c - a).normalize();
    let middle = match made {
        Made::Triangles => a.lerp(b, 0.5).lerp(c, 1.0 / 3.0),
        Made::Quads | Made::Spheres => b.lerp(c, 0.5),
    };
    let scale = place.scale;
    // Near the top of the sphere, anywhere on the other floors.
    let reach = if made == Made::Spheres { 3e-4 } else { 0.5 };
    check(
        run,
        geometry,
        salt,
        |random| {
            let mut packet = RayPacket::EMPTY;
            for i in 0..LANES {
                let side = random.direction().cross(up);
                let goal = middle + side * random.unit() * reach * scale;
                let origin =
                    (goal + above(random, up, 0.3) * random.within(1.0, 4.0) * scale).as_vec3();
                set_lane(&mut packet.rays.org, i, origin);
                set_lane(&mut packet.rays.dir, i, (goal - origin.as_dvec3()).as_vec3());
                // Through the occluder, which lies between.
                packet.rays.leaving[i] = occluder;
            }
            packet
        },
        |random, seen, tally| {
            let lights = std::array::from_fn(|i| {
                let distance = 10f64.powf(random.within(-0.5, 2.0)) * scale;
                seen.points.position(i) + above(random, up, 0.05) * distance
            });
            for (active, occluded) in seen.occluded(&lights, None, tally) {
                for i in lanes(&active) {
                    tally.rays += 1;
                    let point = seen.points.position(i);
                    if seen.primitive(i).is_none_or(|hit| hit == occluder) {
                        tally.fail(Kind::Leak, point);
                        continue;
                    }
                    // The occluder above this point; the point itself is rounded by half an ulp.
                    let gap = planes
                        .iter()
                        .map(|&[a, b, c]| (a - point).dot((b - a).cross(c - a).normalize()).abs())
                        .fold(f64::INFINITY, f64::min);
                    match (gap >= CONTACT * unit, occluded[i]) {
                        (true, false) => tally.fail(Kind::LightLeak, point),
                        (false, false) => tally.counted += 1,
                        _ => {}
                    }
                }
            }
        },
    )
}

/// Rows of this group.
pub fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = SCALES.into_iter().map(self_shadow).collect();
    cases.extend(SCALES.into_iter().map(|scale| {
        let what = format!(
            "an occluder 4, 8 and 1000 ulp of the largest coordinate above a triangle, a quad, a sphere \
             of size {scale:e}, at 0, 1e3 and 1e7 times that from the world's origin: it must shadow \
             them. `coursework` with its offset of 1e-4"
        );
        contact(format!("occluder in contact, scale {scale:e}"), what, vec![scale], vec![4.01, 8.0, 1000.0])
    }));
    let what = "the same at 0.5 to 3 ulp, size 1: light that comes through is counted".to_string();
    cases.push(contact(
        "occluder nearer than 4 ulp".into(),
        what,
        vec![1.0],
        vec![0.5, 1.0, 2.0, 3.0],
    ));
    cases
}
