//! Sample points: every number a function of (seed, pixel, sample, purpose).
//!
//! Owen-scrambled Sobol, and beside it the coursework's independent points, as the baseline of reports.
//!
//! Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4), by the crate `sobol_burley`.
//! Each purpose (pixel and lens; one per light and bounce) is a set of its own, scrambled and
//! shuffled by its own seed and using the lowest dimensions, which are the best distributed.
//! [`Sampler::camera_lanes`] and [`Sampler::light_lanes`] compute many points at once, in SIMD lanes,
//! with the bits of the crate and in a fraction of its time.

use sobol_burley::parts::{hash, owen_scramble_rev, u32_to_f32_norm};

/// Longest sequence of the Sobol tables; longer ones continue with a new scramble.
const SEQUENCE: u32 = 1 << 16;

/// Indices that stay together when a sequence is shuffled: so many from a multiple of that on. So do those of any
/// power of two.
pub const STRETCH: usize = 64;

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

    /// The point in the unit square that number `index` of all samples is which the pixel takes of light
    /// `light` after `bounce` mirror bounces.
    pub fn light(&self, pixel: [u32; 2], index: u32, light: u32, bounce: u32) -> [f32; 2] {
        let [s, t, ..] = self.point(pixel, index, light_purpose(light, bounce));
        [s, t]
    }

    /// The first D coordinates of [`Sampler::camera`] in N lanes, D being 2 or 4: those of sample `index[i]` of
    /// the pixel `[x[i], y[i]]`.
    #[inline(always)]
    pub fn camera_lanes<const D: usize, const N: usize>(
        &self,
        [x, y]: [&[u32; N]; 2],
        index: &[u32; N],
    ) -> [[f32; N]; D] {
        self.lanes([x, y], index, 0)
    }

    /// [`Sampler::light`] in N lanes: number `index[i]` of the pixel `[x[i], y[i]]`.
    #[inline(always)]
    pub fn light_lanes<const N: usize>(
        &self,
        [x, y]: [&[u32; N]; 2],
        index: &[u32; N],
        light: u32,
        bounce: u32,
    ) -> [[f32; N]; 2] {
        self.lanes([x, y], index, light_purpose(light, bounce))
    }

    /// Two independent numbers in [0, 1) for decisions about camera sample `index` and light `light` after `bounce`
    /// mirror bounces, independent of all points.
    pub fn choices(&self, pixel: [u32; 2], index: u32, light: u32, bounce: u32) -> [f64; 2] {
        let purpose = (1 << 63) | (u64::from(bounce) << 32) | u64::from(light);
        let key = self.key(pixel, index, purpose);
        [key, mix(key)].map(|bits| (bits >> 11) as f64 / (1u64 << 53) as f64)
    }

    fn point(&self, pixel: [u32; 2], index: u32, purpose: u64) -> [f32; 4] {
        if self.kind == Kind::Random {
            let [x, y] = self.independent(pixel, index, purpose);
            let [s, t] = self.independent(pixel, index, !purpose);
            return [x, y, s, t];
        }
        let seed = self.key(pixel, index / SEQUENCE, purpose) as u32;
        sobol_burley::sample_4d(index % SEQUENCE, 0, seed)
    }

    /// The first D coordinates of [`Sampler::point`] in lanes; D is 2 or 4.
    #[inline(always)]
    fn lanes<const D: usize, const N: usize>(
        &self,
        [x, y]: [&[u32; N]; 2],
        index: &[u32; N],
        purpose: u64,
    ) -> [[f32; N]; D] {
        let mut points = [[0.0; N]; D];
        if self.kind == Kind::Random {
            for i in 0..N {
                for pair in 0..D / 2 {
                    let purpose = if pair == 0 { purpose } else { !purpose };
                    let [s, t] = self.independent([x[i], y[i]], index[i], purpose);
                    (points[2 * pair][i], points[2 * pair + 1][i]) = (s, t);
                }
            }
            return points;
        }
        let key = |i: usize| self.key([x[i], y[i]], index[i] / SEQUENCE, purpose) as u32;
        // A loop: a closure would be compiled for the portable tier, and called.
        let mut others = 0;
        for i in 0..N {
            let block = (index[i] / SEQUENCE) ^ (index[0] / SEQUENCE);
            others |= (x[i] ^ x[0]) | (y[i] ^ y[0]) | block;
        }
        let (mut shuffles, mut scrambles) = ([0; N], [[0; N]; D]);
        if others == 0 {
            // Samples of one pixel, as in most packets of many: one set, one seed.
            let set = Set::<D>::of(key(0));
            shuffles = [set.shuffle; N];
            for d in 0..D {
                scrambles[d] = [set.scrambles[d]; N];
            }
        } else {
            for i in 0..N {
                let set = Set::<D>::of(key(i));
                shuffles[i] = set.shuffle;
                for d in 0..D {
                    scrambles[d][i] = set.scrambles[d];
                }
            }
        }
        let mut indices = [0; N];
        for i in 0..N {
            indices[i] = shuffled(index[i], shuffles[i]);
        }
        scrambled(&indices, &scrambles)
    }

    /// [`Sampler::camera`] of N of the samples `first .. first + STRETCH`, `first` a multiple of [`STRETCH`]: of those
    /// that have `places`, each below [`STRETCH`], when these samples are put in the order of Sobol's sequence.
    #[inline(always)]
    pub fn camera_stretch<const N: usize>(
        &self,
        pixel: [u32; 2],
        first: u32,
        places: &[u8; N],
    ) -> [[f32; N]; 4] {
        let set = Set::<4>::of(self.key(pixel, first / SEQUENCE, 0) as u32);
        let begin = shuffled(first, set.shuffle) / STRETCH as u32 * STRETCH as u32;
        let mut indices = [0; N];
        for i in 0..N {
            indices[i] = begin + u32::from(places[i]);
        }
        let mut scrambles = [[0; N]; 4];
        for d in 0..4 {
            scrambles[d] = [set.scrambles[d]; N];
        }
        scrambled(&indices, &scrambles)
    }

    /// Those samples in that order, each as its distance from `first`.
    #[inline(always)]
    pub fn camera_stretch_samples(&self, pixel: [u32; 2], first: u32) -> [u8; STRETCH] {
        let Set { shuffle, .. } = Set::<0>::of(self.key(pixel, first / SEQUENCE, 0) as u32);
        let mut indices = [0; STRETCH];
        for i in 0..STRETCH {
            indices[i] = shuffled(first + i as u32, shuffle);
        }
        let mut samples = [0; STRETCH];
        for i in 0..STRETCH {
            samples[indices[i] as usize % STRETCH] = i as u8;
        }
        samples
    }

    /// Independent point `index`: an output of the generator SplitMix64 that starts at the set's key.
    #[inline(always)]
    fn independent(&self, pixel: [u32; 2], index: u32, purpose: u64) -> [f32; 2] {
        let key = self.key(pixel, INDEPENDENT, purpose);
        let bits = mix(key.wrapping_add(u64::from(index).wrapping_mul(GOLDEN)));
        [bits as u32, (bits >> 32) as u32].map(u32_to_f32_norm)
    }

    #[inline(always)]
    fn key(&self, [x, y]: [u32; 2], block: u32, purpose: u64) -> u64 {
        let pixel = (u64::from(y) << 32) | u64::from(x);
        mix(mix(mix(self.seed ^ mix(u64::from(block))) ^ pixel) ^ purpose)
    }
}

