//! Sample points: Owen-scrambled Sobol, every number a function of (seed, pixel, sample, purpose).
//!
//! Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4), by the crate `sobol_burley`.
//! Each purpose (pixel and lens; one per light and bounce) is a set of its own, scrambled and
//! shuffled by its own seed and using the lowest dimensions, which are the best distributed.
//! Where two dimensions are enough, [`Points`] computes these alone, with the same bits and in a
//! fraction of the time.

use sobol_burley::parts::{hash, owen_scramble_rev, u32_to_f32_norm};

/// Longest sequence of the Sobol tables; longer ones continue with a new scramble.
const SEQUENCE: u32 = 1 << 16;

/// Pairs of dimensions of the camera's sequence that are used: pixel, lens, then lights.
const JOINT: u32 = 4;

/// Source of all sample points of a render.
#[derive(Debug, Clone, Copy)]
pub struct Sampler {
    seed: u64,
}

impl Sampler {
    /// A sampler for the scene's seed.
    pub fn new(seed: i64) -> Self {
        // The bits are what matters; a negative seed is as good as any.
        Self { seed: u64::from_ne_bytes(seed.to_ne_bytes()) }
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

    /// The same for a light of `samples` points for each camera sample: for one point, and one of the
    /// first lights that camera rays see, further dimensions of the camera's own sequence, so that pixel,
    /// lens and light are stratified together. `lens`: whether the lens takes dimensions.
    #[inline(always)]
    pub fn points_of(
        &self,
        samples: u32,
        lens: bool,
        pixel: [u32; 2],
        light: u32,
        bounce: u32,
    ) -> Points {
        let mut points = self.light_points(pixel, light, bounce);
        let pair = light.saturating_add(1 + u32::from(lens));
        if samples == 1 && bounce == 0 && pair < JOINT {
            points.pair = pair;
        }
        points
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
        let seed = self.seed_of(pixel, index / SEQUENCE, purpose);
        sobol_burley::sample_4d(index % SEQUENCE, 0, seed)
    }

    #[inline(always)]
    fn seed_of(&self, [x, y]: [u32; 2], block: u32, purpose: u64) -> u32 {
        let pixel = (u64::from(y) << 32) | u64::from(x);
        mix(mix(mix(self.seed ^ mix(u64::from(block))) ^ pixel) ^ purpose) as u32
    }
}

/// The sequence of one pixel and purpose in its first two dimensions.
#[derive(Debug, Clone, Copy)]
pub struct Points {
    sampler: Sampler,
    /// Whose points these are.
    pub pixel: [u32; 2],
    purpose: u64,
    /// Which two dimensions of the camera's sequence these are; 0: none of them.
    pair: u32,
    /// Which `SEQUENCE` indices the rest is made for.
    block: u32,
    shuffle: u32,
    scramble: [u32; 2],
}

impl Points {
    #[inline(always)]
    fn new(sampler: Sampler, pixel: [u32; 2], purpose: u64) -> Self {
        let mut points =
            Self { sampler, pixel, purpose, pair: 0, block: 0, shuffle: 0, scramble: [0; 2] };
        points.begin(0);
        points
    }

