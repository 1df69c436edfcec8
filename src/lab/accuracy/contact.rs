//! Cases for false self-shadows and light leaks: a surface must not shadow itself, and an occluder
//! in contact with it must shadow it.
//!
//! Scales run from 1e-6 to 1e6, and distances from the world's origin up to 1e7 times the object's
//! size.

use std::path::Path;
use std::time::Instant;

use glam::{DMat3, DVec3};
use serde_json::{Value, json};

use super::case::{Case, CaseRun, PassCriterion};
use super::counts::{CaseCounts, WrongKind, ulp};
use super::shadow::SurfacePoints;
use crate::accel::Accelerator;
use crate::accel::lane::lanes;
use crate::error::Result;
use crate::geometry::{Geometry, NONE};
use crate::lab::backend::{BuiltBackend, TestedBackend};
use crate::lab::query::trace;
use crate::lab::random::Random;
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, RayPacket};
use crate::scene::{self, Source};
use crate::shading::{Area, set_lane};
use crate::world::{LoadOptions, World};

const GROUP: &str = "contact";

/// Sizes of the objects: the radius of the sphere, half the side of the cube.
const SCALES: [f64; 5] = [1e-6, 1e-3, 1.0, 1e3, 1e6];

/// Distances from the world's origin, in sizes of the object.
const OFFSETS: [f64; 3] = [0.0, 1e3, 1e7];

/// Number of packets for each world in the quick run (`accuracy --quick`). Longer runs trace a
/// multiple.
const PACKETS: u64 = 24;

/// Slow backends ([`TestedBackend::is_slow`]) trace one of this many packets.
const SLOW: u64 = 3;

/// Smallest gap at which an occluder must shadow a surface, in ulp of the largest coordinate.
const CONTACT: f64 = 4.0;

/// Kind of primitives that an object consists of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Solid {
    Triangles,
    Quads,
    Spheres,
}

const SOLIDS: [Solid; 3] = [Solid::Triangles, Solid::Quads, Solid::Spheres];

/// Size, position and rotation of an object in its world.
#[derive(Debug, Clone, Copy)]
pub(super) struct SolidPlacement {
    scale: f64,
    offset: DVec3,
    turn: DMat3,
}

impl SolidPlacement {
    /// A place `offset` sizes from the world's origin.
    pub(super) fn new(scale: f64, offset: f64, turn: DMat3) -> Self {
        Self { scale, offset: DVec3::new(0.6, -0.5, 0.62) * scale * offset, turn }
    }

    /// As [`SolidPlacement::new`]. `number` is the index of the world in its case; at even indices
    /// the object is tilted.
    fn numbered(scale: f64, offset: f64, number: u64) -> Self {
        let turn = match number % 2 {
            0 => DMat3::from_rotation_x(0.7) * DMat3::from_rotation_y(0.6),
            _ => DMat3::IDENTITY,
        };
        Self::new(scale, offset, turn)
    }

    /// Transforms a point of the object to the world.
    pub(super) fn at(&self, v: DVec3) -> DVec3 {
        self.offset + self.turn * v * self.scale
    }

    /// Transforms a displacement of the object to the world: without the offset.
    pub(super) fn vector(&self, v: DVec3) -> DVec3 {
        self.turn * v * self.scale
    }

