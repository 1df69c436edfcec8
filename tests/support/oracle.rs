//! Finds the first hit of a ray in f64 by testing all primitives. Reports where f32 cannot decide.

use glam::DVec3;
use lightpath::geometry::{Geometry, Sphere};

/// Size of the scene.
#[derive(Clone, Copy)]
pub struct Scale(pub f64);

/// First hit of a ray.
#[derive(Debug, Clone, Copy)]
pub enum Answer {
    Miss,
    Hit {
        primitive: u32,
        t: f64,
    },
    /// Too near an edge, a silhouette, its own origin or a second hit.
    Unsure,
}

/// Relative margin for f32 arithmetic, far above its errors.
const MARGIN: f64 = 0.01;

/// Combines the answers of all primitives.
pub fn closest(
    geometry: &Geometry,
    origin: DVec3,
    direction: DVec3,
    Scale(scale): Scale,
) -> Answer {
    let corner = |p: [f32; 3]| DVec3::from(p.map(f64::from));
    let mut all: Vec<(u32, Vec<Meeting>)> = Vec::new();
    for (geom, mesh) in geometry.meshes.iter().enumerate() {
        for prim in 0..mesh.triangles().len() as u32 {
            let meeting = triangle(mesh.corners(prim).map(corner), origin, direction, scale);
            all.push((geometry.primitive(geom as u32, prim), vec![meeting]));
        }
    }
    for (prim, quad) in geometry.quads.iter().enumerate() {
        let [v0, v1, v2, v3] = quad.map(corner);
        let halves = [[v0, v1, v3], [v2, v3, v1]];
        let meetings = halves.map(|half| triangle(half, origin, direction, scale)).to_vec();
        all.push((geometry.primitive(geometry.quads_id(), prim as u32), meetings));
    }
    for (prim, ball) in geometry.spheres.iter().enumerate() {
        let primitive = geometry.primitive(geometry.spheres_id(), prim as u32);
        all.push((primitive, sphere(ball, origin, direction, scale)));
    }
    let mut hits: Vec<(f64, u32)> = Vec::new();
    for (primitive, meetings) in all {
        for meeting in meetings {
            match meeting {
                Meeting::None => {}
                Meeting::At(t) => hits.push((t, primitive)),
                Meeting::Unsure => return Answer::Unsure,
            }
        }
    }
    hits.sort_by(|a, b| a.0.total_cmp(&b.0));
    match hits[..] {
        [] => Answer::Miss,
        [(t, _), (next, _), ..] if next - t < MARGIN * scale => Answer::Unsure,
        [(t, primitive), ..] => Answer::Hit { primitive, t },
    }
}

#[derive(Clone, Copy)]
enum Meeting {
    None,
    At(f64),
    Unsure,
}

fn at(t: f64, scale: f64) -> Meeting {
    if t > MARGIN * scale {
        Meeting::At(t)
    } else if t < -MARGIN * scale {
        Meeting::None
    } else {
        Meeting::Unsure
    }
}

fn triangle([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3, scale: f64) -> Meeting {
    let (e, f) = (b - a, c - a);
    let normal = e.cross(f);
    let slope = normal.dot(direction);
    if normal.length() < 0.05 * scale * scale || slope.abs() < 0.05 * normal.length() {
        return Meeting::Unsure; // a sliver, or seen edge on
    }
    let t = (a - origin).dot(normal) / slope;
    let p = origin + direction * t - a;
    let (u, v) =
        (p.cross(f).dot(normal) / normal.dot(normal), e.cross(p).dot(normal) / normal.dot(normal));
    let inside = u.min(v).min(1.0 - u - v);
    if inside < -MARGIN {
        Meeting::None
    } else if inside < MARGIN {
        Meeting::Unsure
    } else {
        at(t, scale)
    }
}

fn sphere(ball: &Sphere, origin: DVec3, direction: DVec3, scale: f64) -> Vec<Meeting> {
    let middle = (ball.center - origin).dot(direction) / direction.length_squared();
    let miss = (origin + direction * middle - ball.center).length() / ball.radius;
    if (miss - 1.0).abs() < MARGIN {
        return vec![Meeting::Unsure];
    }
    if miss > 1.0 {
        return Vec::new();
    }
    let half = ball.radius * (1.0 - miss * miss).sqrt() / direction.length();
    vec![at(middle - half, scale), at(middle + half, scale)]
}
