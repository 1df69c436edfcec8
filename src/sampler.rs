//! Sample points: every point is a function of (seed, pixel, sample index, purpose).
//!
//! The default are Owen-scrambled Sobol points. Independent points, as in the coursework, are the
//! baseline of reports.
//!
//! Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4), by the crate `sobol_burley`.
//! A purpose is the camera (pixel and lens), or one light after one number of bounces. Each purpose
//! of a pixel has its own set of points. A set is scrambled and shuffled by its own seed. It uses
//! the lowest dimensions, which are distributed best. [`Sampler::camera_lanes`] and
//! [`Sampler::light_lanes`] compute many points at once in SIMD lanes. They give the bits of the
//! crate in a fraction of its time.

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sobol_burley::parts::{hash, owen_scramble_rev, u32_to_f32_norm};

/// Length of the Sobol tables' sequences; longer sequences continue with a new scramble.
const SEQUENCE: u32 = 1 << 16;

/// Length of a stretch: an aligned block of sample indices. A shuffle maps each stretch to an
/// aligned block of Sobol's sequence. The same holds for every power of two.
pub const STRETCH: usize = 64;

/// Index of a sequence, in the keys of independent points. No Sobol sequence has it.
const INDEPENDENT: u32 = u32::MAX;

/// Index in place of a light's, for the set of points that draw a light.
pub const DRAWN_LIGHT: u32 = u32::MAX - 1;

/// Sampler that chooses the points on pixels, the lens and area lights.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum,
)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "Sampler")]
pub enum SamplerKind {
    /// Owen-scrambled Sobol points: stratified
    #[default]
    Sobol,
    /// uniform and independent points, as in the coursework: the baseline
    Random,
}

impl SamplerKind {
    /// All samplers, the default first.
    pub const ALL: [Self; 2] = [Self::Sobol, Self::Random];

    /// Name in the scene format.
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
    kind: SamplerKind,
}

impl Sampler {
    /// Makes a Sobol sampler for the scene's seed.
    pub fn new(seed: i64) -> Self {
        Self::with_kind(SamplerKind::Sobol, seed)
    }

    /// Makes a sampler of this kind for the scene's seed.
    pub fn with_kind(kind: SamplerKind, seed: i64) -> Self {
        // Only the bits matter; a negative seed is valid.
        Self { seed: u64::from_ne_bytes(seed.to_ne_bytes()), kind }
    }

    /// Returns camera sample `index` of a pixel: offset x, y in the pixel and two coordinates for
    /// the lens, all in [0, 1).
    pub fn camera(&self, pixel: [u32; 2], index: u32) -> [f32; 4] {
        self.point(pixel, index, 0)
    }

    /// Returns point `index`, in [0, 1)^2, of the pixel's sample set for `light` after `bounce`
    /// mirror bounces. All camera samples of the pixel take their points from this set.
    pub fn light(&self, pixel: [u32; 2], index: u32, light: u32, bounce: u32) -> [f32; 2] {
        let [s, t, ..] = self.point(pixel, index, light_purpose(light, bounce));
        [s, t]
    }

    /// The first D coordinates of [`Sampler::camera`] in N lanes; D is 2 or 4. Lane i is sample
    /// `index[i]` of the pixel `[x[i], y[i]]`.
    #[inline(always)]
    pub fn camera_lanes<const D: usize, const N: usize>(
        &self,
        [x, y]: [&[u32; N]; 2],
        index: &[u32; N],
    ) -> [[f32; N]; D] {
        self.lanes([x, y], index, 0)
    }

    /// [`Sampler::light`] in N lanes. Lane i is point `index[i]` of the pixel `[x[i], y[i]]`.
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

    /// Returns three numbers in [0, 1) per lane: the first draws a light, the others a point on the
    /// light. They come from a set of their own. Lane i is point `index[i]` of the pixel
    /// `[x[i], y[i]]`.
    #[inline(always)]
    pub fn drawn_light_lanes<const N: usize>(
        &self,
        [x, y]: [&[u32; N]; 2],
        index: &[u32; N],
        bounce: u32,
    ) -> [[f32; N]; 3] {
        let [u, s, t, _] = self.lanes::<4, N>([x, y], index, light_purpose(DRAWN_LIGHT, bounce));
        [u, s, t]
    }

