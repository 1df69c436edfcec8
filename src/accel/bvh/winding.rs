//! Winding numbers of points. The triangles of a node or leaf that is far away count by their
//! multipole expansion.
//!
//! Source: Barill, Dickson, Schmidt, Levin and Jacobson 2018, "Fast Winding Numbers for Soups and
//! Clouds", ACM TOG 37(4). A node or leaf is far from a point if its distance exceeds [`FAR`] times
//! its radius. Near triangles add their exact solid angles (van Oosterom and Strackee 1983). The
//! tree must not hold quads, whose halves have one index. Spheres are ignored.

use std::f64::consts::PI;

use glam::DVec3;

use super::multipole::{Moments, Multipole};
use super::node::{Child, ChildKind, WIDTH};
use super::tree::Bvh;
use crate::error::Result;
use crate::geometry::DoubleDouble3;
use crate::monitor::Monitor;
use crate::reserve;

/// Distance of a node or leaf, in units of its radius, beyond which its expansion counts.
///
/// docs/notebook/trust.md has errors and times for 2 to 3.
const FAR: f64 = 2.5;

/// Share of the product of the distances of the corners below which numerator and denominator of a
/// solid angle have lost too many bits. The angle is within 2e-5 where one of them is above.
const CANCELLED: f64 = 1e-10;

/// The same in double-double arithmetic: the point is on an edge.
const ON_EDGE: f64 = 1e-28;

/// The multipole expansions of all nodes and leaves of a tree.
#[derive(Debug, Default)]
pub struct Multipoles {
    nodes: Vec<Multipole>,
    blocks: Vec<Multipole>,
}

/// Function that returns the corners of the triangle with a scene-wide index, or `None` if the
/// triangle does not count.
pub type Corners<'a> = &'a (dyn Fn(u32) -> Option<[DVec3; 3]> + Sync);

