//! Draws one of many lights for a shading point. The probability of a light is roughly proportional
//! to the light that the point receives from it if nothing occludes it.
//!
//! Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"
//! (HPG), without the splitting: a binary tree over the lights. A node bounds its lights by a
//! sphere, by the cone of the directions that they face, and by the sum of their colours. From the
//! root on, a child is chosen with a probability proportional to its bound. So the cost of a draw
//! is proportional to the depth of the tree. Where a bound is 0, no light of the node can reach the
//! point. Every light that can reach the point has a probability above 0. So the estimator is
//! unbiased.

use std::f32::consts::TAU;

use glam::Vec3;

use super::light::{Area, Emitter, Falloff, Light};
use super::points::{Lanes, ShadowPoints, lane};
use crate::ray::{LANES, Mask};

/// A cosine below this means below the horizon, even after rounding.
const HORIZON_COSINE: f32 = -1e-4;

/// Lower limit of both cosine factors of a bound: at the surface and at the light. It keeps the
/// probability of a light above 0 if rounding makes its cosine 0 or negative.
const MIN_COSINE_FACTOR: f32 = 1e-3;

/// The largest f64 below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// Bit that marks a child as the index of a light.
const LEAF: u32 = 1 << 31;

/// Largest half angle of a cone of normals, in radians; a wider one becomes all directions.
const WIDEST: f32 = 3.0;

/// Depth from which on nodes are split in the middle, so that the depth stays bounded.
const DEEP: u32 = 40;

/// Lights with a position, of which each shading point draws some. Lights without a position, such
/// as suns, are not drawn: every shading point receives light from all of them.
#[derive(Debug, Clone)]
pub struct LightTree {
    /// Number of lights that each shading point draws.
    pub samples: u32,
    /// Indices of the lights that are not drawn: lights beyond the scene, without a position.
    pub distant: Vec<u32>,
    nodes: Vec<Node>,
    falloff: Falloff,
    /// Square of the least distance: a nearer light counts as at this distance.
    least_square: f32,
}

/// A drawn light in each lane.
#[derive(Debug, Clone)]
pub struct DrawnLights {
    /// Lanes that drew a light. A lane draws none if the bounds of both children of a node are 0.
    pub lanes: Mask,
    /// Index of the light in the world.
    pub light: [u32; LANES],
    /// Probability with which it is drawn; > 0 in `lanes`.
    pub probability: Lanes,
}

#[derive(Debug, Clone)]
struct Node {
    bounds: [LightBounds; 2],
    /// Indices of nodes, or of lights with [`LEAF`].
    children: [u32; 2],
}

/// Number of values that bound some lights.
const BOUNDS: usize = 10;

/// Bounds of the light of some lights. First the middle and radius of a sphere that holds them.
/// Then the sum of the largest absolute channels of their colours, as a fraction of the whole
/// tree's. Then the cone of their normals: axis, cosine and sine. The cosine is -1 if a light
/// shines in all directions.
#[derive(Debug, Clone, Copy)]
struct LightBounds([f32; BOUNDS]);

#[derive(Debug, Clone, Copy)]
struct Facing {
    axis: Vec3,
    cosine: f32,
    sine: f32,
}

impl Facing {
    const ALL: Self = Self { axis: Vec3::ZERO, cosine: -1.0, sine: 0.0 };

    fn new(axis: Vec3, angle: f32) -> Self {
        Self { axis, cosine: angle.cos(), sine: angle.sin() }
    }

    fn angle(&self) -> f32 {
        self.sine.atan2(self.cosine)
    }

    /// Returns a small cone around both, a little wider against rounding; all directions if it is
    /// too wide.
    fn union(self, other: Self) -> Self {
        if self.cosine == -1.0 || other.cosine == -1.0 {
            return Self::ALL;
        }
        let (wide, narrow) =
            if self.cosine <= other.cosine { (self, other) } else { (other, self) };
        let between = wide.axis.dot(narrow.axis).clamp(-1.0, 1.0).acos();
        let (a, b) = (wide.angle(), narrow.angle());
        if between + b <= a {
            return wide;
        }
        let angle = (a + between + b) / 2.0 + 1e-5;
        let turn = wide.axis.cross(narrow.axis);
        if turn.length_squared() < 1e-12 && between < 1.0 {
            return Self::new(wide.axis, a.max(between + b) + 1e-5);
        }
        if angle >= WIDEST || turn.length_squared() < 1e-12 {
            return Self::ALL;
        }
        let axis = glam::Quat::from_axis_angle(turn.normalize(), angle - a) * wide.axis;
        Self::new(axis.normalize(), angle)
    }
}