/// Where the shuffle of a set puts a sample in Sobol's sequence: within it and with its neighbours, of every power of
/// two, as their high bits decide about the lower ones.
#[inline(always)]
fn shuffled(sample: u32, shuffle: u32) -> u32 {
    owen_scramble_rev((sample % SEQUENCE).reverse_bits(), shuffle).reverse_bits() % SEQUENCE
}

/// Points of Sobol's sequence by their indices, each dimension scrambled.
#[inline(always)]
fn scrambled<const D: usize, const N: usize>(
    indices: &[u32; N],
    scrambles: &[[u32; N]; D],
) -> [[f32; N]; D] {
    let mut points = [[0.0; N]; D];
    for i in 0..N {
        let index = indices[i];
        let later = if D > 2 { product(&MATRICES, index) } else { 0 };
        for d in 0..D {
            // In reverse order of its bits, Sobol's first dimension is the index itself.
            let sobol = match d {
                0 => index,
                1 => pascal(index),
                2 => later & 0xffff,
                _ => later >> 16,
            };
            let scrambled = owen_scramble_rev(sobol, scrambles[d][i]);
            points[d][i] = u32_to_f32_norm(scrambled.reverse_bits());
        }
    }
    points
}

/// How the points of a set are shuffled, and each of D dimensions scrambled.
struct Set<const D: usize> {
    shuffle: u32,
    scrambles: [u32; D],
}