    /// Prepares points of a light in N lanes: `first[i] .. first[i] + count` in lane i. See
    /// [`LightPoints`].
    #[inline(always)]
    pub fn light_points<'a, const N: usize>(
        &'a self,
        pixels: [&'a [u32; N]; 2],
        first: &[u32; N],
        count: u32,
        (light, bounce): (u32, u32),
    ) -> LightPoints<'a, N> {
        let purpose = light_purpose(light, bounce);
        let mut within = self.kind == SamplerKind::Sobol;
        for i in 0..N {
            within &= count <= SEQUENCE - first[i] % SEQUENCE;
        }
        let sets = if within { Some(self.sets(pixels, first, purpose)) } else { None };
        LightPoints { sampler: self, pixels, purpose, sets }
    }

    /// Returns two random numbers in [0, 1), independent of each other and of all sample points.
    /// They are a function of camera sample `index` and of `light` after `bounce` mirror bounces.
    pub fn choices(&self, pixel: [u32; 2], index: u32, light: u32, bounce: u32) -> [f64; 2] {
        let purpose = (1 << 63) | (u64::from(bounce) << 32) | u64::from(light);
        let key = self.key(pixel, index, purpose);
        [key, mix(key)].map(|bits| (bits >> 11) as f64 / (1u64 << 53) as f64)
    }

    fn point(&self, pixel: [u32; 2], index: u32, purpose: u64) -> [f32; 4] {
        if self.kind == SamplerKind::Random {
            let [x, y] = self.independent(pixel, index, purpose);
            // The complement is no set's purpose: purposes below 2^31 bounces leave bit 63 at 0.
            let [s, t] = self.independent(pixel, index, !purpose);
            return [x, y, s, t];
        }
        let seed = self.key(pixel, index / SEQUENCE, purpose) as u32;
        sobol_burley::sample_4d(index % SEQUENCE, 0, seed)
    }

    /// The first D coordinates of [`Sampler::point`] in N lanes; D is 2 or 4.
    #[inline(always)]
    fn lanes<const D: usize, const N: usize>(
        &self,
        [x, y]: [&[u32; N]; 2],
        index: &[u32; N],
        purpose: u64,
    ) -> [[f32; N]; D] {
        let mut points = [[0.0; N]; D];
        if self.kind == SamplerKind::Random {
            for i in 0..N {
                for pair in 0..D / 2 {
                    let purpose = if pair == 0 { purpose } else { !purpose };
                    let [s, t] = self.independent([x[i], y[i]], index[i], purpose);
                    (points[2 * pair][i], points[2 * pair + 1][i]) = (s, t);
                }
            }
            return points;
        }
        self.sets([x, y], index, purpose).points(index)
    }

    /// Returns the seeds of the set to which point `index[i]` of lane i belongs.
    #[inline(always)]
    fn sets<const D: usize, const N: usize>(
        &self,
        [x, y]: [&[u32; N]; 2],
        index: &[u32; N],
        purpose: u64,
    ) -> Sets<D, N> {
        let key = |i: usize| self.key([x[i], y[i]], index[i] / SEQUENCE, purpose) as u32;
        // A loop: a closure in an iterator would be a call, and compiled for the portable tier.
        let mut others = 0;
        for i in 0..N {
            let block = (index[i] / SEQUENCE) ^ (index[0] / SEQUENCE);
            others |= (x[i] ^ x[0]) | (y[i] ^ y[0]) | block;
        }
        let (mut shuffles, mut scrambles) = ([0; N], [[0; N]; D]);
        if others == 0 {
            // All lanes sample one pixel, as in most packets of renders with many samples: one set,
            // one seed.
            let set = Set::<D>::new(key(0));
            shuffles = [set.shuffle; N];
            for d in 0..D {
                scrambles[d] = [set.scrambles[d]; N];
            }
        } else {
            for i in 0..N {
                let set = Set::<D>::new(key(i));
                shuffles[i] = set.shuffle;
                for d in 0..D {
                    scrambles[d][i] = set.scrambles[d];
                }
            }
        }
        Sets { shuffles, scrambles }
    }

    /// [`Sampler::camera`] for N samples of the block `first .. first + size`. `size` is a power of
    /// two, at most [`STRETCH`], and `first` a multiple of it. `places` selects the samples by
    /// their positions in the order of Sobol's sequence, each below `size`.
    /// [`Sampler::camera_stretch_samples`] returns this order.
    #[inline(always)]
    pub fn camera_stretch<const N: usize>(
        &self,
        pixel: [u32; 2],
        (first, size): (u32, u32),
        places: &Places<N>,
    ) -> [[f32; N]; 4] {
        let set = Set::<4>::new(self.key(pixel, first / SEQUENCE, 0) as u32);
        let begin = coordinates(shuffled(first, set.shuffle) & !(size - 1));
        let mut points = [[0.0; N]; 4];
        for d in 0..4 {
            for i in 0..N {
                let sobol = begin[d] ^ places.coordinates[d][i];
                let scrambled = owen_scramble_rev(sobol, set.scrambles[d]);
                points[d][i] = u32_to_f32_norm(scrambled.reverse_bits());
            }
        }
        points
    }

    /// Returns the samples `first .. first + STRETCH` in the order of Sobol's sequence. Each is
    /// given relative to `first`, a multiple of [`STRETCH`].
    #[inline(always)]
    pub fn camera_stretch_samples(&self, pixel: [u32; 2], first: u32) -> [u8; STRETCH] {
        let Set { shuffle, .. } = Set::<0>::new(self.key(pixel, first / SEQUENCE, 0) as u32);
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

    /// Independent point `index`: an output of SplitMix64 whose initial state is the set's key.
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

/// Returns the index in Sobol's sequence that the shuffle of a set assigns to a sample. A shuffled
/// bit depends only on its own and higher bits. So an aligned block of samples, with a power of two
/// as its size, maps to an aligned block.
#[inline(always)]
fn shuffled(sample: u32, shuffle: u32) -> u32 {
    owen_scramble_rev((sample % SEQUENCE).reverse_bits(), shuffle).reverse_bits() % SEQUENCE
}

/// Points of Sobol's sequence at `indices`, with each dimension scrambled.
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
            // Coordinates have their bits reversed here. Sobol's first dimension is then the index.
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

/// Seeds of the sets of N lanes, one set per lane.
#[derive(Debug)]
struct Sets<const D: usize, const N: usize> {
    shuffles: [u32; N],
    scrambles: [[u32; N]; D],
}

impl<const D: usize, const N: usize> Sets<D, N> {
    /// Returns the first D coordinates of point `index[i]` of lane i's set.
    #[inline(always)]
    fn points(&self, index: &[u32; N]) -> [[f32; N]; D] {
        let mut indices = [0; N];
        for i in 0..N {
            indices[i] = shuffled(index[i], self.shuffles[i]);
        }
        scrambled(&indices, &self.scrambles)
    }
}

/// Consecutive points of a light in N lanes. The seeds of the lanes' sets are computed only once.
#[derive(Debug)]
pub struct LightPoints<'a, const N: usize> {
    sampler: &'a Sampler,
    pixels: [&'a [u32; N]; 2],
    purpose: u64,
    /// `None` if the points of some lane do not all belong to one set.
    sets: Option<Sets<2, N>>,
}

impl<const N: usize> LightPoints<'_, N> {
    /// [`Sampler::light_lanes`] for one of the prepared points in each lane.
    #[inline(always)]
    pub fn at(&self, index: &[u32; N]) -> [[f32; N]; 2] {
        match &self.sets {
            Some(sets) => sets.points(index),
            None => self.sampler.lanes(self.pixels, index, self.purpose),
        }
    }
}

