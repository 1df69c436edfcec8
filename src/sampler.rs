//! Sample points: every number a function of (seed, pixel, sample, purpose).
//!
//! Owen-scrambled Sobol, and beside it the coursework's independent points, as the baseline of reports.
//!
//! Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4), by the crate `sobol_burley`.
//! Each purpose (pixel and lens; one per light and bounce) is a set of its own, scrambled and
//! shuffled by its own seed and using the lowest dimensions, which are the best distributed.
//! Where two dimensions are enough, [`Points`] computes these alone, with the same bits and in a
//! fraction of the time.

use sobol_burley::parts::{hash, owen_scramble_rev, u32_to_f32_norm};

/// Longest sequence of the Sobol tables; longer ones continue with a new scramble.
const SEQUENCE: u32 = 1 << 16;

/// In place of the number of a Sobol sequence, of which there are fewer.
const INDEPENDENT: u32 = u32::MAX;

/// How the points of a set are chosen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Kind {
    /// Owen-scrambled Sobol: stratified.
    #[default]
    Sobol,
    /// Each uniform in the square and independent of all others.
    Random,
}

impl Kind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Sobol, Self::Random];

    /// As the scene format spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sobol => "sobol",
            Self::Random => "random",
        }
    }
}

/// Source of all sample points of a render.
#[derive(Debug, Clone, Copy)]
pub struct Sampler {
    seed: u64,
    kind: Kind,
}

impl Sampler {
    /// A sampler for the scene's seed.
    pub fn new(seed: i64) -> Self {
        Self::of(Kind::Sobol, seed)
    }

    /// The same of a kind.
    pub fn of(kind: Kind, seed: i64) -> Self {
        // The bits are what matters; a negative seed is as good as any.
        Self { seed: u64::from_ne_bytes(seed.to_ne_bytes()), kind }
    }

    /// Pixel offset x, y and lens coordinates, all in [0, 1), of camera sample `index`.
    pub fn camera(&self, pixel: [u32; 2], index: u32) -> [f32; 4] {
        self.point(pixel, index, 0)
    }

    /// The pixel offsets alone, of all camera samples of a pixel.
    #[inline(always)]
    pub fn pixel_points(&self, pixel: [u32; 2]) -> Points {
        Points::new(*self, pixel, 0)
    }

    /// Points in the unit square for all samples that the pixel takes of light `light` after `bounce`
    /// mirror bounces.
    #[inline(always)]
    pub fn light_points(&self, pixel: [u32; 2], light: u32, bounce: u32) -> Points {
        Points::new(*self, pixel, 1 + ((u64::from(bounce) << 32) | u64::from(light)))
    }

    /// A number in [0, 1) for a decision about camera sample `index` and light `light` after `bounce`
    /// mirror bounces, independent of all points.
    pub fn choice(&self, pixel: [u32; 2], index: u32, light: u32, bounce: u32) -> f32 {
        let purpose = (1 << 63) | (u64::from(bounce) << 32) | u64::from(light);
        u32_to_f32_norm(self.seed_of(pixel, index, purpose))
    }

    /// Number `index` of [`Sampler::light_points`].
    pub fn light(&self, pixel: [u32; 2], index: u32, light: u32, bounce: u32) -> [f32; 2] {
        self.light_points(pixel, light, bounce).at(index)
    }

    fn point(&self, pixel: [u32; 2], index: u32, purpose: u64) -> [f32; 4] {
        if self.kind == Kind::Random {
            let [x, y] = Points::new(*self, pixel, purpose).independent(index);
            let [s, t] = Points::new(*self, pixel, !purpose).independent(index);
            return [x, y, s, t];
        }
        let seed = self.seed_of(pixel, index / SEQUENCE, purpose);
        sobol_burley::sample_4d(index % SEQUENCE, 0, seed)
    }

    #[inline(always)]
    fn seed_of(&self, pixel: [u32; 2], block: u32, purpose: u64) -> u32 {
        self.key(pixel, block, purpose) as u32
    }

    #[inline(always)]
    fn key(&self, [x, y]: [u32; 2], block: u32, purpose: u64) -> u64 {
        let pixel = (u64::from(y) << 32) | u64::from(x);
        mix(mix(mix(self.seed ^ mix(u64::from(block))) ^ pixel) ^ purpose)
    }
}

/// Where the points of a set come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    /// The set's own Sobol sequence.
    Own,
    /// The camera's dimensions 2 and 3.
    Joint,
    /// Each from a hash of its number.
    Independent,
}

/// The sequence of one pixel and purpose in its first two dimensions.
#[derive(Debug, Clone, Copy)]
pub struct Points {
    sampler: Sampler,
    /// Whose points these are.
    pub pixel: [u32; 2],
    purpose: u64,
    way: Way,
    /// Which `SEQUENCE` indices the rest is made for.
    block: u32,
    shuffle: u32,
    scramble: [u32; 2],
}