/// A light while the tree is built.
#[derive(Debug, Clone, Copy)]
struct Item {
    index: u32,
    low: Vec3,
    high: Vec3,
    power: f32,
    facing: Facing,
}

impl Item {
    fn new(index: u32, light: &Light) -> Option<Self> {
        // A negative colour takes light away, and has to be drawn as often.
        let power = light.diffuse.abs().max_element() + light.specular.abs().max_element();
        let (low, high, facing) = match &light.emitter {
            Emitter::Point(position) => (*position, *position, Facing::ALL),
            Emitter::Area(area) => {
                let ends = [area.corner, area.corner + area.edge + area.height];
                let sides = [area.corner + area.edge, area.corner + area.height];
                let all = ends.into_iter().chain(sides);
                let (low, high) = all
                    .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
                (low, high, area.normal.map_or(Facing::ALL, |normal| Facing::new(normal, 1e-4)))
            }
        };
        (!is_beyond(light)).then_some(Self { index, low, high, power, facing })
    }

    fn union(self, other: Self) -> Self {
        Self {
            index: self.index,
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            power: self.power + other.power,
            facing: self.facing.union(other.facing),
        }
    }

    fn middle(&self) -> Vec3 {
        self.low * 0.5 + self.high * 0.5
    }

    fn bounds(&self, whole: f32) -> LightBounds {
        let rounding = 4.0 * f32::EPSILON * self.low.abs().max(self.high.abs()).max_element();
        let radius = self.low.distance(self.high) / 2.0;
        // A point needs no slack: `bound` and the shadow rays compute the same difference, light
        // minus shading point, so both see the same direction.
        let radius = if radius > 0.0 { radius + rounding } else { 0.0 };
        let (middle, Facing { axis, cosine, sine }) = (self.middle(), self.facing);
        let power = self.power / whole;
        let [x, y, z] = middle.to_array();
        LightBounds([x, y, z, radius, power, axis.x, axis.y, axis.z, cosine, sine])
    }

    /// Cost of a node in the surface area orientation heuristic, sections 4.3 and 4.4. In place of
    /// the box's surface area: its squared diagonal plus `min_size_squared`, which is above 0 for
    /// lights on a line or at one place.
    fn cost(&self, min_size_squared: f32) -> f32 {
        let Facing { cosine, sine, .. } = self.facing;
        let angle = self.facing.angle();
        let most = (angle + TAU / 4.0).min(TAU / 2.0);
        let orientation = TAU * (1.0 - cosine)
            + TAU / 4.0
                * (2.0 * most * sine - (angle - 2.0 * most).cos() - 2.0 * angle * sine + cosine);
        self.power * (self.low.distance_squared(self.high) + min_size_squared) * orientation
    }
}

fn is_beyond(light: &Light) -> bool {
    matches!(&light.emitter, Emitter::Area(Area { distant: Some(_), .. }))
}

impl LightTree {
    /// A tree over the lights with a position, of which each shading point draws `samples`. `None`
    /// if at most max(`samples`, 1) lights have a position: then nothing is drawn, and every
    /// shading point receives light from all lights.
    pub fn new(lights: &[Light], samples: u32, falloff: Falloff) -> Option<Self> {
        let mut items: Vec<Item> =
            lights.iter().zip(0..).filter_map(|(light, index)| Item::new(index, light)).collect();
        if items.len() as u64 <= u64::from(samples).max(1) {
            return None;
        }
        let distant = (0..).zip(lights).filter(|(_, light)| is_beyond(light));
        let distant = distant.map(|(index, _)| index).collect();
        let whole = items.iter().skip(1).fold(items[0], |all, item| all.union(*item));
        let size = whole.low.distance_squared(whole.high);
        let mut tree = Self {
            samples,
            distant,
            nodes: Vec::with_capacity(items.len()),
            falloff,
            least_square: (1e-12 * size).max(f32::MIN_POSITIVE),
        };
        let power = if whole.power > 0.0 { whole.power } else { 1.0 };
        tree.build(&mut items, (power, size * 1e-6), 0);
        Some(tree)
    }

