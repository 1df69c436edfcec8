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
use crate::monitor::Monitor;
use crate::reserve;

/// Distance of a node or leaf, in units of its radius, beyond which its expansion counts.
///
/// docs/notebook/trust.md has errors and times for 2 to 3.
const FAR: f64 = 2.5;

/// Square of the share of the product of a face's longest edges below which its area is rounding.
const NO_AREA: f64 = 1.0 / (1u128 << 88) as f64;

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
    let [p, q, r] = corners;
    let (e1, e2, e3) = (q - p, r - p, r - q);
    // The angle of a face without area, near to it, would be noise of any size.
    let [l1, l2, l3] = [e1, e2, e3].map(DVec3::length_squared);
    let longest = (l1 * l2).max(l2 * l3).max(l3 * l1);
    if e1.cross(e2).length_squared() <= NO_AREA * longest {
        return 0.0;
    }
    let [a, b, c] = corners.map(|corner| corner - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(below)
}
