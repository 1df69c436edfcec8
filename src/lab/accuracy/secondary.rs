//! Cases with secondary rays. They start at inner edges and corners of closed rooms, run to area
//! lights at a ceiling, or are mirrored at a small angle.

use glam::{DMat3, DVec3, Vec3};

use super::case::{Case, PassCriterion};
use super::contact::{CUBE_SIDES, SolidPlacement, above, check_secondary_rays, corner, towards};
use super::counts::WrongKind;
use super::meshes::{self, geometry, scene};
use crate::geometry::{Geometry, TriangleMesh};
use crate::lab::random::Random;
use crate::ray::{Coherence, RayPacket};
use crate::shading::Area;

const GROUP: &str = "secondary rays";

/// Pairs of the size of a room (half the side of the cube) and its distance from the origin, in
/// sizes.
const PLACES: [(f64, f64); 5] = [(1.0, 0.0), (1e-3, 0.0), (1e3, 0.0), (1.0, 10.0), (1.0, 1e3)];

/// Returns rotation `k` of the rooms. Rotation 0 is the identity.
fn turn(k: usize) -> DMat3 {
    let k = k as f64;
    DMat3::from_rotation_x(0.7 * k)
        * DMat3::from_rotation_y(0.4 * k)
        * DMat3::from_rotation_z(1.1 * k)
}

/// A closed room around the origin, before [`SolidPlacement`] moves it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Room {
    /// A cube of six quads.
    Quads,
    /// A cube of triangles.
    Triangles,
    /// A ball of triangles, seen from inside.
    Ball,
    /// A ball with folds and noise, like a scan.
    Scan,
    /// The middle cell of several cells that share their walls.
    Cell,
}

/// Smallest cosine between a shadow ray and the normal: above the rounding of the direction.
const MIN_COSINE: f64 = 1e-6;

const ROOMS: [Room; 5] = [Room::Quads, Room::Triangles, Room::Ball, Room::Scan, Room::Cell];

impl Room {
    /// Returns the geometry and the edges of the room, transformed by `place` and rounded to f32.
    fn place(self, place: &SolidPlacement) -> (Geometry, Vec<[DVec3; 2]>) {
        let rounded = |v: DVec3| place.at(v).as_vec3();
        let shape = match self {
            Self::Quads => {
                let sides = CUBE_SIDES.map(|side| side.map(|k| rounded(corner(k).into())));
                let quads = sides.iter().map(|side| side.map(|v| v.to_array())).collect();
                let edge = |side: [Vec3; 4], k: usize| [side[k], side[(k + 1) % 4]];
                let edges = sides.iter().flat_map(|&side| (0..4).map(move |k| edge(side, k)));
                let edges = edges.map(|edge| edge.map(|v| v.as_dvec3())).collect();
                return (geometry(vec![], quads, vec![]), edges);
            }
            Self::Triangles => meshes::cube(2),
            Self::Ball => meshes::icosphere(2),
            Self::Scan => meshes::scan(),
            Self::Cell => meshes::cells(true),
        };
        let at = |v: u32| rounded(shape.vertices[v as usize]).as_dvec3();
        let of = |&[a, b, c]: &[u32; 3]| [[at(a), at(b)], [at(b), at(c)], [at(c), at(a)]];
        let aimed = match self {
            Self::Cell => meshes::cells(false).triangles,
            _ => shape.triangles.clone(),
        };
        let edges = aimed.iter().flat_map(of).collect();
        let vertices = shape.vertices.iter().map(|&v| rounded(v).to_array()).collect();
        (scene(TriangleMesh::new(vertices, shape.triangles, false)), edges)
    }

    /// Returns half the side of a cube around the room's middle that lies well inside the room.
    fn within(self) -> f64 {
        if self == Self::Cell { 0.13 } else { 0.4 }
    }

    /// Returns whether all points inside the room see each other.
    fn is_convex(self) -> bool {
        self != Self::Scan
    }
}

/// Returns 16 rays from `from` to random edges. A ray is aimed at an end of the edge or at a point
/// on it, exactly or by 1e-9 to 1e-3 of the edge's length beside it.
fn at_edges(random: &mut Random, from: DVec3, edges: &[[DVec3; 2]]) -> RayPacket {
    towards(|| {
        let [a, b] = edges[random.below(edges.len() as u32) as usize];
        let goal = if random.below(4) == 0 { a } else { a.lerp(b, random.unit()) };
        let beside = match random.below(3) {
            0 => DVec3::ZERO,
            _ => random.direction() * (b - a).length() * 10f64.powf(random.within(-9.0, -3.0)),
        };
        [from, goal + beside]
    })
}