    /// Adds the node of at least two items, and all nodes below it. Returns its index.
    fn build(
        &mut self,
        items: &mut [Item],
        (whole, min_size_squared): (f32, f32),
        depth: u32,
    ) -> u32 {
        let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (low, high) = items
            .iter()
            .map(Item::middle)
            .fold(none, |(low, high), middle| (low.min(middle), high.max(middle)));
        let sides = high - low;
        let axis = (0..3).fold(0, |best, axis| if sides[axis] > sides[best] { axis } else { best });
        items.sort_by(|a, b| {
            a.middle()[axis].total_cmp(&b.middle()[axis]).then(a.index.cmp(&b.index))
        });
        let half = items.len() / 2;
        let split = if depth < DEEP {
            cheapest_split(items, min_size_squared).unwrap_or(half)
        } else {
            half
        };
        let index = self.nodes.len() as u32;
        let (left, right) = items.split_at_mut(split);
        let all = |items: &[Item]| items[1..].iter().fold(items[0], |all, item| all.union(*item));
        let bounds = [all(left), all(right)].map(|item| item.bounds(whole));
        self.nodes.push(Node { bounds, children: [0; 2] });
        for (child, items) in [left, right].into_iter().enumerate() {
            self.nodes[index as usize].children[child] = match items {
                [item] => item.index | LEAF,
                items => self.build(items, (whole, min_size_squared), depth + 1),
            };
        }
        index
    }

    /// Draws a light for every point that hits a surface. `uniform`: a number in [0, 1) for each
    /// lane.
    #[inline(always)]
    pub fn draw(&self, mut uniform: [f64; LANES], from: &ShadowPoints) -> DrawnLights {
        let mut at = [0u32; LANES];
        let mut probability = [1.0f64; LANES];
        let mut drawn = DrawnLights { lanes: Mask::NONE, light: at, probability: [0.0; LANES] };
        let mut open = from.hit;
        while open.any() {
            // Lanes that are done read the root again.
            let mut bounds = [[[0.0; LANES]; BOUNDS]; 2];
            for i in 0..LANES {
                let node = &self.nodes[at[i] as usize].bounds;
                for value in 0..BOUNDS {
                    bounds[0][value][i] = node[0].0[value];
                    bounds[1][value][i] = node[1].0[value];
                }
            }
            let a = self.bound(&bounds[0], from);
            let b = self.bound(&bounds[1], from);
            let mut second = [0; LANES];
            for i in 0..LANES {
                let sum = f64::from(a[i]) + f64::from(b[i]);
                let first = if sum > 0.0 { f64::from(a[i]) / sum } else { 1.0 };
                let right = uniform[i] >= first;
                let part = if right { 1.0 - first } else { first };
                let rest = if right { uniform[i] - first } else { uniform[i] };
                uniform[i] = (rest / part).min(BELOW_ONE);
                probability[i] *= if sum > 0.0 { part } else { 0.0 };
                second[i] = usize::from(right);
            }
            for i in 0..LANES {
                if open.0[i] == 0 {
                    continue;
                }
                let child = self.nodes[at[i] as usize].children[second[i] % 2];
                let (found, none) = (child & LEAF != 0, probability[i] == 0.0);
                if found && !none {
                    drawn.lanes.0[i] = -1;
                    drawn.light[i] = child ^ LEAF;
                    drawn.probability[i] = (probability[i] as f32).max(f32::MIN_POSITIVE);
                }
                let done = found || none;
                (open.0[i], at[i]) = if done { (0, 0) } else { (-1, child) };
            }
        }
        drawn
    }

    /// Bounds of the light that points receive, up to a factor.
    #[inline(always)]
    fn bound(&self, lights: &[Lanes; BOUNDS], from: &ShadowPoints) -> Lanes {
        let [x, y, z, radius, power, ax, ay, az, spread, spread_sine] = lights;
        let linear = self.falloff == Falloff::Linear;
        let quadratic = self.falloff == Falloff::Quadratic;
        let mut bound = [0.0; LANES];
        for i in 0..LANES {
            let way = Vec3::new(x[i], y[i], z[i]) - lane(&from.position, i);
            let (square, radius_squared) = (way.dot(way), radius[i] * radius[i]);
            let outside = square > radius_squared;
            let inverse = if outside { 1.0 / square.sqrt() } else { 0.0 };
            let sine = radius[i] * inverse;
            let cosine = (1.0 - sine * sine).max(0.0).sqrt();
            let horizon = cos_of_difference(lane(&from.n, i).dot(way) * inverse, cosine, sine);
            let axis = Vec3::new(ax[i], ay[i], az[i]);
            let emission = cos_of_difference(-axis.dot(way) * inverse, cosine, sine);
            let emission = cos_of_difference(emission, spread[i], spread_sine[i]);
            let reached = !outside | ((horizon > HORIZON_COSINE) & (emission > HORIZON_COSINE));
            let square = square.max(radius_squared).max(self.least_square);
            let divided = if quadratic { 1.0 / square } else { 1.0 };
            let falloff = if linear { 1.0 / square.sqrt() } else { divided };
            let factor = if outside {
                horizon.max(MIN_COSINE_FACTOR) * emission.max(MIN_COSINE_FACTOR)
            } else {
                1.0
            };
            bound[i] = if reached { power[i] * factor * falloff } else { 0.0 };
        }
        bound
    }
}