impl Bvh<'_> {
    /// Computes the expansions of all nodes and leaves.
    ///
    /// # Errors
    /// `Retry` if there is too little memory; `Interrupted` if the monitor was stopped.
    pub fn multipoles(&self, corners: Corners, monitor: &Monitor) -> Result<Multipoles> {
        let filled = |count| reserve::filled(Multipole::default(), count, "winding number");
        let mut out = Multipoles {
            nodes: filled(self.tree.nodes.len())?,
            blocks: filled(self.tree.blocks.len())?,
        };
        self.expand(Child::node(0), corners, monitor, &mut out)?;
        Ok(out)
    }

    /// Computes the expansions of a child and of all nodes below it. Returns its moments.
    fn expand(
        &self,
        child: Child,
        corners: Corners,
        monitor: &Monitor,
        out: &mut Multipoles,
    ) -> Result<Moments> {
        Ok(match child.kind() {
            ChildKind::Node(index) => {
                monitor.check()?;
                let mut parts = [Moments::default(); WIDTH];
                for (part, child) in parts.iter_mut().zip(self.tree.nodes[index].children) {
                    *part = self.expand(child, corners, monitor, out)?;
                }
                let moments = Moments::of_parts(&parts);
                out.nodes[index] = moments.into();
                moments
            }
            ChildKind::Triangles(index) => {
                let all: Vec<_> = self.corners_of(index, corners).collect();
                let moments = Moments::of_triangles(&all);
                out.blocks[index] = moments.into();
                moments
            }
            ChildKind::Spheres(_) | ChildKind::Empty => Moments::default(),
        })
    }

    /// The corners of the triangles of a leaf that count.
    fn corners_of(&self, block: usize, corners: Corners) -> impl Iterator<Item = [DVec3; 3]> {
        let (block, indices) = (&self.tree.blocks[block], self.tree.indices());
        let used = (0..WIDTH).filter(|i| block.present >> i & 1 != 0);
        used.filter_map(move |i| corners(indices.of(block, i)))
    }

    /// Returns the winding number of a point: about 1 inside a closed surface whose normals point
    /// outward, about 0 outside. `multipoles` must have been computed with the same `corners`.
    pub fn winding(&self, multipoles: &Multipoles, point: DVec3, corners: Corners) -> f64 {
        let (mut sum, mut stack) = (0.0, Vec::with_capacity(256));
        stack.push(Child::node(0));
        while let Some(child) = stack.pop() {
            let multipole = match child.kind() {
                ChildKind::Node(index) => &multipoles.nodes[index],
                ChildKind::Triangles(index) => &multipoles.blocks[index],
                ChildKind::Spheres(_) | ChildKind::Empty => continue,
            };
            if let Some(angle) = multipole.solid_angle(point, FAR) {
                sum += angle;
                continue;
            }
            match child.kind() {
                ChildKind::Node(index) => stack.extend(self.tree.nodes[index].children),
                ChildKind::Triangles(index) => {
                    let near = self.corners_of(index, corners);
                    sum += near.map(|corners| solid_angle(corners, point)).sum::<f64>();
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
        sum / (4.0 * PI)
    }
}

/// Returns the signed solid angle of a triangle seen from a point, in steradians. Positive if the
/// point is on the side from which the corners appear clockwise.
fn solid_angle(corners: [DVec3; 3], point: DVec3) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let (product, above) = (la * lb * lc, a.dot(b.cross(c)));
    let below = product + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    if above.abs().max(below.abs()) >= CANCELLED * product {
        return 2.0 * above.atan2(below);
    }
    // Near to an edge, as every point near to a narrow face is.
    let [a, b, c] = corners.map(|corner| DoubleDouble3::between(point, corner));
    let [la, lb, lc] = [&a, &b, &c].map(DoubleDouble3::length);
    let above = a.dot(&b.cross(&c)).value();
    let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    let below = below.value();
    if above.abs().max(below.abs()) < ON_EDGE * product {
        return 0.0;
    }
    2.0 * above.atan2(below)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A closed box of size 1, turned. A corner lies `width` off an edge of its top, so a face is
    /// as narrow.
    fn turned_box(width: f64) -> Vec<[DVec3; 3]> {
        let corner = |x: f64, y: f64, z: f64| turned(DVec3::new(x, y, z));
        let all = [
            corner(0.0, 0.0, 1.0),
            corner(1.0, 0.0, 1.0),
            corner(1.0, 1.0, 1.0),
            corner(0.0, 1.0, 1.0),
            corner(0.0, 0.0, 0.0),
            corner(1.0, 0.0, 0.0),
            corner(1.0, 1.0, 0.0),
            corner(0.0, 1.0, 0.0),
            corner(0.37, width, 1.0),
        ];
        let top = [[0, 1, 8], [8, 1, 2], [8, 2, 3], [0, 8, 3]];
        let sides = [[4, 5, 1], [4, 1, 0], [5, 6, 2], [5, 2, 1], [6, 7, 3], [6, 3, 2]];
        let rest = [[7, 4, 0], [7, 0, 3], [4, 7, 6], [4, 6, 5]];
        let faces = top.into_iter().chain(sides).chain(rest);
        faces.map(|face: [usize; 3]| face.map(|corner| all[corner])).collect()
    }

    fn turned(v: DVec3) -> DVec3 {
        glam::DQuat::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), 1.234) * v
    }

    #[test]
    fn the_numbers_of_points_beside_narrow_faces_are_those_of_the_surface() {
        for width in [0.0, 1e-15, 1e-13, 1e-11, 1e-10, 1e-9, 1e-8, 3e-8, 1e-7, 1e-6] {
            let faces = turned_box(width);
            for i in 0..300 {
                let along = 0.1 + 0.8 * f64::from(i) / 300.0;
                let away = 1e-10 * 1.07f64.powi(i % 100);
                let beside = away * f64::from(i % 7 + 1) / 3.0;
                for (up, inside) in [(away, 0.0), (-away, 1.0)] {
                    let point = turned(DVec3::new(along, beside, 1.0 + up));
                    let sum: f64 = faces.iter().map(|&face| solid_angle(face, point)).sum();
                    let error = (sum / (4.0 * PI)).abs() - inside;
                    assert!(error.abs() < 1e-4, "{width:e} {along} {away:e} {beside:e}: {error}");
                }
            }
        }
    }
}
