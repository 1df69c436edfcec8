//! Random numbers that depend only on a seed and an index.

use glam::DVec3;

/// The generator SplitMix64 (Steele et al. 2014).
pub struct Random(u64);

impl Random {
    /// Starts sequence `index` of a seed.
    pub fn new(seed: u64, index: u64) -> Self {
        let mut first = Self::from_state(seed);
        let start = first.bits();
        Self(start ^ index.wrapping_mul(0xd134_2543_de82_ef95))
    }

    /// Starts the generator in this state.
    pub fn from_state(state: u64) -> Self {
        Self(state)
    }

    /// Returns 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    /// Returns a uniform number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a uniform number in [`from`, `to`).
    pub fn within(&mut self, from: f64, to: f64) -> f64 {
        from + self.unit() * (to - from)
    }

    /// Returns a uniform integer in 0..n.
    pub fn below(&mut self, n: u32) -> u32 {
        ((u128::from(self.bits()) * u128::from(n)) >> 64) as u32
    }

    /// Returns -1 or 1 with equal probability.
    pub fn sign(&mut self) -> f64 {
        if self.bits() >> 63 == 0 { 1.0 } else { -1.0 }
    }

    /// Returns a uniform point in [-1, 1)^3.
    pub fn cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// Returns a uniform direction of unit length.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.cube();
            if (1e-4..=1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }
}