/// Returns cos(max(0, a - b)). `c` is the cosine of a; `cosine` and `sine` are those of b.
#[inline(always)]
fn cos_of_difference(c: f32, cosine: f32, sine: f32) -> f32 {
    let left = c * cosine + (1.0 - c * c).max(0.0).sqrt() * sine;
    if c >= cosine { 1.0 } else { left }
}

/// Returns where to split sorted items so that the sum of the costs is least. `None` if no cost is
/// above 0.
fn cheapest_split(items: &[Item], min_size_squared: f32) -> Option<usize> {
    let mut right = vec![0.0; items.len()];
    let last = items.len() - 1;
    let mut all = items[last];
    for i in (1..items.len()).rev() {
        all = if i < last { all.union(items[i]) } else { all };
        right[i] = all.cost(min_size_squared);
    }
    let (mut best, mut split) = (f32::INFINITY, None);
    let mut all = items[0];
    for i in 1..items.len() {
        let cost = all.cost(min_size_squared) + right[i];
        if cost < best && cost > 0.0 {
            (best, split) = (cost, Some(i));
        }
        all = all.union(items[i]);
    }
    split
}

#[cfg(test)]
mod tests {
    use super::super::points::set_lane;
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    /// A point light, or a rectangle that shines to one side or to both.
    fn light(kind: u8, at: Vec3, side: Vec3, other: Vec3, color: f32) -> Light {
        let emitter = match kind {
            0 => Emitter::Point(at),
            _ => {
                let (side, other): (DVec3, DVec3) = (side.as_dvec3(), other.as_dvec3());
                let height = other - side * (other.dot(side) / side.length_squared());
                Emitter::Area(Area::new(at, side, height, kind == 1, 1))
            }
        };
        Light { diffuse: Vec3::splat(color), specular: Vec3::ZERO, emitter }
    }

    /// A surface point in lane 0.
    fn point(position: Vec3, n: Vec3) -> ShadowPoints {
        let mut from = ShadowPoints::EMPTY;
        from.hit.0[0] = -1;
        set_lane(&mut from.position, 0, position);
        set_lane(&mut from.n, 0, n);
        from
    }

    /// The light that a number draws, and its probability.
    fn draw(tree: &LightTree, uniform: f64, position: Vec3, n: Vec3) -> Option<(usize, f32)> {
        let drawn = tree.draw([uniform; LANES], &point(position, n));
        (drawn.lanes.0[0] != 0).then_some((drawn.light[0] as usize, drawn.probability[0]))
    }

    /// Probability of every light, from the bounds along its way through the tree.
    fn probabilities(tree: &LightTree, lights: usize, position: Vec3, n: Vec3) -> Vec<f64> {
        let mut all = vec![0.0; lights];
        let mut open = vec![(0, 1.0)];
        while let Some((at, probability)) = open.pop() {
            let Node { bounds, children } = &tree.nodes[at as usize];
            let from = point(position, n);
            let bound = |child: usize| tree.bound(&bounds[child].0.map(|v| [v; LANES]), &from)[0];
            let parts = [0, 1].map(|child| f64::from(bound(child)));
            for (child, part) in children.iter().zip(parts) {
                let probability: f64 = probability * part / parts.iter().sum::<f64>().max(1e-300);
                match child & LEAF {
                    0 => open.push((*child, probability)),
                    _ => all[(child ^ LEAF) as usize] = probability,
                }
            }
        }
        all
    }

    /// Whether any point of the light shines on the surface.
    fn reaches(light: &Light, position: Vec3, n: Vec3) -> bool {
        let shines = |q: Vec3, normal: Option<Vec3>| {
            let l = (q - position).as_dvec3().normalize();
            let sent = normal.map_or(1.0, |normal| -l.dot(normal.as_dvec3()));
            l.dot(n.as_dvec3()) > 1e-3 && sent > 1e-3
        };
        match &light.emitter {
            Emitter::Point(q) => shines(*q, None),
            Emitter::Area(area) => (0..36).any(|k| {
                let [s, t] = [k % 6, k / 6].map(|k| k as f32 / 5.0);
                shines(area.corner + area.edge * s + area.height * t, area.normal)
            }),
        }
    }