    fn point(&self, v: [f64; 3]) -> Value {
        json!(self.at(v.into()).to_array())
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

    /// Loads a world of these shapes.
    fn world(&self, shapes: &[Value]) -> Result<World> {
        world(shapes, &self.offset, self.scale)
    }
}

/// Loads a world of shapes through the scene loader, as from a file. `offset` and `scale` place its
/// camera and its light.
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

/// Corner `k` of a cube from -1 to 1; bit i of `k` selects the sign of axis i.
pub(super) fn corner(k: usize) -> [f64; 3] {
    [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { -1.0 } else { 1.0 })
}

/// The sides of a cube: indices of their corners ([`corner`]), in order around each side.
pub(super) const CUBE_SIDES: [[usize; 4]; 6] =
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

/// Scene shapes of a convex object around the origin of `place`.
fn convex(solid: Solid, place: &SolidPlacement) -> Vec<Value> {
    match solid {
        Solid::Spheres => vec![place.sphere([0.0; 3], 1.0)],
        Solid::Quads => CUBE_SIDES.map(|side| place.plane(side.map(corner))).to_vec(),
        Solid::Triangles => {
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

/// A random direction in the hemisphere around `normal`, with a cosine of at least `least`.
pub(super) fn above(random: &mut Random, normal: DVec3, least: f64) -> DVec3 {
    let side = random.direction().cross(normal).normalize_or(normal.any_orthonormal_vector());
    let cosine = random.within(least, 1.0);
    normal * cosine + side * (1.0 - cosine * cosine).sqrt()
}

/// Returns 16 rays. `ray` returns the origin and the goal of each ray. The origin is rounded to f32
/// before the direction is computed.
pub(super) fn towards(mut ray: impl FnMut() -> [DVec3; 2]) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    for i in 0..LANES {
        let [from, goal] = ray();
        let origin = from.as_vec3();
        packet.rays.set(i, origin, (goal - origin.as_dvec3()).as_vec3());
    }
    packet
}

/// Traces packets through a geometry with every tested backend and adds the counts to `run`.
///
/// `first_rays` creates the first rays. `judge` traces secondary rays from the hits of one backend,
/// and counts wrong answers. `salt` selects the random numbers; each call of a case has its own.
pub(super) fn check_secondary_rays(
    run: &mut CaseRun,
    geometry: &Geometry,
    salt: u64,
    first_rays: impl Fn(&mut Random) -> RayPacket + Sync,
    judge: impl Fn(&mut Random, &ColumnHits, &mut CaseCounts) + Sync,
) -> Result<()> {
    run.check_packets(geometry, PACKETS * run.settings.times, |run, built, index| {
        let first = first_rays(&mut run.random(salt << 40 | index << 1));
        built.counts(index % SLOW == 0, |BuiltBackend { tested, accelerator }, counts| {
            // All backends get the same random numbers. The lights differ where the hits differ.
            let mut random = run.random(salt << 40 | index << 1 | 1);
            let mut packet = first.clone();
            let all = Mask::ALL;
            let time = trace(accelerator, &all, &mut packet, false, Coherence::Coherent);
            counts.nanoseconds += time.as_nanos() as u64;
            let points =
                SurfacePoints::new((geometry, accelerator), &packet.hit(&all), &mut packet);
            let seen = ColumnHits { geometry, tested, accelerator, packet: &packet, points };
            judge(&mut random, &seen, counts);
        })
    })
}

/// The hits of one backend on a packet, and their surface points.
pub(super) struct ColumnHits<'a> {
    geometry: &'a Geometry,
    pub tested: &'a TestedBackend,
    accelerator: &'a dyn Accelerator,
    packet: &'a RayPacket,
    pub points: SurfacePoints,
}

impl ColumnHits<'_> {
    /// Traces shadow rays to `lights`, which lie on `area` if it is given. Returns each lane that
    /// has a shadow ray and whether the ray is occluded. A lane is listed once for each way to
    /// trace the packet: [`TestedBackend::coherences`].
    pub fn occluded(
        &self,
        lights: &[DVec3; LANES],
        area: Option<&Area>,
        counts: &mut CaseCounts,
    ) -> Vec<(usize, bool)> {
        let mut q = [[0.0; LANES]; 3];
        for (i, light) in lights.iter().enumerate() {
            set_lane(&mut q, i, light.as_vec3());
        }
        let backend = self.tested.backend;
        let (aimed, rays) = self.points.shadow_rays(backend, (&q, area));
        let ways = self.tested.coherences(Coherence::Coherent).into_iter();
        ways.flat_map(|way| {
            let (mut rays, started) = (rays.clone(), Instant::now());
            self.points.trace(backend, self.scene(), &aimed, &mut rays, way);
            counts.nanoseconds += started.elapsed().as_nanos() as u64;
            let tfar = rays.tfar;
            lanes(&aimed.active).map(move |i| (i, tfar[i] == f32::NEG_INFINITY)).collect::<Vec<_>>()
        })
        .collect()
    }

    /// Traces mirrored rays. Returns each lane that has one, and whether the ray hits anything.
    pub fn mirrored(&self, way: Coherence) -> Vec<(usize, bool)> {
        let (active, packet) = self.points.mirrored(self.scene(), way);
        let lanes = lanes(&active).filter(|&i| self.primitive(i).is_some());
        lanes.map(|i| (i, packet.hits.geom[i] != NONE)).collect()
    }

    /// Counts a ray from lane `i`, and an error of this kind unless `right`.
    pub fn expect(&self, i: usize, right: bool, kind: WrongKind, counts: &mut CaseCounts) {
        counts.rays += 1;
        if !right {
            counts.fail(kind, self.points.position(i));
        }
    }

    /// Geometry and accelerator that rays are traced in.
    fn scene(&self) -> (&Geometry, &dyn Accelerator) {
        (self.geometry, self.accelerator)
    }

    /// Returns whether point `i` is off an area light's plane, by more than 1e-4 of its distance
    /// from the light's corner.
    pub fn is_off_plane(&self, area: &Area, i: usize) -> bool {
        let at = self.points.position(i) - area.corner.as_dvec3();
        at.dot(area.plane).abs() > 1e-4 * at.length()
    }

    /// Index of the primitive that lane `i` hit, if any.
    fn primitive(&self, i: usize) -> Option<u32> {
        let hits = &self.packet.hits;
        (hits.geom[i] != NONE).then(|| self.geometry.primitive(hits.geom[i], hits.prim[i]))
    }
}

/// A case with one convex object: it must not occlude any light above its surface.
fn self_shadow(scale: f64) -> Case {
    let name = format!("self-intersection, scale {scale:e}");
    let what = format!(
        "an octahedron, a cube of quads, a sphere of size {scale:e}, at 0, 1e3 and 1e7 times that from \
         the world's origin: lights above the surface must reach it. Shadow rays of `coursework` \
         start 1e-4 above the surface"
    );
    let criterion = PassCriterion::Zero("shadow rays have no t");
    Case::new(GROUP, name, what, criterion, move |run| {
        let mut salt = 0;
        for solid in SOLIDS {
            for offset in OFFSETS {
                salt += 1;
                let place = SolidPlacement::numbered(scale, offset, salt);
                let world = place.world(&convex(solid, &place))?;
                check_secondary_rays(
                    run,
                    &world.geometry,
                    salt,
                    |random| {
                        let from = random.direction() * random.within(2.0, 6.0) * scale;
                        towards(|| [from, random.cube() * 0.55 * scale])
                    },
                    |random, seen, counts| {
                        let lights = std::array::from_fn(|i| {
                            let distance = 10f64.powf(random.within(-1.0, 3.0)) * scale;
                            let normal = seen.points.normal(i);
                            seen.points.position(i) + above(random, normal, 0.01) * distance
                        });
                        for (i, occluded) in seen.occluded(&lights, None, counts) {
                            counts.rays += 1;
                            let (at, normal) = (seen.points.position(i), seen.points.normal(i));
                            // The normal is on the side of the first ray's origin. Here it points
                            // inwards: that ray passed through the near side of the object.
                            if normal.dot(at) < 0.0 {
                                counts.fail(WrongKind::Leak, at);
                            } else if occluded {
                                counts.fail(WrongKind::SelfShadow, at);
                            }
                        }
                    },
                )?;
            }
        }
        Ok(())
    })
}

/// A floor and an occluder above it. `gap` is their distance in sizes. The occluder is the last
/// triangle or quad.
fn stack(solid: Solid, place: &SolidPlacement, gap: f64) -> Vec<Value> {
    let triangle = |size: f64, z: f64| {
        place.triangle([[-size, -size, z], [2.0 * size, -size, z], [-size, 2.0 * size, z]])
    };
    let quad = |size: f64, z: f64| {
        place.plane([[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]])
    };
    match solid {
        Solid::Triangles => vec![triangle(1.0, 0.0), triangle(2.0, gap)],
        Solid::Quads => vec![quad(1.0, 0.0), quad(2.0, gap)],
        Solid::Spheres => vec![place.sphere([0.0, 0.0, -1.0], 1.0), quad(2.0, gap)],
    }
}

/// Index of the occluder, and its triangles with their f32 corners.
fn planes(geometry: &Geometry, solid: Solid) -> (u32, Vec<[DVec3; 3]>) {
    let (geom, prim) = match solid {
        Solid::Triangles => (0, 1),
        Solid::Quads | Solid::Spheres => (geometry.quads_id(), geometry.quads.len() as u32 - 1),
    };
    let triangles = geometry.triangles(geom, prim).map(|(corners, _)| corners);
    (geometry.primitive(geom, prim), triangles.collect())
}

/// Largest magnitude of a coordinate, over all vertices of meshes and quads.
fn largest(geometry: &Geometry) -> f64 {
    let vertices = geometry.meshes.iter().flat_map(|mesh| mesh.vertices());
    let corners = geometry.quads.iter().flatten();
    let of = |v: &[f32; 3]| v.iter().fold(0.0, |most: f64, x| most.max(f64::from(x.abs())));
    vertices.chain(corners).map(of).fold(0.0, f64::max)
}

/// A case with occluders above a surface, at gaps of `ulps` ulp of the largest coordinate. From a
/// gap of [`CONTACT`] ulp on, the occluder must shadow the surface. At a smaller gap, light that
/// passes through is counted, but does not fail the case.
fn contact(name: String, what: String, scales: Vec<f64>, ulps: Vec<f64>) -> Case {
    let criterion = PassCriterion::Zero("light through a gap below 4 ulp is counted, not failed");
    Case::new(GROUP, name, what, criterion, move |run| {
        let mut salt = 0;
        for (&scale, &ulps) in scales.iter().flat_map(|s| ulps.iter().map(move |u| (s, u))) {
            for (solid, offset) in SOLIDS.into_iter().flat_map(|m| OFFSETS.map(|o| (m, o))) {
                salt += 1;
                let place = SolidPlacement::numbered(scale, offset, salt);
                // The gap is given in ulp of coordinates that depend on the gap. So one ulp is
                // measured in the same scene with a gap of 0.125.
                let flat = place.world(&stack(solid, &place, 0.125))?;
                let unit = ulp(largest(&flat.geometry));
                let world = place.world(&stack(solid, &place, ulps * unit / scale))?;
                in_contact(run, &world.geometry, solid, &place, unit, salt)?;
            }
        }
        Ok(())
    })
}

fn in_contact(
    run: &mut CaseRun,
    geometry: &Geometry,
    solid: Solid,
    place: &SolidPlacement,
    unit: f64,
    salt: u64,
) -> Result<()> {
    let (occluder, planes) = planes(geometry, solid);
    let [a, b, c] = planes[0];
    let up = (b - a).cross(c - a).normalize();
    let middle = match solid {
        Solid::Triangles => a.lerp(b, 0.5).lerp(c, 1.0 / 3.0),
        Solid::Quads | Solid::Spheres => b.lerp(c, 0.5),
    };
    let scale = place.scale;
    // Rays hit the sphere only near its top, where it falls off by less than an ulp of its size.
    // They hit the other floors up to 0.5 sizes from the middle.
    let reach = if solid == Solid::Spheres { 3e-4 } else { 0.5 };
    check_secondary_rays(
        run,
        geometry,
        salt,
        |random| {
            let mut packet = towards(|| {
                let side = random.direction().cross(up);
                let goal = middle + side * random.unit() * reach * scale;
                [goal + above(random, up, 0.3) * random.within(1.0, 4.0) * scale, goal]
            });
            // The goal is on the occluder. A ray that leaves the occluder ignores it, and hits the
            // floor below.
            packet.rays.leaving = [occluder; LANES];
            packet
        },
        |random, seen, counts| {
            let lights = std::array::from_fn(|i| {
                let distance = 10f64.powf(random.within(-0.5, 2.0)) * scale;
                seen.points.position(i) + above(random, up, 0.05) * distance
            });
            for (i, occluded) in seen.occluded(&lights, None, counts) {
                counts.rays += 1;
                let point = seen.points.position(i);
                if seen.primitive(i).is_none_or(|hit| hit == occluder) {
                    counts.fail(WrongKind::Leak, point);
                    continue;
                }
                // Gap between occluder and point: rounding of the point changes it by half an ulp.
                let gap = planes
                    .iter()
                    .map(|&[a, b, c]| (a - point).dot((b - a).cross(c - a).normalize()).abs())
                    .fold(f64::INFINITY, f64::min);
                match (gap >= CONTACT * unit, occluded) {
                    (true, false) => counts.fail(WrongKind::LightLeak, point),
                    (false, false) => counts.counted += 1,
                    _ => {}
                }
            }
        },
    )
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = SCALES.into_iter().map(self_shadow).collect();
    cases.extend(SCALES.into_iter().map(|scale| {
        let what = format!(
            "an occluder 4, 8 and 1000 ulp of the largest coordinate above a triangle, a quad, a sphere \
             of size {scale:e}, at 0, 1e3 and 1e7 times that from the world's origin: it must shadow \
             them. Shadow rays of `coursework` start 1e-4 above the surface"
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