    /// The same points of another pixel.
    #[inline(always)]
    pub fn of(&self, pixel: [u32; 2]) -> Self {
        Self { pair: self.pair, ..Self::new(self.sampler, pixel, self.purpose) }
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
        if self.pair > 0 {
            return self.joint(index);
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
    #[inline(never)]
    fn joint(&self, index: u32) -> [f32; 2] {
        let seed = self.sampler.seed_of(self.pixel, index / SEQUENCE, 0);
        let [a, b, c, d] = sobol_burley::sample_4d(index % SEQUENCE, self.pair / 2, seed);
        if self.pair % 2 == 0 { [a, b] } else { [c, d] }
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

/// SplitMix64's finaliser (Steele, Lea, Flood 2014).
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
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
    fn sixteen_points_fill_a_four_by_four_grid() {
        let sampler = Sampler::new(1);
        let mut cells = [0; 16];
        for i in 0..16 {
            let [s, t] = sampler.light([11, 12], i, 2, 1);
            cells[(s * 4.0) as usize * 4 + (t * 4.0) as usize] += 1;
        }
        assert_eq!(cells, [1; 16]);
    }

    /// Whether 2^m points have one in each of all rectangles of area 2^-m and power-of-two sides.
    fn stratified(points: &[[f32; 2]]) -> bool {
        let m = points.len().ilog2();
        (0..=m).all(|a| {
            let [across, down] = [1u32 << a, 1 << (m - a)];
            let mut met = vec![false; points.len()];
            for [x, y] in points {
                let cell = (x * across as f32) as u32 * down + (y * down as f32) as u32;
                met[cell as usize] = true;
            }
            met.iter().all(|&met| met)
        })
    }

    #[test]
    fn all_light_points_of_a_pixel_are_one_stratified_set() {
        for (spp, samples) in [(1, 16), (4, 4), (16, 16), (64, 4)] {
            for seed in 0..8 {
                let sampler = Sampler::new(seed);
                // As `Cast::light_points` numbers them.
                let mut drawn = sampler.points_of(samples, false, [5, 9], 1, 0);
                let of = |i: u32, k: u32| i * samples + k;
                let one: Vec<_> = (0..spp)
                    .flat_map(|i| (0..samples).map(move |k| of(i, k)))
                    .map(|index| drawn.at(index))
                    .collect();
                assert!(stratified(&one), "{spp} x {samples}");
                // A set for each camera sample, each stratified, is not one.
                let sets: Vec<_> = (0..spp)
                    .flat_map(|i| (0..samples).map(move |k| sampler.light([i, 7], k, 1, 0)))
                    .collect();
                assert!(spp == 1 || !stratified(&sets));
            }
        }
    }

    #[test]
    fn any_aligned_run_of_light_points_is_stratified() {
        let mut drawn = Sampler::new(4).light_points([1, 2], 0, 0);
        for (first, length) in [(16, 16), (32, 32), (64, 16), (96, 32), (768, 256)] {
            let points: Vec<_> = (first..first + length).map(|index| drawn.at(index)).collect();
            assert!(stratified(&points), "{length} from {first}");
        }
    }

    /// Root mean square error over pixels of the volume below a slanted edge through pixel and light.
    fn slanted(n: u32, lens: bool, light: u32, samples: u32) -> f64 {
        let sampler = Sampler::new(11);
        let squares = (0..256).map(|x| {
            let pixel = [x, 3];
            let mut drawn = sampler.points_of(samples, lens, pixel, light, 0);
            let inside = (0..n).filter(|&i| {
                let [x, y, _, _] = sampler.camera(pixel, i);
                let [s, t] = drawn.at(i);
                x + y + s + t < 2.0
            });
            (inside.count() as f64 / f64::from(n) - 0.5).powi(2)
        });
        (squares.sum::<f64>() / 256.0).sqrt()
    }

    #[test]
    fn pixel_and_single_light_points_are_stratified_together() {
        for (lens, light) in [(false, 0), (false, 1), (false, 2), (true, 0), (true, 1)] {
            let joint = slanted(256, lens, light, 1);
            let padded = slanted(256, lens, light, 2);
            assert!(joint < 0.75 * padded, "{joint} {padded} {lens} {light}");
        }
        // Lights beyond have a set of their own.
        let sampler = Sampler::new(2);
        let mut far = sampler.points_of(1, false, [1, 1], 3, 0);
        assert_eq!(far.at(9), sampler.light([1, 1], 9, 3, 0));
        let mut shown = sampler.points_of(1, false, [1, 1], 0, 1);
        assert_eq!(shown.at(9), sampler.light([1, 1], 9, 0, 1));
    }

    #[test]
    fn choices_are_uniform_and_differ_by_all_keys() {
        let sampler = Sampler::new(3);
        let sum: f32 = (0..4096).map(|i| sampler.choice([i, 1], 16, 0, 0)).sum();
        // Standard error 0.0045.
        assert!((sum / 4096.0 - 0.5).abs() < 0.02, "{sum}");
        let one = sampler.choice([1, 2], 3, 0, 0);
        for other in [
            sampler.choice([2, 1], 3, 0, 0),
            sampler.choice([1, 2], 4, 0, 0),
            sampler.choice([1, 2], 3, 1, 0),
            sampler.choice([1, 2], 3, 0, 1),
        ] {
            assert_ne!(one, other);
        }
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
