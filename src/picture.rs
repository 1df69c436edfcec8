//! The files of a picture: storage options, header attributes, manifests, warnings.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::film::{Dropped, Film};
use crate::layers::{LayerPlan, Mattes};
use crate::monitor::Monitor;
use crate::output::atomic::PartFile;
use crate::output::legend::Legend;
use crate::output::tonemap::Depth;
use crate::output::{Outputs, ValueCounts, WriteOptions, exr};
use crate::scene::written::MAX_CRYPTO_RANKS;
use crate::scene::{Backend, CheckedCamera, Layer, Scene};
use crate::units::counted;
use crate::{camera, paths};

/// Storage options of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Storage {
    /// True for 32-bit floats in the EXR, false for 16-bit floats.
    pub float: bool,
    /// Compression of the EXR's blocks.
    pub compression: exr::Compression,
    /// True if each layer is a part of its own in the EXR.
    pub multipart: bool,
    /// Bits per channel of the PNG.
    pub depth: Depth,
    /// True if the manifests of cryptomattes (names and ids) are files beside the EXR, not in its
    /// header.
    pub crypto_sidecar: bool,
}

/// The files of one picture while they are written: `PREFIX.exr`, `PREFIX.png`, and the manifests
/// of its cryptomattes with [`Storage::crypto_sidecar`].
#[derive(Debug)]
pub struct PictureFiles {
    outputs: Outputs,
    /// Header attributes that describe the layers.
    attributes: Vec<(String, String)>,
    manifests: Vec<(PartFile, String)>,
}

impl PictureFiles {
    /// Returns the paths of the files: the EXR, the PNG, then the manifests.
    pub fn names(prefix: &Path, plan: &LayerPlan, storage: Storage) -> Vec<PathBuf> {
        let manifests = plan.mattes.iter().filter(|_| storage.crypto_sidecar);
        let manifests = manifests.map(|mattes| manifest_path(prefix, mattes.kind));
        Outputs::names(prefix).into_iter().chain(manifests).collect()
    }

    /// Creates the part files.
    ///
    /// # Errors
    /// As [`PartFile::create`]; a name that no EXR attribute can hold.
    pub fn create(prefix: &Path, plan: &LayerPlan, storage: Storage) -> Result<Self> {
        let outputs = Outputs::create(prefix)?;
        let mut attributes = layer_attributes(plan);
        let manifests = match storage.crypto_sidecar {
            true => manifests(&mut attributes, prefix)?,
            false => Vec::new(),
        };
        let manifests = manifests.into_iter().map(Manifest::create).collect::<Result<_>>()?;
        Ok(Self { outputs, attributes, manifests })
    }

    /// Adds another file to the picture: see [`Outputs::add`].
    pub fn add(&mut self, part: PartFile) -> PathBuf {
        self.outputs.add(part)
    }
}

/// Kinds of cryptomattes that can have a manifest beside the picture.
pub const MANIFESTS: [&str; 2] = ["CryptoObject", "CryptoMaterial"];

/// Returns the path of the manifest file for one kind of cryptomattes.
pub fn manifest_path(prefix: &Path, kind: &str) -> PathBuf {
    paths::with_ending(prefix, &format!(".{kind}.json"))
}

/// Returns the name of a file within its folder, for an EXR attribute.
///
/// # Errors
/// A name that no EXR attribute can hold.
fn file_name(path: &Path) -> Result<String> {
    path.file_name().and_then(|name| name.to_str()).map(str::to_string).ok_or_else(|| {
        let message = "found a name that is not UTF-8, which the EXR cannot hold";
        Error::invalid(path.display().to_string(), message).help("choose another name: -o PREFIX")
    })
}

/// A cryptomatte manifest that moves from the EXR header to a file of its own.
#[derive(Debug)]
pub struct Manifest {
    /// Path of the manifest's file.
    pub path: PathBuf,
    /// Content of the file.
    text: String,
}

impl Manifest {
    /// Returns the manifests that a picture has beside its EXR.
    ///
    /// # Errors
    /// A file name that an EXR attribute cannot hold.
    pub fn beside(prefix: &Path, plan: &LayerPlan, storage: Storage) -> Result<Vec<Self>> {
        match storage.crypto_sidecar {
            true => manifests(&mut layer_attributes(plan), prefix),
            false => Ok(Vec::new()),
        }
    }

