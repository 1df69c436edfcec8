//! Loads the images of environment lights. An image that several lights use is loaded once.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, ErrorKind, Failures, Problem, Result};
use crate::reserve::MemoryLimit;
use crate::scene::{MapUse, Scene};
use crate::shading::{DEFAULT_MAX_BYTES, EnvironmentMap, Negative, Texture};
use crate::units;

use super::sources::LoadLog;

/// The loaded images by path.
#[derive(Debug, Clone, Default)]
pub struct Maps(Vec<(PathBuf, Arc<EnvironmentMap>)>);

impl Maps {
    /// Loads the images that the scene's environments name. `budget` limits their memory together;
    /// without it, each may take 4 GiB while it is decoded. Appends the files that were read, and
    /// warnings.
    ///
    /// # Errors
    /// Lists every image that cannot be read, does not fit, or has negative texels.
    pub(super) fn load(
        scene: &Scene,
        budget: Option<MemoryLimit>,
        log: &mut LoadLog,
    ) -> Result<Self> {
        let (mut all, mut failures) = (Self::default(), Failures::default());
        let mut tried: Vec<&Path> = Vec::new();
        for spec in scene.maps() {
            if tried.contains(&spec.path.as_path()) {
                continue;
            }
            tried.push(&spec.path);
            let left = budget.map(|budget| budget.less(all.bytes()));
            let Some(map) = failures.keep(one(spec, left)) else { continue };
            log.read.0.push((spec.path.clone(), map.texture().file().stamp));
            warn(spec, &map, &mut log.warnings);
            all.0.push((spec.path.clone(), Arc::new(map)));
        }
        failures.check()?;
        Ok(all)
    }

    /// Returns the image at `path`, if it is loaded.
    pub fn get(&self, path: &Path) -> Option<Arc<EnvironmentMap>> {
        let (_, map) = self.0.iter().find(|(known, _)| known == path)?;
        Some(Arc::clone(map))
    }

    /// Returns the memory of all images in bytes.
    pub fn bytes(&self) -> u64 {
        self.0.iter().map(|(_, map)| map.bytes()).sum()
    }
}

/// Loads one image. `left` is what the other images leave of the budget.
fn one(spec: &MapUse, left: Option<MemoryLimit>) -> Result<EnvironmentMap> {
    let shown = spec.path.display().to_string();
    let needed = EnvironmentMap::size(&spec.path)?.decoding;
    if let Some(left) = left {
        left.check(needed, &shown)?;
    } else if needed > DEFAULT_MAX_BYTES {
        let (needed, limit) = (units::bytes_rounded_up(needed), units::bytes(DEFAULT_MAX_BYTES));
        let message = format!("needs {needed}; the limit is {limit}");
        let problem = Problem::new(shown, message).help("scale the image down");
        return Err(Error::new(ErrorKind::Limit, problem));
    }
    let texture = Texture::load_within(&spec.path, needed)?;
    if let Some(Negative { texels, first: [x, y] }) = texture.file().negative {
        let message = format!(
            "found {}, the first at ({x}, {y}); expected a radiance of at least 0",
            units::plural(texels as usize, "negative texel")
        );
        return Err(Error::invalid(shown, message));
    }
    EnvironmentMap::new(texture, &shown)
}

fn warn(spec: &MapUse, map: &EnvironmentMap, warnings: &mut Vec<Problem>) {
    let (texture, path) = (map.texture(), spec.path.display());
    let (width, height) = (texture.width(), texture.height());
    let mut warn = |message: String| warnings.push(Problem::new(&spec.place, message));
    if u64::from(width) != 2 * u64::from(height) {
        warn(format!(
            "{path} is {width} x {height} pixels, expected twice as wide as high; it is taken as \
             the whole sphere"
        ));
    }
    if texture.file().had_alpha {
        warn(format!("the alpha channel of {path} is ignored"));
    }
    if map.mean() == 0.0 {
        warn(format!("{path} is black; it sends no light"));
    }
}
