//! Random nodes, leaves and rays, many of them degenerate.

use crate::accel::bvh::bounds::Bounds3;
use crate::accel::bvh::node::{Block, Child, Node, WIDTH};
use crate::accel::bvh::query::Query;
use crate::ray::{LANES, Rays};

/// Pseudo-random numbers: a 64-bit linear congruential generator with constants of Steele and
/// Vigna.
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1);
        (self.0 >> 33) as usize % n
    }

    /// Returns a number in [-1, 1).
    pub fn unit(&mut self) -> f32 {
        self.below(1 << 24) as f32 / (1 << 23) as f32 - 1.0
    }

    pub fn point(&mut self) -> [f32; 3] {
        std::array::from_fn(|_| self.unit())
    }

    /// Returns a point with few distinct coordinates, so that rays hit edges and vertices and lie
    /// in planes.
    pub fn grid_point(&mut self) -> [f32; 3] {
        std::array::from_fn(|_| self.below(5) as f32 - 2.0)
    }
}

/// Returns random points of any magnitude, on a grid or anywhere.
fn points(random: &mut Random) -> Vec<[f32; 3]> {
    let magnitude = [1.0, 1.0, 1e-3, 1e6, 1e-30, 1e18][random.below(6)];
    let grid = random.below(2) == 0;
    let point = |random: &mut Random| if grid { random.grid_point() } else { random.point() };
    (0..WIDTH).map(|_| point(random).map(|x| x * magnitude)).collect()
}

/// Returns a leaf over 16 points.
fn block(random: &mut Random, points: &[[f32; 3]]) -> Block {
    let mut block = Block::EMPTY;
    for (i, point) in points.iter().enumerate() {
        for axis in 0..3 {
            block.vertices[axis][i] = point[axis];
        }
    }
    for i in 0..1 + random.below(WIDTH) {
        for k in 0..3 {
            block.set_corner(k, i, random.below(WIDTH) as u8);
        }
        if random.below(3) == 0 {
            block.second_halves |= 1 << i;
        }
        block.offsets[i] = i as u16;
        block.present |= 1 << i;
    }
    block
}

/// Returns a node whose boxes have corners among the points.
fn node(random: &mut Random, points: &[[f32; 3]]) -> Node {
    let mut node = Node::EMPTY;
    for i in 0..1 + random.below(WIDTH) {
        let (p, q) = (points[random.below(WIDTH)], points[random.below(WIDTH)]);
        for axis in 0..3 {
            node.planes[axis][i] = p[axis].min(q[axis]);
            node.planes[axis + 3][i] = p[axis].max(q[axis]);
        }
        node.children[i] = Child::triangles(i);
    }
    for octant in 0..8 {
        let mut order: [u8; WIDTH] = std::array::from_fn(|i| i as u8);
        for i in (1..WIDTH).rev() {
            order.swap(i, random.below(i + 1));
        }
        node.set_order(octant, &order);
    }
    node
}

/// Returns rays from random origins: towards points, towards means of points, and along axes.
fn rays(random: &mut Random, points: &[[f32; 3]]) -> Rays {
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        let reach = points.iter().flatten().fold(0.0f32, |m, x| m.max(x.abs())).max(1e-30);
        let from = if random.below(4) == 0 {
            points[random.below(WIDTH)]
        } else {
            random.grid_point().map(|x| x * reach)
        };
        let (a, b, c) =
            (points[random.below(WIDTH)], points[random.below(WIDTH)], points[random.below(WIDTH)]);
        let target = match random.below(3) {
            0 => a,
            1 => std::array::from_fn(|k| 0.5 * (a[k] + b[k])),
            _ => std::array::from_fn(|k| 0.25 * a[k] + 0.25 * b[k] + 0.5 * c[k]),
        };
        let mut direction: [f32; 3] = std::array::from_fn(|k| target[k] - from[k]);
        if random.below(4) == 0 || direction.iter().all(|d| d.abs() < 1e-33) {
            direction = [0.0, -0.0, 0.0];
            direction[random.below(3)] = if random.below(2) == 0 { 1.0 } else { -3.0 };
        }
        for axis in 0..3 {
            rays.org[axis][i] = from[axis];
            rays.dir[axis][i] = direction[axis];
        }
        if random.below(3) == 0 {
            rays.tfar[i] = 1.0;
        }
    }
    rays
}

/// Calls `look` with `n` random cases of a node, a leaf and rays.
pub fn cases(n: usize, mut look: impl FnMut(&mut Random, &Node, &Block, &Rays, &Query)) {
    let mut random = Random(7);
    for _ in 0..n {
        let points = points(&mut random);
        let (node, block) = (node(&mut random, &points), block(&mut random, &points));
        let rays = rays(&mut random, &points);
        let query = Query::new(&rays, &Bounds3::from_points(&points));
        look(&mut random, &node, &block, &rays, &query);
    }
}