    /// Returns true if its file exists and has this content.
    pub fn is_written(&self) -> bool {
        let length = std::fs::metadata(&self.path).map(|data| data.len());
        length.is_ok_and(|length| length == self.text.len() as u64)
            && std::fs::read(&self.path).is_ok_and(|bytes| bytes == self.text.as_bytes())
    }

    /// Creates the part file of the manifest.
    ///
    /// # Errors
    /// As for [`PartFile::create`].
    pub fn create(self) -> Result<(PartFile, String)> {
        Ok((PartFile::create(&self.path)?, self.text))
    }

    /// Writes the manifest, hands its part file to `outputs` for the final rename, and returns its
    /// path.
    ///
    /// # Errors
    /// `Retry` if the disk is full.
    pub fn write((mut file, text): (PartFile, String), outputs: &mut Outputs) -> Result<PathBuf> {
        file.fill(text.as_bytes())?;
        Ok(outputs.add(file))
    }
}

/// Takes the cryptomatte manifests out of `attributes` and returns them. An attribute with the name
/// of its file replaces each.
///
/// # Errors
/// A file name that an EXR attribute cannot hold.
pub fn manifests(attributes: &mut [(String, String)], prefix: &Path) -> Result<Vec<Manifest>> {
    let mut found = Vec::new();
    for index in 0..attributes.len() {
        let Some(key) = attributes[index].0.strip_suffix("/manifest").map(str::to_string) else {
            continue;
        };
        let kind = attributes.iter().find(|(name, _)| *name == format!("{key}/name"));
        let kind = kind.map(|(_, kind)| kind.clone()).unwrap_or_default();
        let path = manifest_path(prefix, &kind);
        let file = file_name(&path)?;
        let (name, text) = &mut attributes[index];
        *name = format!("{key}/manif_file");
        let text = std::mem::replace(text, file) + "\n";
        found.push(Manifest { path, text });
    }
    Ok(found)
}

/// The information that a picture's files hold beside the pixels.
#[derive(Debug, Clone, Copy, Default)]
pub struct PictureHeader<'a> {
    /// Additional header attributes: names and values.
    pub more: &'a [(String, String)],
    /// Version of the backend that found the hits.
    pub backend_version: &'a str,
    /// SHA-256 of everything that decides the pixels ([`crate::world::fingerprint`]). `None` if a
    /// mesh came through a pipe.
    pub scene_hash: Option<&'a str>,
    /// Samples per pixel, if they are not just the scene's.
    pub spp: Option<&'a str>,
    /// Colours of the plate behind the PNG's pixels, row by row, as linear light.
    pub over: Option<&'a [[f32; 3]]>,
    /// True if the file is a part that keeps every bit.
    pub exact: bool,
    /// Position of the picture in a sequence.
    pub sequence: exr::Sequence,
    /// Render time in seconds, if the file is to hold it.
    pub render_seconds: Option<f32>,
    /// Legend of the PNG.
    pub legend: Option<&'a Legend>,
    /// Fingerprint of the inputs, for a later check whether they would give the same picture.
    pub fingerprint: Option<&'a str>,
}

/// Writes the film of a scene. Returns the paths of [`PictureFiles::names`], in their order, and
/// the open files.
///
/// # Errors
/// As [`Outputs::write`].
pub fn write(
    files: PictureFiles,
    film: &Film,
    scene: &Scene,
    says: PictureHeader,
    storage: Storage,
    monitor: &Monitor,
) -> Result<(Vec<(PathBuf, File)>, ValueCounts)> {
    let PictureFiles { mut outputs, attributes: layers, manifests } = files;
    let manifests = manifests.into_iter().map(|manifest| Manifest::write(manifest, &mut outputs));
    let beside = manifests.collect::<Result<Vec<_>>>()?;
    let mut attributes = origin(scene, &says);
    attributes.extend(layers);
    let camera = camera_attributes(scene, &attributes);
    attributes.extend(camera);
    attributes.extend_from_slice(says.more);
    let options = WriteOptions {
        tonemap: &scene.tonemap,
        transparent: scene.has_alpha(),
        over: says.over,
        depth: storage.depth,
        legend: says.legend.filter(|_| scene.legend),
        fingerprint: says.fingerprint,
        exr: exr::Options {
            attributes: &attributes,
            view: Some(view(&scene.camera)),
            sequence: says.sequence,
            render_seconds: says.render_seconds,
            float: storage.float,
            exact: says.exact,
            compression: storage.compression,
            multipart: storage.multipart,
        },
    };
    let (mut written, oddities) = outputs.write(film, &options, monitor)?;
    let further = written.split_off(2).into_iter().filter(|(path, _)| beside.contains(path));
    written.extend(further);
    Ok((written, oddities))
}