/// Seeds of a set of points: for its shuffle, and for the scramble of each dimension.
struct Set<const D: usize> {
    shuffle: u32,
    scrambles: [u32; D],
}

impl<const D: usize> Set<D> {
    /// Derives the seeds as `sobol_burley` does.
    #[inline(always)]
    fn new(seed: u32) -> Self {
        let own = seed.wrapping_mul(0x9c8f_2d3b);
        let mut scrambles = [0; D];
        for d in 0..D {
            scrambles[d] = hash(own ^ SCRAMBLES[d]);
        }
        Self { shuffle: hash(seed ^ SHUFFLE), scrambles }
    }
}

/// Purpose of the points of a light after `bounce` bounces. Purpose 0 is the camera.
#[inline(always)]
fn light_purpose(light: u32, bounce: u32) -> u64 {
    1 + ((u64::from(bounce) << 32) | u64::from(light))
}

/// Constants of `sobol_burley`: they give the shuffle and each dimension a seed of its own.
const SHUFFLE: u32 = 0x79c6_8e4a;
const SCRAMBLES: [u32; 4] = [0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8];

/// Sobol's second dimension, for 16 bits. Its matrix is Pascal's triangle modulo 2: bit i of the
/// result is the sum of all bits j of the index with i & j = i.
#[inline(always)]
const fn pascal(index: u32) -> u32 {
    let sum = index ^ ((index >> 1) & 0x5555);
    let sum = sum ^ ((sum >> 2) & 0x3333);
    let sum = sum ^ ((sum >> 4) & 0x0f0f);
    sum ^ ((sum >> 8) & 0x00ff)
}

