//! The files of a picture: how they are stored, what they say about where it comes from.

use std::path::{Path, PathBuf};

use crate::{
    accel::BuildInfo,
    camera,
    error::{Error, Problem, Result},
    film::{Dropped, Film},
    layers::{Mattes, Plan},
    monitor::Monitor,
    output::{Oddities, Outputs, WriteOptions, atomic::Part, exr, tonemap::Depth},
    scene::{Backend, Camera, Layer, Scene, written::MAX_CRYPTO_RANKS},
};

/// How pictures are stored.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Storage {
    /// 32-bit floats in the EXR in place of halves.
    pub float: bool,
    /// How its blocks are compressed.
    pub compression: exr::Compression,
    /// A part of the EXR for every layer.
    pub multipart: bool,
    /// Bits of the PNG's channels.
    pub depth: Depth,
    /// The names of cryptomattes stand in files beside the EXR, not in its header.
    pub crypto_sidecar: bool,
}

/// The files of one picture, being written: `PREFIX.exr`, `PREFIX.png` and the manifests of its
/// cryptomattes where these stand beside it.
#[derive(Debug)]
pub struct Files {
    outputs: Outputs,
    manifests: Vec<Manifest>,
}

/// A manifest beside the picture.
#[derive(Debug)]
struct Manifest {
    /// What its mattes are called.
    kind: &'static str,
    /// Its name within the folder.
    name: String,
    file: Part,
}

impl Files {
    /// Their names; the EXR's and the PNG's first.
    pub fn names(prefix: &Path, plan: &Plan, storage: Storage) -> Vec<PathBuf> {
        let manifests = plan.mattes.iter().filter(|_| storage.crypto_sidecar);
        let manifests = manifests.map(|mattes| manifest_path(prefix, mattes.kind));
        Outputs::names(prefix).into_iter().chain(manifests).collect()
    }

    /// Creates the part files.
    ///
    /// # Errors
    /// Those of [`Part::create`]; a name that no EXR attribute can hold.
    pub fn create(prefix: &Path, plan: &Plan, storage: Storage) -> Result<Self> {
        let outputs = Outputs::create(prefix)?;
        let create = |mattes: &Mattes| {
            let path = manifest_path(prefix, mattes.kind);
            let name = file_name(&path)?;
            Ok(Manifest { kind: mattes.kind, name, file: Part::create(&path)? })
        };
        let manifests = plan.mattes.iter().filter(|_| storage.crypto_sidecar).map(create);
        Ok(Self { outputs, manifests: manifests.collect::<Result<_>>()? })
    }

    /// Takes one more file of the picture: see [`Outputs::add`].
    pub fn add(&mut self, part: Part) -> PathBuf {
        self.outputs.add(part)
    }
}

/// The kinds of cryptomattes that may have a manifest beside the picture.
pub const MANIFESTS: [&str; 2] = ["CryptoObject", "CryptoMaterial"];

/// Where the manifest of a kind of cryptomattes stands that leaves the header.
pub fn manifest_path(prefix: &Path, kind: &str) -> PathBuf {
    let mut path = prefix.as_os_str().to_owned();
    path.push(format!(".{kind}.json"));
    path.into()
}

/// The name of a file within its folder, for an attribute.
///
/// # Errors
/// A name that no EXR attribute can hold.
pub fn file_name(path: &Path) -> Result<String> {
    path.file_name().and_then(|name| name.to_str()).map(str::to_string).ok_or_else(|| {
        let message = "found a name that is not UTF-8, which the EXR cannot hold";
        Error::invalid(path.display().to_string(), message).help("choose another name: -o PREFIX")
    })
}

/// What the files of one picture say.
#[derive(Debug, Clone, Copy)]
pub struct Says<'a> {
    /// The layers and what they mean.
    pub plan: &'a Plan,
    /// More header attributes.
    pub more: &'a [(String, String)],
    /// What found the hits.
    pub info: &'a BuildInfo,
    /// SHA-256 of what decides the pixels ([`crate::world::fingerprint`]); none where a mesh came through a pipe.
    pub scene_hash: Option<&'a str>,
    /// Samples of each pixel, where these are not just the scene's.
    pub spp: Option<&'a str>,
    /// Which frame of a sequence it is.
    pub sequence: exr::Sequence,
    /// How long the render took, if the file is to say it.
    pub render_seconds: Option<f32>,
    /// What it was made of, for who asks later whether it would be the same again.
    pub fingerprint: Option<&'a str>,
}

/// Writes the film of a scene; returns the names of [`Files`], in their order.
///
/// # Errors
/// Those of [`Outputs::write`].
pub fn write(
    files: Files,
    film: &Film,
    scene: &Scene,
    says: Says,
    storage: Storage,
    monitor: &Monitor,
) -> Result<(Vec<PathBuf>, Oddities)> {
    let Files { mut outputs, manifests } = files;
    let mut attributes = origin(scene, &says);
    attributes.extend(layer_attributes(says.plan, &manifests));
    let mut beside = Vec::new();
    for Manifest { kind, mut file, .. } in manifests {
        let mattes = says.plan.mattes.iter().find(|mattes| mattes.kind == kind);
        file.fill(&(mattes.map(Mattes::manifest).unwrap_or_default() + "\n"))?;
        beside.push(outputs.add(file));
    }
    attributes.extend_from_slice(says.more);
    let options = WriteOptions {
        tonemap: &scene.tonemap,
        transparent: scene.transparent,
        depth: storage.depth,
        fingerprint: says.fingerprint,
        exr: exr::Options {
            attributes: &attributes,
            view: Some(view(&scene.camera)),
            sequence: says.sequence,
            render_seconds: says.render_seconds,
            float: storage.float,
            compression: storage.compression,
            multipart: storage.multipart,
        },
    };
    let (paths, oddities) = outputs.write(film, &options, monitor)?;
    Ok((paths.into_iter().chain(beside).collect(), oddities))
}