impl Points {
    #[inline(always)]
    fn new(sampler: Sampler, pixel: [u32; 2], purpose: u64) -> Self {
        let way = if sampler.kind == Kind::Random { Way::Independent } else { Way::Own };
        let mut points =
            Self { sampler, pixel, purpose, way, block: 0, shuffle: 0, scramble: [0; 2] };
        points.begin(0);
        points
    }

    /// The same points of another pixel.
    #[inline(always)]
    pub fn of(&self, pixel: [u32; 2]) -> Self {
        Self { way: self.way, ..Self::new(self.sampler, pixel, self.purpose) }
    }

    #[inline(always)]
    fn begin(&mut self, block: u32) {
        self.block = block;
        let seed = self.sampler.seed_of(self.pixel, block, self.purpose);
        // The constants by which `sobol_burley` tells the shuffle and the dimensions apart.
        let own = seed.wrapping_mul(0x9c8f_2d3b);
        self.shuffle = hash(seed ^ 0x79c6_8e4a);
        self.scramble = [hash(own ^ 0x912f_69ba), hash(own ^ 0x174f_18ab)];
    }

    /// Point `index`, both coordinates in [0, 1).
    #[inline(always)]
    pub fn at(&mut self, index: u32) -> [f32; 2] {
        if self.way != Way::Own {
            return self.elsewhere(index);
        }
        if index / SEQUENCE != self.block {
            self.begin(index / SEQUENCE);
        }
        // In reverse order of its bits, Sobol's first dimension is the index itself.
        let reversed = (index % SEQUENCE).reverse_bits();
        let first = owen_scramble_rev(reversed, self.shuffle).reverse_bits() % SEQUENCE;
        [coordinate(first, self.scramble[0]), coordinate(pascal(first), self.scramble[1])]
    }
}

impl Points {
    /// In their place dimensions 2 and 3 of the camera's own sequence, which a pinhole camera leaves: point
    /// `index` is then stratified together with the pixel offset of camera sample `index`. Independent points
    /// stay so.
    #[inline(always)]
    pub fn joint(self) -> Self {
        let way = if self.way == Way::Own { Way::Joint } else { self.way };
        Self { way, ..self }
    }

    #[inline(never)]
    fn elsewhere(&self, index: u32) -> [f32; 2] {
        if self.way == Way::Independent {
            return self.independent(index);
        }
        let [_, _, s, t] = self.sampler.point(self.pixel, index, 0);
        [s, t]
    }

    /// Independent point `index`: an output of the generator SplitMix64 that starts at the set's key.
    #[inline(always)]
    fn independent(&self, index: u32) -> [f32; 2] {
        let key = self.sampler.key(self.pixel, INDEPENDENT, self.purpose);
        let bits = mix(key.wrapping_add(u64::from(index).wrapping_mul(GOLDEN)));
        [bits as u32, (bits >> 32) as u32].map(u32_to_f32_norm)
    }
}

#[inline(always)]
fn coordinate(reversed: u32, scramble: u32) -> f32 {
    u32_to_f32_norm(owen_scramble_rev(reversed, scramble).reverse_bits())
}

/// Sobol's second dimension, whose matrix is Pascal's triangle modulo 2: bit i of the result is the sum
/// of all bits j of the index with i & j = i. For 16 bits.
#[inline(always)]
fn pascal(index: u32) -> u32 {
    let sum = index ^ ((index >> 1) & 0x5555);
    let sum = sum ^ ((sum >> 2) & 0x3333);
    let sum = sum ^ ((sum >> 4) & 0x0f0f);
    sum ^ ((sum >> 8) & 0x00ff)
}

