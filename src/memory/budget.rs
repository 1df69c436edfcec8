//! The limit of `--max-memory`, and what it leaves for each part of a render.

use super::limits::smaller_backend;
use super::{BASE_BYTES, Prediction, over_limit, predict_words};
use crate::accel::{MemoryFootprint, memory_footprint};
use crate::error::Result;
use crate::film::Window;
use crate::reserve::MemoryLimit;
use crate::scene::Scene;
use crate::units;

/// The limit of `--max-memory`, with a prediction that fits into it.
#[derive(Debug)]
pub struct Budget {
    limit: u64,
    prediction: Prediction,
}

impl Budget {
    /// Checks that a scene fits. The film is given by its window, its number of channels besides R,
    /// G, B, A, and further bytes. Reads the headers of all files. For Embree, also builds two
    /// small meshes to measure the footprint.
    ///
    /// # Errors
    /// `Limit`, with the numbers; headers that cannot be read; a backend that cannot run.
    pub fn check(
        limit: u64,
        scene: &Scene,
        (window, words, other_bytes): (Window, usize, u64),
        threads: usize,
    ) -> Result<Self> {
        let prediction = predict_words(scene, window, words)?.with_film_bytes(other_bytes);
        let own = prediction.clone().with(&memory_footprint(scene.backend, threads)?);
        let smaller = prediction.with(&MemoryFootprint::BVH).peak_bytes;
        Self::new(limit, own)
            .map_err(|error| error.maybe_help(smaller_backend(scene.backend, smaller, limit)))
    }

    /// Checks that a prediction fits into the limit.
    ///
    /// # Errors
    /// `Limit`, with the numbers.
    pub fn new(limit: u64, prediction: Prediction) -> Result<Self> {
        prediction.check(limit)?;
        Ok(Self { limit, prediction })
    }

    fn without_program(&self) -> u64 {
        self.limit.saturating_sub(self.prediction.program_bytes())
    }

    /// Returns the bytes left for images: the limit without the program and the predicted meshes.
    pub fn for_textures(&self) -> u64 {
        self.without_program().saturating_sub(self.prediction.mesh_bytes)
    }

    /// Returns the memory left for meshes: the limit without the program.
    pub fn for_meshes(&self) -> MemoryLimit {
        MemoryLimit { bytes: self.without_program(), set_by_user: true }
    }

    /// Returns the bytes left for the accelerator after a world of `world_bytes` is subtracted.
    pub fn for_accelerator(&self, world_bytes: u64) -> u64 {
        self.without_program().saturating_sub(world_bytes)
    }

    /// Checks that the film fits in addition to `held` bytes of world and accelerator.
    ///
    /// # Errors
    /// `Limit`, with the numbers.
    pub fn check_film(&self, held: u64) -> Result<()> {
        let film = self.prediction.film_bytes;
        let program = self.prediction.program_bytes();
        let needed = program.saturating_add(held).saturating_add(film);
        if self.limit >= needed {
            return Ok(());
        }
        let message = format!(
            "found {}, expected at least {}: film {} beside meshes, textures and accelerator of {}",
            units::bytes(self.limit),
            units::bytes_rounded_up(needed),
            units::bytes(film),
            units::bytes(held),
        );
        Err(over_limit(message))
    }

    /// Returns how many films, at most `most`, fit in addition to `held` bytes of world and
    /// accelerator.
    ///
    /// # Errors
    /// `Limit`, with the numbers, if one does not fit.
    pub fn films(&self, held: u64, most: u64) -> Result<u64> {
        self.check_film(held)?;
        let left = self.without_program().saturating_sub(held);
        Ok(most.min(left / self.prediction.film_bytes.max(1)))
    }
}

/// Returns the memory that the user's limit of `limit` bytes leaves for meshes.
pub fn limit_for_meshes(limit: u64) -> MemoryLimit {
    MemoryLimit { bytes: limit.saturating_sub(BASE_BYTES), set_by_user: true }
}
