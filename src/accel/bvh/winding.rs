//! Winding numbers of points. The triangles of a node or leaf that is far away count as one dipole
//! with its first moments.
//!
//! Source: Barill, Dickson, Schmidt, Levin and Jacobson 2018, "Fast Winding Numbers for Soups and
//! Clouds", ACM TOG 37(4), of second order, for the centers of triangles. A node or leaf is far
//! from a point if its distance exceeds [`FAR`] times its radius. Near triangles add their exact
//! solid angles (van Oosterom and Strackee 1983). The tree must not hold quads, whose halves have
//! one index. Spheres are ignored.

use std::f64::consts::PI;

use glam::DVec3;

use super::node::{Child, ChildKind, WIDTH};
use super::tree::Bvh;
use crate::error::Result;
use crate::monitor::Monitor;
use crate::reserve;

/// Distance of a node or leaf, in units of its radius, beyond which it counts as a dipole.
///
/// Largest error of 400 points in the boxes around four scans: 0.025 with 2, 0.014 with 3.
/// docs/notebook/trust.md has what 3 costs, and other meshes.
const FAR: f64 = 3.0;

/// The triangles of a subtree as one dipole.
#[derive(Debug, Clone, Copy, Default)]
struct Dipole {
    /// Mean position, weighted by area.
    center: DVec3,
    /// Sum of the normals, each with the length of its triangle's area.
    normal: DVec3,
    /// Sum of the areas.
    area: f64,
    /// Largest distance of a vertex from `center`, or a bound of it.
    radius: f64,
    /// Square of [`FAR`] times `radius`. For nearer points, children or triangles are visited.
    near_squared: f64,
    moments: Moments,
}

/// The symmetric part of the sum of `n d^T` over triangles, where `n` is the normal with the length
/// of the area and `d` the way from the dipole's center to that of the triangle: xx, yy, zz, and
/// twice xy, xz, yz. Without it the two sides of a thin wall would cancel out.
#[derive(Debug, Clone, Copy, Default)]
struct Moments([f64; 6]);

/// The dipoles of all nodes and leaves of a tree.
#[derive(Debug, Default)]
pub struct Dipoles {
    nodes: Vec<Dipole>,
    blocks: Vec<Dipole>,
}

/// Function that returns the corners of the triangle with a scene-wide index, or `None` if the
/// triangle does not count.
pub type Corners<'a> = &'a (dyn Fn(u32) -> Option<[DVec3; 3]> + Sync);

impl Bvh<'_> {
    /// Computes the dipoles of all nodes and leaves.
    ///
    /// # Errors
    /// `Retry` if there is too little memory; `Interrupted` if the monitor was stopped.
    pub fn dipoles(&self, corners: Corners, monitor: &Monitor) -> Result<Dipoles> {
        let filled = |count| reserve::filled(Dipole::default(), count, "winding number");
        let mut dipoles = Dipoles {
            nodes: filled(self.tree.nodes.len())?,
            blocks: filled(self.tree.blocks.len())?,
        };
        for (dipole, block) in dipoles.blocks.iter_mut().zip(&self.tree.blocks) {
            monitor.check()?;
            let used = (0..WIDTH).filter(|i| block.present >> i & 1 != 0);
            let indices = self.tree.indices();
            let all: Vec<_> = used.filter_map(|i| corners(indices.of(block, i))).collect();
            *dipole = Dipole::of_triangles(&all);
        }
        self.dipole_of(Child::node(0), &mut dipoles);
        Ok(dipoles)
    }

    /// Computes the dipoles of a child and of all nodes below it. Returns the dipole of the child.
    fn dipole_of(&self, child: Child, dipoles: &mut Dipoles) -> Dipole {
        match child.kind() {
            ChildKind::Node(index) => {
                let parts = self.tree.nodes[index].children.map(|c| self.dipole_of(c, dipoles));
                dipoles.nodes[index] = Dipole::of_parts(&parts);
                dipoles.nodes[index]
            }
            ChildKind::Triangles(index) => dipoles.blocks[index],
            ChildKind::Spheres(_) | ChildKind::Empty => Dipole::default(),
        }
    }

    /// Returns the winding number of a point: about 1 inside a closed surface whose normals point
    /// outward, about 0 outside. `corners` must be the function that `dipoles` was computed with.
    pub fn winding(&self, dipoles: &Dipoles, point: DVec3, corners: Corners) -> f64 {
        let (mut sum, mut stack) = (0.0, Vec::with_capacity(256));
        stack.push(Child::node(0));
        while let Some(child) = stack.pop() {
            let dipole = match child.kind() {
                ChildKind::Node(index) => &dipoles.nodes[index],
                ChildKind::Triangles(index) => &dipoles.blocks[index],
                ChildKind::Spheres(_) | ChildKind::Empty => continue,
            };
            if dipole.area == 0.0 {
                continue;
            }
            let to = dipole.center - point;
            let squared = to.length_squared();
            if squared > dipole.near_squared {
                let first = dipole.normal.dot(to);
                let second = dipole.moments.trace() - 3.0 * dipole.moments.along(to) / squared;
                sum += (first + second) / (squared * squared.sqrt());
                continue;
            }
            match child.kind() {
                ChildKind::Node(index) => stack.extend(self.tree.nodes[index].children),
                ChildKind::Triangles(index) => {
                    let block = &self.tree.blocks[index];
                    let used = (0..WIDTH).filter(|i| block.present >> i & 1 != 0);
                    let indices = self.tree.indices();
                    sum += used
                        .filter_map(|i| corners(indices.of(block, i)))
                        .map(|corners| solid_angle(corners, point))
                        .sum::<f64>();
                }
                ChildKind::Spheres(_) | ChildKind::Empty => {}
            }
        }
        sum / (4.0 * PI)
    }
}

