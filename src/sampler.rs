//! Sample points: Owen-scrambled Sobol, every number a function of (seed, pixel, sample, purpose).
//!
//! Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4), by the crate `sobol_burley`.
//! Each purpose (pixel and lens; one per light and bounce) is a set of its own, scrambled and
//! shuffled by its own seed and using the lowest dimensions, which are the best distributed.

/// Longest sequence of the Sobol tables; longer ones continue with a new scramble.
const SEQUENCE: u32 = 1 << 16;

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

    /// A point in the unit square for sample `index` of all those that the pixel takes of light
    /// `light` after `bounce` mirror bounces.
    pub fn light(&self, pixel: [u32; 2], index: u32, light: u32, bounce: u32) -> [f32; 2] {
        let [s, t, _, _] =
            self.point(pixel, index, 1 + ((u64::from(bounce) << 32) | u64::from(light)));
        [s, t]
    }

    fn point(&self, [x, y]: [u32; 2], index: u32, purpose: u64) -> [f32; 4] {
        let pixel = (u64::from(y) << 32) | u64::from(x);
        let block = u64::from(index / SEQUENCE);
        let seed = mix(mix(mix(self.seed ^ mix(block)) ^ pixel) ^ purpose);
        sobol_burley::sample_4d(index % SEQUENCE, 0, seed as u32)
    }
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
