//! The settings that a study compares: every combination of backend, sampler and numbers of
//! samples.

use crate::scene::SamplerKind;

/// One way to render the scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Setting {
    /// Index of the backend.
    pub backend: usize,
    /// Sampler of camera and light points.
    pub sampler: SamplerKind,
    /// Camera samples per pixel.
    pub spp: u32,
    /// Samples on each area light, sun and environment per shading point; `None` in a scene without
    /// them.
    pub light_samples: Option<u32>,
}

impl Setting {
    /// Samples per pixel of each light with samples, or camera samples in a scene without one.
    pub fn samples(&self) -> u64 {
        u64::from(self.spp) * u64::from(self.light_samples.unwrap_or(1))
    }

    /// Work of a render, roughly proportional to its time: the rays of a pixel whose camera rays
    /// hit, in a scene with at most one light with samples.
    pub fn work(&self) -> f64 {
        f64::from(self.spp) * (1.0 + f64::from(self.light_samples.unwrap_or(0)))
    }
}

/// The values of each dimension of a study; every combination is a setting.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyGrid {
    /// Number of backends that are compared.
    pub backend_count: usize,
    /// Samplers that are compared.
    pub samplers: Vec<SamplerKind>,
    /// Camera samples per pixel.
    pub spp: Vec<u32>,
    /// Samples on area lights, suns and environments; one `None` in a scene without them.
    pub light_samples: Vec<Option<u32>>,
}

impl StudyGrid {
    /// All settings, in the order of tables.
    pub fn settings(&self) -> Vec<Setting> {
        let mut all = Vec::new();
        for backend in 0..self.backend_count {
            for &sampler in &self.samplers {
                for &light_samples in &self.light_samples {
                    for &spp in &self.spp {
                        all.push(Setting { backend, sampler, spp, light_samples });
                    }
                }
            }
        }
        all
    }

    /// Returns whether the picture that the study converges to is antialiased: whether any setting
    /// has more than one camera sample per pixel. Renders with one converge to another picture.
    pub fn antialiased(&self) -> bool {
        self.spp.iter().any(|&spp| spp > 1)
    }

    /// The Sobol setting of a backend with the least work.
    pub fn cheapest(&self, backend: usize) -> Setting {
        self.scaled(backend, 1.0)
    }

    /// A Sobol setting with about `factor` (>= 1) times the samples of the cheapest setting. The
    /// factor is rounded down to a power of two.
    pub fn scaled(&self, backend: usize, factor: f64) -> Setting {
        let least = |values: &[u32]| values.iter().copied().min().unwrap_or(1);
        let lights: Vec<u32> = self.light_samples.iter().flatten().copied().collect();
        let more = |n: u32| {
            let power = factor.max(1.0).log2().floor().min(20.0);
            n.saturating_mul(1 << power as u32)
        };
        let (spp, light) = (least(&self.spp), least(&lights));
        let light_samples = (!lights.is_empty()).then_some(light);
        let sampler = SamplerKind::Sobol;
        match (self.antialiased(), light_samples) {
            // More camera samples would give another picture, an antialiased one.
            (false, Some(_)) => Setting { backend, sampler, spp, light_samples: Some(more(light)) },
            _ => Setting { backend, sampler, spp: more(spp), light_samples },
        }
    }

    /// The setting of a reference, with about `samples` samples per pixel. Numbers are rounded down
    /// to powers of two. An antialiased reference has at least 16 camera samples.
    pub fn reference(&self, samples: f64) -> Setting {
        let power = |n: f64| 1u32 << n.max(1.0).log2().floor().min(20.0) as u32;
        let sampler = SamplerKind::Sobol;
        let most = self.light_samples.iter().flatten().copied().max();
        let (spp, light_samples) = match (self.antialiased(), most) {
            (false, Some(_)) => (1, Some(power(samples))),
            (false, None) => (1, None),
            // Up to 4 shadow rays for each camera ray, because they are cheaper than camera rays.
            (true, Some(most)) => {
                let lights = most.min(4);
                (power(samples / f64::from(lights)).max(16), Some(lights))
            }
            (true, None) => (power(samples).max(16), None),
        };
        Setting { backend: 0, sampler, spp, light_samples }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(spp: &[u32], lights: &[Option<u32>]) -> StudyGrid {
        let samplers = SamplerKind::ALL.to_vec();
        StudyGrid { backend_count: 2, samplers, spp: spp.to_vec(), light_samples: lights.to_vec() }
    }

    #[test]
    fn every_combination_occurs_once() {
        let settings = grid(&[1, 4, 16], &[Some(1), Some(4)]).settings();
        assert_eq!(settings.len(), 2 * 2 * 3 * 2);
        for (i, a) in settings.iter().enumerate() {
            assert!(settings[i + 1..].iter().all(|b| a != b));
        }
        assert_eq!((settings[5].samples(), settings[5].work()), (64, 80.0));
    }

    #[test]
    fn a_reference_is_antialiased_like_the_grid() {
        let of = |spp: &[u32], lights: &[Option<u32>], samples| {
            let setting = grid(spp, lights).reference(samples);
            (setting.spp, setting.light_samples)
        };
        // With one sample per pixel the grid is not antialiased, so the reference is not either.
        assert_eq!(of(&[1], &[Some(4), Some(64)], 5000.0), (1, Some(4096)));
        assert_eq!(of(&[1, 4], &[Some(16)], 5000.0), (1024, Some(4)));
        assert_eq!(of(&[4, 64], &[None], 5000.0), (4096, None));
        assert_eq!(of(&[4], &[Some(1)], 1.0), (16, Some(1)));
        let probe = grid(&[4, 16], &[Some(2)]).scaled(1, 9.0);
        assert_eq!((probe.backend, probe.spp, probe.light_samples), (1, 32, Some(2)));
        assert_eq!(grid(&[1], &[Some(2)]).scaled(0, 9.0).light_samples, Some(16));
    }
}