impl Dipole {
    fn of_triangles(all: &[[DVec3; 3]]) -> Self {
        let triangle = |[a, b, c]: &[DVec3; 3]| {
            let normal = (*b - *a).cross(*c - *a) * 0.5;
            Self { center: (*a + *b + *c) / 3.0, normal, area: normal.length(), ..Self::default() }
        };
        let dipole = Self::sum(&all.iter().map(triangle).collect::<Vec<_>>());
        let far = all.iter().flatten().map(|&v| (v - dipole.center).length());
        dipole.with_radius(far.fold(0.0, f64::max))
    }

    fn of_parts(parts: &[Self]) -> Self {
        let dipole = Self::sum(parts);
        let used = parts.iter().filter(|part| part.area > 0.0);
        let far = used.map(|part| (part.center - dipole.center).length() + part.radius);
        dipole.with_radius(far.fold(0.0, f64::max))
    }

    /// All but the radius.
    fn sum(parts: &[Self]) -> Self {
        let mut sum = Self::default();
        for part in parts {
            sum.normal += part.normal;
            sum.area += part.area;
            sum.center += part.center * part.area;
        }
        sum.center = if sum.area > 0.0 { sum.center / sum.area } else { DVec3::ZERO };
        for part in parts.iter().filter(|part| part.area > 0.0) {
            sum.moments.add(part.normal, part.center - sum.center);
            sum.moments.join(part.moments);
        }
        sum
    }

    fn with_radius(self, radius: f64) -> Self {
        Self { radius, near_squared: FAR * FAR * radius * radius, ..self }
    }
}

impl Moments {
    fn add(&mut self, n: DVec3, d: DVec3) {
        let (DVec3 { x, y, z }, [u, v, w]) = (d, n.to_array());
        let own = [x * u, y * v, z * w, x * v + y * u, x * w + z * u, y * w + z * v];
        self.join(Self(own));
    }

    fn join(&mut self, other: Self) {
        for (sum, own) in self.0.iter_mut().zip(other.0) {
            *sum += own;
        }
    }

    fn trace(&self) -> f64 {
        let [xx, yy, zz, ..] = self.0;
        xx + yy + zz
    }

    /// The quadratic form of a vector.
    fn along(&self, DVec3 { x, y, z }: DVec3) -> f64 {
        let [xx, yy, zz, xy, xz, yz] = self.0;
        x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + zz * z * z
    }
}

/// Returns the signed solid angle of a triangle seen from a point, in steradians. Positive if the
/// point is on the side from which the corners appear clockwise.
fn solid_angle(corners: [DVec3; 3], point: DVec3) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(below)
}