/// Refuses what contradicts the scene's values.
///
/// # Errors
/// The first contradiction.
pub fn suits(scene: &Scene, storage: Storage) -> Result<()> {
    let mattes = |layer: &Layer| matches!(layer, Layer::CryptoObject | Layer::CryptoMaterial);
    let lossy = storage.compression == exr::Compression::Dwaa;
    if lossy && scene.layers.iter().any(mattes) {
        let message =
            "found dwaa with cryptomatte: its losses change the ids, and no matte is found again";
        return Err(Error::invalid("--compression", message).help("zip, zips, piz, rle or none"));
    }
    Ok(())
}

/// What the EXR says about its origin: nothing that differs between two equal pictures, so no instruction
/// set either.
fn origin(scene: &Scene, says: &Says) -> Vec<(String, String)> {
    let mode = match scene.backend {
        Backend::Embree(mode) => format!(", {mode:?}").to_lowercase(),
        _ => String::new(),
    };
    let name = scene.backend.name();
    let backend = format!("{name} ({}{mode})", says.info.version);
    let said = [
        ("backend", Some(backend)),
        ("sceneHash", says.scene_hash.map(str::to_string)),
        ("seed", Some(scene.seed.to_string())),
        ("spp", Some(says.spp.map_or_else(|| scene.spp.to_string(), str::to_string))),
        ("version", Some(env!("CARGO_PKG_VERSION").to_string())),
    ];
    let said = said.into_iter().filter_map(|(name, value)| Some((name, value?)));
    said.map(|(name, value)| (format!("lightpath:{name}"), value)).collect()
}

/// Header attributes of the layers.
fn layer_attributes(plan: &Plan, manifests: &[Manifest]) -> Vec<(String, String)> {
    let mut attributes = Vec::new();
    for mattes in &plan.mattes {
        let beside = manifests.iter().find(|manifest| manifest.kind == mattes.kind);
        attributes.extend(mattes.attributes(beside.map(|manifest| manifest.name.as_str())));
    }
    let mut say = |name: &str, text: &str| {
        attributes.push((format!("lightpath:{name}"), text.to_string()));
    };
    if plan.recipe.depth.is_some() {
        say("Z", "camera-space depth, not distance; 1e30 where nothing is hit; nearest sample");
    }
    if plan.recipe.position.is_some() {
        say("P", "world space; 0 where nothing is hit; nearest sample");
    }
    if plan.normal.is_some() || plan.geometric_normal.is_some() {
        say("N", "world space, turned to the camera");
    }
    attributes
}

/// Where the picture was taken from.
fn view(camera: &Camera) -> exr::View {
    let rounded = |matrix: [[f64; 4]; 4]| std::array::from_fn(|i| matrix[i / 4][i % 4] as f32);
    exr::View {
        world_to_camera: rounded(camera::world_to_camera(camera)),
        world_to_ndc: rounded(camera::world_to_ndc(camera)),
        screen_window_width: camera::screen_window_width(camera) as f32,
    }
}

/// What the files could not hold.
pub fn odd(oddities: &Oddities) -> Vec<Problem> {
    let mut warnings = Vec::new();
    if let Some(spot) = &oddities.first_non_finite {
        let message = format!(
            "{} pixels with a NaN or infinite value were written as 0 or 65504, the first at {spot}",
            oddities.non_finite
        );
        warnings.push(Problem::new("", message).help("please report this with the scene"));
    }
    if let Some(spot) = &oddities.first_clamped {
        let message = format!(
            "{} pixels are brighter than a half can hold and were clamped to 65504 in the EXR, the first at {spot}",
            oddities.clamped
        );
        warnings.push(Problem::new("", message).help("make the lights weaker, or write --float"));
    }
    warnings.extend(dropped(&oddities.dropped));
    warnings
}

/// A warning of pixels that see more things than their cryptomattes have ranks.
fn dropped(dropped: &Dropped) -> Option<Problem> {
    let Dropped { pixels, share, things } = *dropped;
    let message = format!(
        "{pixels} pixels see more things than their cryptomattes have ranks: up to {share:.2} of a \
         pixel's coverage is lost"
    );
    let help = match things.next_multiple_of(2) {
        ranks if ranks <= MAX_CRYPTO_RANKS => format!("--crypto-ranks {ranks} keeps all of it"),
        _ => format!(
            "--crypto-ranks {MAX_CRYPTO_RANKS}, the most, keeps more of it: one pixel sees {things} \
             things"
        ),
    };
    (pixels > 0).then(|| Problem::new("", message).help(help))
}