/// Checks the storage options against the scene.
///
/// # Errors
/// The first contradiction.
pub fn check_storage(scene: &Scene, storage: Storage) -> Result<()> {
    if !storage.compression.is_lossy() {
        return Ok(());
    }
    let halves = |what: &str| format!("it keeps {what} as halves, up to {}", exr::DWA_MAX);
    let harmed = |layer: &Layer| match layer {
        Layer::CryptoObject | Layer::CryptoMaterial => {
            Some(("cryptomatte", "its losses change the ids, so mattes cannot be found".into()))
        }
        Layer::Position => Some(("P", halves("`P.Y`"))),
        Layer::Distance => Some(("distance", halves("`distance.Y`"))),
        Layer::Variance => Some(("variance", halves("squares of radiance"))),
        Layer::Samples => Some(("samples", "its losses change the counts".into())),
        _ => None,
    };
    let Some((layer, why)) = scene.layers.iter().find_map(harmed) else { return Ok(()) };
    let message = format!("found dwaa with {layer}: {why}");
    Err(Error::invalid("--compression", message).help("zip, zips, piz, rle or none"))
}

/// Returns the header attributes that say how the EXR was made. They are equal for equal pictures,
/// so they do not hold the instruction set.
fn origin(scene: &Scene, says: &PictureHeader) -> Vec<(String, String)> {
    let mode = match scene.backend {
        Backend::Embree(mode) => format!(", {mode:?}").to_lowercase(),
        _ => String::new(),
    };
    let name = scene.backend.name();
    let backend = format!("{name} ({}{mode})", says.backend_version);
    let values = [
        ("backend", Some(backend)),
        ("sceneHash", says.scene_hash.map(str::to_string)),
        ("seed", Some(scene.seed.to_string())),
        ("spp", Some(says.spp.map_or_else(|| scene.spp.to_string(), str::to_string))),
        ("version", Some(env!("CARGO_PKG_VERSION").to_string())),
    ];
    let values = values.into_iter().filter_map(|(name, value)| Some((name, value?)));
    values.map(|(name, value)| (format!("lightpath:{name}"), value)).collect()
}

/// Returns the header attributes that describe the layers.
fn layer_attributes(plan: &LayerPlan) -> Vec<(String, String)> {
    let mut attributes: Vec<_> = plan.mattes.iter().flat_map(Mattes::attributes).collect();
    let mut add = |name: &str, text: &str| {
        attributes.push((format!("lightpath:{name}"), text.to_string()));
    };
    if plan.layout.depth.is_some() {
        add("Z", "camera-space depth, not distance; 1e30 where nothing is hit; nearest sample");
    }
    if plan.layout.distance.is_some() {
        add(
            "distance",
            "from the origin of the camera ray; 1e30 where nothing is hit; nearest sample",
        );
    }
    if plan.camera_normal.is_some() {
        add("Ncam", "camera space: x right, y up, z to the viewer");
    }
    if plan.layout.position.is_some() {
        add("P", "world space; 0 where nothing is hit; nearest sample");
    }
    if plan.normal.is_some() || plan.geometric_normal.is_some() {
        add("N", "world space, turned to the camera");
    }
    attributes
}

/// Returns the header attributes of a camera beside OpenEXR's own. Of two
/// attributes with the same name, the later one counts: here `lightpath:Z`, whose meaning differs.
fn camera_attributes(scene: &Scene, layers: &[(String, String)]) -> Vec<(String, String)> {
    let camera = ("lightpath:camera".to_string(), camera::described(&scene.camera));
    let z = "lightpath:Z".to_string();
    let distance = camera::sees_behind(&scene.camera) && layers.iter().any(|(name, _)| *name == z);
    let text = "distance from the camera; 1e30 where nothing is hit; nearest sample";
    std::iter::once(camera).chain(distance.then(|| (z, text.to_string()))).collect()
}