/// The four coordinates of a point of Sobol's sequence, with their bits reversed. Each is a sum
/// modulo 2 over the bits of the index. So if two indices have no bit in common, the coordinates of
/// their sum are the sums of their coordinates.
#[inline(always)]
const fn coordinates(index: u32) -> [u32; 4] {
    let later = product(&MATRICES, index);
    [index, pascal(index), later & 0xffff, later >> 16]
}

/// Coordinates of N points at the beginning of Sobol's sequence.
#[derive(Debug)]
pub struct Places<const N: usize> {
    coordinates: [[u32; N]; 4],
}

impl<const N: usize> Places<N> {
    /// For these positions in the sequence.
    pub const fn new(places: &[u8; N]) -> Self {
        let mut all = [[0; N]; 4];
        let mut i = 0;
        while i < N {
            [all[0][i], all[1][i], all[2][i], all[3][i]] = coordinates(places[i] as u32);
            i += 1;
        }
        Self { coordinates: all }
    }
}

/// Matrices of `sobol_burley`'s third dimension and, from bit 16 on, fourth dimension. If bit i of
/// the index is set, entry i is added to the coordinates modulo 2. The bits of the coordinates are
/// reversed.
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

/// Product of a matrix and the low 16 bits of an index, modulo 2.
#[inline(always)]
const fn product(matrix: &[u32; 16], index: u32) -> u32 {
    let (mut sum, mut bit) = (0, 0);
    while bit < 16 {
        sum ^= matrix[bit] & ((index >> bit) & 1).wrapping_neg();
        bit += 1;
    }
    sum
}

/// Returns a seed whose points are independent of the points of `seed`. It is for decisions that
/// must not depend on the picture's own samples.
pub fn independent_seed(seed: i64) -> i64 {
    mix(!u64::from_ne_bytes(seed.to_ne_bytes())) as i64
}

/// Increment of SplitMix64 (Steele, Lea, Flood 2014).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// One step of SplitMix64 and its finaliser.
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
    fn points_depend_on_their_keys_alone() {
        let sampler = Sampler::new(7);
        assert_eq!(sampler.camera([3, 4], 5), sampler.camera([3, 4], 5));
        assert_ne!(sampler.camera([3, 4], 5), sampler.camera([4, 3], 5));
        assert_ne!(sampler.camera([3, 4], 5), Sampler::new(8).camera([3, 4], 5));
        assert_ne!(sampler.light([3, 4], 5, 0, 0), sampler.light([3, 4], 5, 1, 0));
        assert_ne!(sampler.light([3, 4], 5, 0, 0), sampler.light([3, 4], 5, 0, 1));
        assert_ne!(sampler.camera([0, 0], 1), sampler.camera([0, 0], 1 + SEQUENCE));
    }

    #[test]
    fn prepared_light_points_are_those_of_the_set() {
        let (x, y) = ([3, 3, 8, 900], [5, 5, 5, 0]);
        for kind in SamplerKind::ALL {
            let sampler = Sampler::with_kind(kind, 4);
            // Within one sequence, up to its end, beyond it, and as many as a light may have.
            for count in [1, 12, 64, SEQUENCE, SEQUENCE + 1, u32::MAX - 64, u32::MAX] {
                for start in [0, 100, SEQUENCE - 12, SEQUENCE - 11, 5 * SEQUENCE - 64] {
                    let first = [start, start + 1, start, start + 40];
                    let points = sampler.light_points([&x, &y], &first, count, (2, 1));
                    for k in [0, 1, count / 2, count - 1] {
                        let index = first.map(|first| first.wrapping_add(k));
                        let square = points.at(&index);
                        for i in 0..4 {
                            let expected = sampler.light([x[i], y[i]], index[i], 2, 1);
                            assert_eq!([square[0][i], square[1][i]], expected, "{start} {count}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn lanes_have_the_bits_of_the_crate() {
        for seed in 0..40 {
            for kind in SamplerKind::ALL {
                let sampler = Sampler::with_kind(kind, seed);
                // All seeds together cover every index and begin two more sequences.
                for first in (seed as u32 * 37..3 * SEQUENCE).step_by(80) {
                    // Alternately one pixel and several pixels.
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
    fn independent_points_are_uniform_and_uncorrelated() {
        let (mut cells, mut products) = ([0u32; 16], [0.0f64; 6]);
        let n = 1 << 16;
        for i in 0..n {
            // Over pixels and samples.
            let sampler = Sampler::with_kind(SamplerKind::Random, 5);
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
        // Chi-square with 15 degrees of freedom is above 37.7 once in 1000 seeds. The points must
        // not be as even as stratified points either: chi-square is below 3.5 once in 1000 seeds.
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
            Sampler::with_kind(SamplerKind::Random, seed).light(pixel, index, light, bounce)
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