/// A case with a closed room. No secondary ray from its inner edges may escape, and lights inside
/// must reach them.
fn closed(room: Room, name: &str) -> Case {
    let what = format!(
        "a room {name} in up to 3 rotations, of size 1e-3, 1 and 1e3 at the origin, and of size 1 at 10 and 1e3 sizes \
         from it: the first rays hit its inner edges and corners, or points just beside them. Shadow rays from there to \
         lights outside must be occluded, and mirrored rays must hit. Lights inside a convex room must be visible"
    );
    let criterion = PassCriterion::Zero("t is not measured, only hit or miss");
    Case::new(GROUP, format!("closed room, {name}"), what, criterion, move |run| {
        let turns = if room == Room::Scan { 1 } else { 3 };
        let cases = PLACES.iter().flat_map(|&place| (0..turns).map(move |k| (place, k)));
        for (salt, ((scale, distance), k)) in cases.enumerate() {
            let place = SolidPlacement::new(scale, distance, turn(k));
            let (geometry, edges) = room.place(&place);
            check_secondary_rays(
                run,
                &geometry,
                salt as u64,
                |random| {
                    let from = place.at(random.cube() * room.within());
                    at_edges(random, from, &edges)
                },
                |random, seen, counts| {
                    let outside = std::array::from_fn(|i| {
                        let normal = seen.points.normal(i);
                        let far = 10f64.powf(random.within(1.0, 3.0)) * scale;
                        seen.points.position(i) + above(random, normal, MIN_COSINE) * far
                    });
                    for (i, occluded) in seen.occluded(&outside, None, counts) {
                        seen.expect(i, occluded, WrongKind::Leak, counts);
                    }
                    for (i, hit) in seen.mirrored(Coherence::Coherent) {
                        seen.expect(i, hit, WrongKind::Leak, counts);
                    }
                    if !room.is_convex() {
                        return;
                    }
                    let inside = std::array::from_fn(|_| place.at(random.cube() * room.within()));
                    for (i, occluded) in seen.occluded(&inside, None, counts) {
                        seen.expect(i, !occluded, WrongKind::SelfShadow, counts);
                    }
                },
            )?;
        }
        Ok(())
    })
}

/// Position of an area light relative to the ceiling of [`room_with_ceiling`].
#[derive(Debug, Clone, Copy, PartialEq)]
enum Side {
    /// In the plane of the ceiling.
    Flush,
    /// Below the ceiling, by the gap of [`HAIR`].
    Below,
    /// Above the ceiling, by the gap of [`HAIR`].
    Above,
}

/// Gap between a light and the ceiling of a room at the origin, in sizes. It is far larger than the
/// rounding of corners and far smaller than a picture shows.
const HAIR: f64 = 1e-5;

/// Returns a mesh of n x n cells. Its vertices are indexed row by row. `split` gets the index of a
/// cell's first vertex and returns the cell's two triangles.
fn grid(
    n: u32,
    vertex: impl Fn(u32, u32) -> [f32; 3],
    split: impl Fn(u32) -> [[u32; 3]; 2],
) -> TriangleMesh {
    let square = |n: u32| (0..n).flat_map(move |j| (0..n).map(move |i| (i, j)));
    let vertices = square(n + 1).map(|(i, j)| vertex(i, j)).collect();
    let triangles = square(n).flat_map(|(i, j)| split(j * (n + 1) + i)).collect();
    TriangleMesh::new(vertices, triangles, false)
}

/// Returns a floor at z = -1, a side wall at x = 2 and a ceiling at z = 1, transformed by `place`.
/// The ceiling is one quad if `quads`, else a grid of small triangles.
fn room_with_ceiling(quads: bool, place: &SolidPlacement) -> Geometry {
    let rounded = |x: f64, y: f64, z: f64| place.at(DVec3::new(x, y, z)).as_vec3().to_array();
    let floor = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]];
    let floor = floor.map(|[x, y]| rounded(x, y, -1.0));
    let side = [[-2.0, -1.0], [-2.0, 1.0], [2.0, 1.0], [2.0, -1.0]];
    let side = side.map(|[y, z]| rounded(2.0, y, z));
    if quads {
        let ceiling = [[-2.0, -2.0], [-2.0, 2.0], [2.0, 2.0], [2.0, -2.0]];
        let ceiling = ceiling.map(|[x, y]| rounded(x, y, 1.0));
        return geometry(vec![], vec![floor, side, ceiling], vec![]);
    }
    let n = 16;
    let at = |i: u32| f64::from(i) / f64::from(n) * 4.0 - 2.0;
    let vertex = |i, j| rounded(at(i), at(j), 1.0);
    let split = |k| [[k, k + n + 1, k + 1], [k + 1, k + n + 1, k + n + 2]];
    geometry(vec![grid(n, vertex, split)], vec![floor, side], vec![])
}