/// SplitMix64's step (Steele, Lea, Flood 2014).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's finaliser, one step on.
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(GOLDEN);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Maps the unit square to the unit disk (Shirley and Chiu 1997, concentric).
#[inline(always)]
pub fn disk([s, t]: [f32; 2]) -> [f32; 2] {
    let (x, y) = (2.0 * s - 1.0, 2.0 * t - 1.0);
    if x == 0.0 && y == 0.0 {
        return [0.0, 0.0];
    }
    let quarter = std::f32::consts::FRAC_PI_4;
    let (r, phi) = if x.abs() > y.abs() {
        (x, quarter * (y / x))
    } else {
        (y, 2.0 * quarter - quarter * (x / y))
    };
    [r * phi.cos(), r * phi.sin()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_a_function_of_their_keys_alone() {
        let sampler = Sampler::new(7);
        assert_eq!(sampler.camera([3, 4], 5), sampler.camera([3, 4], 5));
        assert_ne!(sampler.camera([3, 4], 5), sampler.camera([4, 3], 5));
        assert_ne!(sampler.camera([3, 4], 5), Sampler::new(8).camera([3, 4], 5));
        assert_ne!(sampler.light([3, 4], 5, 0, 0), sampler.light([3, 4], 5, 1, 0));
        assert_ne!(sampler.light([3, 4], 5, 0, 0), sampler.light([3, 4], 5, 0, 1));
        assert_ne!(sampler.camera([0, 0], 1), sampler.camera([0, 0], 1 + SEQUENCE));
    }

    #[test]
    fn two_dimensions_are_the_first_two_of_four_to_the_bit() {
        for seed in 0..40 {
            let sampler = Sampler::new(seed);
            let mut offsets = sampler.pixel_points([seed as u32, 9]);
            let mut light = sampler.light_points([7, seed as u32], 3, 2);
            // Over all seeds every index is met, and two more sequences are begun.
            for index in (seed as u32 * 37..3 * SEQUENCE).step_by(40) {
                let [x, y, _, _] = sampler.camera([seed as u32, 9], index);
                assert_eq!(offsets.at(index), [x, y]);
                let [x, y, _, _] = sampler.point([7, seed as u32], index, 1 + (2 << 32 | 3));
                assert_eq!(light.at(index), [x, y]);
            }
        }
    }

    #[test]
    fn independent_points_are_uniform_and_unrelated() {
        let (mut cells, mut products) = ([0u32; 16], [0.0f64; 6]);
        let n = 1 << 16;
        for i in 0..n {
            // Over pixels and over samples.
            let sampler = Sampler::of(Kind::Random, 5);
            let pixel = [i >> 8, 3];
            let [x, y, s, t] = sampler.camera(pixel, i & 255);
            let mut offsets = sampler.pixel_points(pixel);
            assert_eq!(offsets.at(i & 255), [x, y]);
            let [u, v] = sampler.light(pixel, i & 255, 0, 0);
            cells[(u * 4.0) as usize * 4 + (v * 4.0) as usize] += 1;
            let [next, _] = offsets.at((i & 255) + 1);
            let pairs = [(x, y), (x, s), (s, t), (x, u), (u, v), (x, next)];
            for (product, (a, b)) in products.iter_mut().zip(pairs) {
                *product += (f64::from(a) - 0.5) * (f64::from(b) - 0.5);
            }
        }
        // Chi-square with 15 degrees of freedom: above 37.7 once in 1000 seeds. It must not be as even as
        // stratified points either: below 3.5 once in 1000.
        let each = f64::from(n) / 16.0;
        let chi: f64 = cells.iter().map(|&c| (f64::from(c) - each).powi(2) / each).sum();
        assert!((3.5..37.7).contains(&chi), "{chi}");
        // Correlations of n pairs: the standard error is 1 / sqrt(n) = 0.004.
        for product in products {
            assert!((product * 12.0 / f64::from(n)).abs() < 0.015, "{products:?}");
        }
    }

    #[test]
    fn independent_points_differ_by_all_their_keys() {
        let of = |seed, pixel, index, light, bounce| {
            Sampler::of(Kind::Random, seed).light(pixel, index, light, bounce)
        };
        let one = of(7, [3, 4], 5, 0, 0);
        assert_eq!(one, of(7, [3, 4], 5, 0, 0));
        for other in [
            of(8, [3, 4], 5, 0, 0),
            of(7, [4, 3], 5, 0, 0),
            of(7, [3, 4], 6, 0, 0),
            of(7, [3, 4], 5, 1, 0),
            of(7, [3, 4], 5, 0, 1),
            of(7, [3, 4], 5 + SEQUENCE, 0, 0),
        ] {
            assert_ne!(one, other);
        }
    }

    #[test]
    fn sixteen_points_fill_a_four_by_four_grid() {
        let sampler = Sampler::new(1);
        let mut cells = [0; 16];
        for i in 0..16 {
            let [s, t] = sampler.light([11, 12], i, 2, 1);
            cells[(s * 4.0) as usize * 4 + (t * 4.0) as usize] += 1;
        }
        assert_eq!(cells, [1; 16]);
    }

    #[test]
    fn disk_points_lie_in_the_disk_and_fill_it() {
        let mut inner = 0;
        for i in 0..1024u32 {
            let [s, t, _, _] = Sampler::new(3).camera([1, 2], i);
            let [x, y] = disk([s, t]);
            let r2 = x * x + y * y;
            assert!(r2 <= 1.0 + 1e-6);
            inner += i32::from(r2 < 0.5);
        }
        assert!((inner - 512).abs() < 24, "{inner}");
    }
}