impl<const D: usize> Set<D> {
    /// As `sobol_burley` does it.
    #[inline(always)]
    fn of(seed: u32) -> Self {
        let own = seed.wrapping_mul(0x9c8f_2d3b);
        let mut scrambles = [0; D];
        for d in 0..D {
            scrambles[d] = hash(own ^ SCRAMBLES[d]);
        }
        Self { shuffle: hash(seed ^ SHUFFLE), scrambles }
    }
}

/// What tells the sequences of lights apart.
#[inline(always)]
fn light_purpose(light: u32, bounce: u32) -> u64 {
    1 + ((u64::from(bounce) << 32) | u64::from(light))
}

/// The constants by which `sobol_burley` tells the shuffle and the dimensions apart.
const SHUFFLE: u32 = 0x79c6_8e4a;
const SCRAMBLES: [u32; 4] = [0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8];

/// Sobol's second dimension, whose matrix is Pascal's triangle modulo 2: bit i of the result is the sum
/// of all bits j of the index with i & j = i. For 16 bits.
#[inline(always)]
fn pascal(index: u32) -> u32 {
    let sum = index ^ ((index >> 1) & 0x5555);
    let sum = sum ^ ((sum >> 2) & 0x3333);
    let sum = sum ^ ((sum >> 4) & 0x0f0f);
    sum ^ ((sum >> 8) & 0x00ff)
}

/// The matrices of `sobol_burley`'s third and, from bit 16 on, fourth dimension: for each bit of the index what it
/// adds to the coordinates, whose bits are in reverse order.
const MATRICES: [u32; 16] = [
    0x0001_0001,
    0x0003_0003,
    0x0004_0006,
    0x000a_0009,
    0x001f_0017,
    0x002e_003a,
    0x0045_0071,
    0x00c9_00a3,
    0x011b_0116,
    0x02a4_0339,
    0x079a_0677,
    0x0b67_09aa,
    0x101e_1601,
    0x302d_3903,
    0x4041_7706,
    0xa0c3_aa09,
];

/// A matrix times the bits of an index, modulo 2.
#[inline(always)]
fn product(matrix: &[u32; 16], index: u32) -> u32 {
    let mut sum = 0;
    for bit in 0..16 {
        sum ^= matrix[bit] & ((index >> bit) & 1).wrapping_neg();
    }
    sum
}

/// A seed whose points are independent of those of `seed`, for what must not depend on the picture's own.
pub fn other_seed(seed: i64) -> i64 {
    mix(!u64::from_ne_bytes(seed.to_ne_bytes())) as i64
}

/// SplitMix64's step (Steele, Lea, Flood 2014).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's finaliser, one step on.
#[inline(always)]
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
    fn lanes_are_the_points_of_the_crate_to_the_bit() {
        for seed in 0..40 {
            for kind in Kind::ALL {
                let sampler = Sampler::of(kind, seed);
                // Over all seeds every index is met, and two more sequences are begun.
                for first in (seed as u32 * 37..3 * SEQUENCE).step_by(80) {
                    // One pixel and several in turn.
                    let one = first / 80 % 2 == 0;
                    let x: [u32; 4] =
                        std::array::from_fn(|i| first / 3 + if one { 0 } else { i as u32 / 2 });
                    let y = if one { [seed as u32; 4] } else { [seed as u32, 9, 3, u32::MAX] };
                    let index: [u32; 4] = std::array::from_fn(|i| first + 40 * (i as u32 % 2));
                    let four: [[f32; 4]; 4] = sampler.camera_lanes([&x, &y], &index);
                    let two: [[f32; 4]; 2] = sampler.camera_lanes([&x, &y], &index);
                    let light = sampler.light_lanes([&x, &y], &index, 3, 2);
                    for i in 0..4 {
                        let expected = sampler.camera([x[i], y[i]], index[i]);
                        assert_eq!([0, 1, 2, 3].map(|d| four[d][i]), expected);
                        assert_eq!([two[0][i], two[1][i]], [expected[0], expected[1]]);
                        let expected = sampler.light([x[i], y[i]], index[i], 3, 2);
                        assert_eq!([light[0][i], light[1][i]], expected);
                    }
                }
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
            let [u, v] = sampler.light(pixel, i & 255, 0, 0);
            cells[(u * 4.0) as usize * 4 + (v * 4.0) as usize] += 1;
            let [next, ..] = sampler.camera(pixel, (i & 255) + 1);
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