/// A case with an area light at the ceiling. The ceiling must occlude the light only if the light
/// lies above it.
fn flush(side: Side, what: &str) -> Case {
    let name = format!("area light {what}");
    let text = format!(
        "an area light {what}, the ceiling (a quad or a grid of triangles), in 3 rotations, of size 1e-3, 1 and 1e3 at \
         the origin, and of size 1 at 10 and 1e3 sizes from it: points of the floor, and of a side wall up to the \
         ceiling, {}",
        if side == Side::Above { "must not see it" } else { "must see it" }
    );
    Case::new(GROUP, name, text, PassCriterion::Zero("shadow rays have no t"), move |run| {
        let mut salt = 0;
        for (scale, distance) in PLACES {
            for (k, quads) in (0..6).map(|k| (k / 2, k % 2 == 0)) {
                salt += 1;
                let place = SolidPlacement::new(scale, distance, turn(k));
                let geometry = room_with_ceiling(quads, &place);
                // Far from the origin f32 is coarser, so the gap grows with the distance.
                let hair = HAIR * (1.0 + distance);
                let z = match side {
                    Side::Flush => 1.0,
                    Side::Below => 1.0 - hair,
                    Side::Above => 1.0 + hair,
                };
                let corner = place.at(DVec3::new(-0.5, -0.4, z)).as_vec3();
                let [edge, height] = [DVec3::X, DVec3::new(0.0, 0.7, 0.0)].map(|v| place.vector(v));
                let mut area = Area::new(corner, edge, height, false, 1);
                area.set_plane_gap(&geometry);
                check_secondary_rays(
                    run,
                    &geometry,
                    salt,
                    |random| at_room(random, &place),
                    |random, seen, counts| {
                        let lights = std::array::from_fn(|_| {
                            let (s, t) = (random.unit() as f32, random.unit() as f32);
                            let q: Vec3 = area.corner + area.edge * s + area.height * t;
                            q.as_dvec3()
                        });
                        for (i, occluded) in seen.occluded(&lights, Some(&area), counts) {
                            // Points in the light's plane are not judged.
                            if seen.is_off_plane(&area, i) {
                                let right = occluded == (side == Side::Above);
                                let kind = if occluded {
                                    WrongKind::SelfShadow
                                } else {
                                    WrongKind::LightLeak
                                };
                                seen.expect(i, right, kind, counts);
                            }
                        }
                    },
                )?;
            }
        }
        Ok(())
    })
}

/// Returns 16 rays from one point near the middle of the room to its floor and its side wall. Some
/// aim at the wall's diagonal: a rotated quad is not flat in f32, so its diagonal is an inner or
/// outer edge.
fn at_room(random: &mut Random, place: &SolidPlacement) -> RayPacket {
    let from = place.at(random.cube() * 0.5);
    towards(|| {
        let (x, y) = (random.within(-1.9, 1.9), random.within(-1.9, 1.9));
        let goal = match random.below(3) {
            0 => DVec3::new(x, y, -1.0),
            1 => {
                let below = 10f64.powf(random.within(-2.5, 0.2));
                DVec3::new(2.0, 2.0 * below - 2.0, 1.0 - below)
            }
            // At least 0.003 sizes below the ceiling.
            _ => DVec3::new(2.0, y, 1.0 - 10f64.powf(random.within(-2.5, 0.2))),
        };
        [from, place.at(goal)]
    })
}

/// A case with rays that a flat mirror reflects at a small angle. They must not hit the mirror.
fn mirrors() -> Case {
    let what = "a mirror of coplanar triangles in 6 rotations reflects rays that arrive with a slope of 1e-6 to 0.1: nothing \
                lies above it, so no reflected ray may hit";
    let criterion = PassCriterion::Zero("rays that hit nothing have no t");
    Case::new(GROUP, "grazing mirrors", what, criterion, move |run| {
        for k in 0..6 {
            let turn = turn(k);
            // Multiples of 1/4096, so that the rotated floor is exactly flat in f32.
            let lattice = |v: DVec3| (v * 4096.0).round() / 4096.0;
            let (x, y) = (lattice(turn * DVec3::X * 0.125), lattice(turn * DVec3::Y * 0.125));
            let n = 16u32;
            let vertex =
                |i, j| (x * (f64::from(i) - 8.0) + y * (f64::from(j) - 8.0)).as_vec3().to_array();
            let split = |k| [[k, k + 1, k + n + 1], [k + 1, k + n + 2, k + n + 1]];
            let geometry = scene(grid(n, vertex, split));
            let up = x.cross(y).normalize();
            check_secondary_rays(
                run,
                &geometry,
                k as u64,
                |random| {
                    towards(|| {
                        let goal = x * random.within(-8.0, 8.0) + y * random.within(-8.0, 8.0);
                        let side =
                            up.cross(random.direction()).normalize_or(up.any_orthonormal_vector());
                        let slope = 10f64.powf(random.within(-6.0, -1.0));
                        [goal + (side + up * slope) * random.within(0.5, 3.0), goal]
                    })
                },
                |_, seen, counts| {
                    for way in seen.tested.coherences(Coherence::Coherent) {
                        for (i, hit) in seen.mirrored(way) {
                            seen.expect(i, !hit, WrongKind::SelfShadow, counts);
                        }
                    }
                },
            )?;
        }
        Ok(())
    })
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    let names = [
        "of six quads",
        "of a cube's triangles",
        "of a ball's triangles",
        "of a scan's triangles",
        "of a cell among others",
    ];
    let mut cases: Vec<Case> =
        ROOMS.into_iter().zip(names).map(|(room, name)| closed(room, name)).collect();
    cases.push(flush(Side::Flush, "in the plane of a wall"));
    cases.push(flush(Side::Below, "a hair before a wall"));
    cases.push(flush(Side::Above, "a hair behind a wall"));
    cases.push(mirrors());
    cases
}
