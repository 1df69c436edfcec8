//! A plain median-split box tree, so that a mesh of thousands of triangles does not make the tests
//! slow. It only decides which triangles are tested.

use super::geometry::Ray;
use glam::DVec3;

/// Triangles per leaf at which splitting stops.
const LEAF: usize = 4;

/// A box around some triangles.
pub struct Tree {
    low: DVec3,
    high: DVec3,
    kind: Kind,
}

enum Kind {
    Leaf(Vec<usize>),
    Split(Box<[Tree; 2]>),
}

impl Tree {
    /// Sorts the triangles by centroid along the box's longest side and halves the list.
    pub fn build(corners: &dyn Fn(usize) -> [DVec3; 3], mut parts: Vec<usize>) -> Tree {
        let mut low = DVec3::INFINITY;
        let mut high = DVec3::NEG_INFINITY;
        for corner in parts.iter().flat_map(|p| corners(*p)) {
            low = low.min(corner);
            high = high.max(corner);
        }
        if parts.len() <= LEAF {
            return Tree { low, high, kind: Kind::Leaf(parts) };
        }
        let size = high - low;
        let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).expect("three axes");
        let key = |part: usize| corners(part).iter().map(|v| v[axis]).sum::<f64>();
        parts.sort_by(|a, b| key(*a).total_cmp(&key(*b)));
        let rest = parts.split_off(parts.len() / 2);
        let halves = [Tree::build(corners, parts), Tree::build(corners, rest)];
        Tree { low, high, kind: Kind::Split(Box::new(halves)) }
    }

    /// Calls `visit` for every triangle whose box the ray may touch.
    pub fn visit(&self, ray: &Ray, visit: &mut dyn FnMut(usize)) {
        if !self.touched(ray) {
            return;
        }
        match &self.kind {
            Kind::Leaf(parts) => parts.iter().for_each(|p| visit(*p)),
            Kind::Split(halves) => halves.iter().for_each(|half| half.visit(ray, visit)),
        }
    }

    /// The slab test, slightly widened: a box entered by mistake costs time, never a hit.
    fn touched(&self, ray: &Ray) -> bool {
        let widen = 1e-9 * (self.high - self.low).length() + 1e-12;
        let (mut enter, mut leave) = (0.0, f64::INFINITY);
        for axis in 0..3 {
            let to_low = self.low[axis] - widen - ray.origin[axis];
            let to_high = self.high[axis] + widen - ray.origin[axis];
            let (a, b) = (to_low / ray.direction[axis], to_high / ray.direction[axis]);
            // `min` and `max` of f64 skip a NaN (0/0), so it never excludes the box.
            enter = f64::max(enter, a.min(b));
            leave = f64::min(leave, a.max(b));
        }
        enter <= leave
    }
}