/// Returns the camera matrices of the picture.
fn view(camera: &CheckedCamera) -> exr::CameraMatrices {
    let rounded = |matrix: [[f64; 4]; 4]| std::array::from_fn(|i| matrix[i / 4][i % 4] as f32);
    let screen = camera::screen(camera);
    exr::CameraMatrices {
        world_to_camera: rounded(camera::world_to_camera(camera)),
        world_to_ndc: camera::world_to_ndc(camera).map(rounded),
        screen_window_width: screen.width as f32,
        screen_window_center: screen.center.map(|x| x as f32),
        pixel_aspect: screen.pixel_aspect as f32,
    }
}

/// Checks that no value of a picture is NaN or infinite. `place` names the picture or the flag that
/// asks for the check.
///
/// # Errors
/// `Check`, with the first such value.
pub fn check_finite(values: &ValueCounts, place: &str) -> Result<()> {
    let Some(spot) = &values.first_non_finite else { return Ok(()) };
    let count = counted(values.non_finite, ["pixel is", "pixels are"]);
    let message = format!("{count} NaN or infinite, the first {spot}");
    Err(Error::new(ErrorKind::Check, Problem::new(place, message)))
}

/// Returns warnings about what the files could not hold: those of the EXR, then those of the PNG.
pub fn oddity_warnings(oddities: &ValueCounts) -> Vec<Problem> {
    [exr_warnings(oddities), png_warnings(oddities)].concat()
}

/// Returns warnings about what the PNG could not hold.
pub fn png_warnings(oddities: &ValueCounts) -> Vec<Problem> {
    let message = "the picture is too small for the legend, which is left out";
    oddities.legend_left_out.then(|| Problem::new("", message)).into_iter().collect()
}

/// Returns warnings about values that the EXR could not hold.
pub fn exr_warnings(oddities: &ValueCounts) -> Vec<Problem> {
    let mut warnings = Vec::new();
    if let Some(spot) = &oddities.first_non_finite {
        let what =
            ["pixel with a NaN or infinite value was", "pixels with a NaN or infinite value were"];
        let pixels = counted(oddities.non_finite, what);
        let message = format!("{pixels} written as 0 or clamped, the first at {spot}");
        let help = "are coefficients or lights huge? Otherwise please report this with the scene";
        warnings.push(Problem::new("", message).help(help));
    }
    if let Some(spot) = &oddities.first_clamped {
        let limit = oddities.clamped_to;
        let holder = if limit == exr::DWA_MAX { "dwaa" } else { "a half" };
        let pixels = counted(oddities.clamped, ["pixel is", "pixels are"]);
        let was = if oddities.clamped == 1 { "was" } else { "were" };
        let found = format!("{pixels} brighter than {holder} can hold and {was}");
        let message = format!("{found} clamped to {limit} in the EXR, the first at {spot}");
        let help = "make the lights weaker, or write --float, without dwaa";
        warnings.push(Problem::new("", message).help(help));
    }
    warnings.extend(dropped(&oddities.dropped));
    warnings
}

/// Returns a warning if more objects or materials cover a pixel than its cryptomattes have ranks.
fn dropped(dropped: &Dropped) -> Option<Problem> {
    let Dropped { pixels, share, things } = *dropped;
    let message = format!(
        "{} more things than their cryptomattes have ranks: up to {share:.2} of a pixel's coverage \
         is lost",
        counted(pixels, ["pixel sees", "pixels see"])
    );
    let help = match things.next_multiple_of(2) {
        ranks if ranks <= MAX_CRYPTO_RANKS => format!("--crypto-ranks {ranks} keeps all of it"),
        _ => format!(
            "{MAX_CRYPTO_RANKS} ranks are the most, and one pixel sees {things} things: shapes with \
             the same `name` are one thing"
        ),
    };
    (pixels > 0).then(|| Problem::new("", message).help(help))
}