    fn vector(range: std::ops::Range<f32>) -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(range).prop_map(Vec3::from)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn every_light_that_reaches_a_point_may_be_drawn(
            given in prop::collection::vec(
                (0..3u8, vector(-3.0..3.0), vector(0.1..1.0), vector(-1.0..-0.1), 0.1..9f32), 2..40),
            position in vector(-3.0..3.0),
            n in vector(-1.0..1.0),
            falloff in prop::sample::select(vec![Falloff::None, Falloff::Linear, Falloff::Quadratic]),
        ) {
            prop_assume!(n.length() > 0.1);
            let n = n.normalize();
            let lights: Vec<Light> =
                given.iter().map(|&(kind, at, side, other, color)| {
                    let flat = side.cross(other).length() < 0.05;
                    let other = if flat { Vec3::new(other.y, other.z, -other.x) } else { other };
                    light(kind, at, side, other, color)
                }).collect();
            let tree = LightTree::new(&lights, 1, falloff).unwrap();
            let all = probabilities(&tree, lights.len(), position, n);
            for (light, probability) in lights.iter().zip(&all) {
                prop_assert!(*probability > 0.0 || !reaches(light, position, n), "{light:?}");
            }
            // The bound of a node may reach the point although those of its children do not: then
            // no light is drawn.
            let none = 1.0 - all.iter().sum::<f64>();
            prop_assert!((-1e-5..=1.0).contains(&none), "{none}");
            let draws = 4000;
            let (mut found, mut missed) = (vec![0u32; lights.len()], 0);
            for k in 0..draws {
                match draw(&tree, (f64::from(k) + 0.5) / f64::from(draws), position, n) {
                    Some((index, probability)) => {
                        let expected = all[index];
                        prop_assert!((f64::from(probability) - expected).abs() <= 1e-5 * expected);
                        found[index] += 1;
                    }
                    None => missed += 1,
                }
            }
            // In each interval an even grid has its share of the numbers, except at the ends.
            for (found, probability) in found.iter().zip(&all) {
                let off = f64::from(*found) - probability * f64::from(draws);
                prop_assert!(off.abs() <= 2.0, "{found} {probability}");
            }
            let off = f64::from(missed) - none * f64::from(draws);
            prop_assert!(off.abs() <= 2.0 * lights.len() as f64, "{missed} {none}");
        }
    }

    #[test]
    fn a_tree_is_made_only_where_it_draws_fewer_lights_than_there_are() {
        let lights: Vec<Light> =
            (0..4).map(|i| light(0, Vec3::X * i as f32, Vec3::X, Vec3::Y, 1.0)).collect();
        for (samples, made) in [(1, true), (3, true), (4, false), (9, false)] {
            assert_eq!(LightTree::new(&lights, samples, Falloff::None).is_some(), made);
        }
    }

    #[test]
    fn lights_at_one_place_and_black_lights_are_no_trouble() {
        let lights: Vec<Light> =
            (0..300).map(|i| light(0, Vec3::ONE, Vec3::X, Vec3::Y, (i % 3) as f32)).collect();
        let tree = LightTree::new(&lights, 1, Falloff::Quadratic).unwrap();
        let all = probabilities(&tree, lights.len(), Vec3::ZERO, Vec3::Y);
        for (i, probability) in all.iter().enumerate() {
            assert!((probability - (i % 3) as f64 / 300.0).abs() < 1e-6, "{i} {probability}");
        }
        // At the place itself no bound is infinite.
        assert!(draw(&tree, 0.5, Vec3::ONE, Vec3::Y).is_some());
        let black: Vec<Light> =
            (0..3).map(|_| light(0, Vec3::ONE, Vec3::X, Vec3::Y, 0.0)).collect();
        let tree = LightTree::new(&black, 1, Falloff::Linear).unwrap();
        assert_eq!(draw(&tree, 0.5, Vec3::ZERO, Vec3::Y), None);
    }

    #[test]
    fn a_near_light_is_drawn_more_often_than_a_far_one() {
        let at = [Vec3::Y, Vec3::Y * 10.0];
        let lights = at.map(|at| light(0, at, Vec3::X, Vec3::Y, 1.0));
        for (falloff, expected) in [
            (Falloff::None, 0.5),
            (Falloff::Linear, 10.0 / 11.0),
            (Falloff::Quadratic, 100.0 / 101.0),
        ] {
            let tree = LightTree::new(&lights, 1, falloff).unwrap();
            let (index, probability) = draw(&tree, 0.0, Vec3::ZERO, Vec3::Y).unwrap();
            assert!(index == 0 && (probability - expected).abs() < 1e-6, "{probability}");
        }
    }
}
