//! Arguments -> a checked scene: a file, stdin, or a mesh in a template.

use std::path::{Path, PathBuf};

use crate::{
    error::{Error, Kind, Problem, Result},
    film::Window,
    mesh::Mesh,
    scene::{self, Backend, Description, Layer, Loaded, Scene, ShapeKind, Source, written},
};

use super::{
    args::{CompressionName, RenderArgs},
    memory, meshes,
    origin::Origin,
    overrides::Overrides,
    paths::seen_from,
    studio::{self, STUDIO, Subject},
};

/// A scene that is ready to be rendered.
#[derive(Debug)]
pub struct Job {
    /// The scene, overrides applied.
    pub loaded: Loaded,
    /// What its paths are relative to.
    pub folder: PathBuf,
    /// What is suspicious so far.
    pub warnings: Vec<Problem>,
    /// Meshes that had to be read for the framing.
    pub ready: Vec<(PathBuf, Mesh)>,
}

/// Loads what `render` was asked for.
///
/// # Errors
/// Contradictory flags, and everything that is wrong with the scene and its overrides.
pub fn load(args: &RenderArgs) -> Result<Job> {
    load_in(args, STUDIO)
}

/// The same, a mesh in `builtin` unless the flags name a template.
///
/// # Errors
/// Those of [`load`].
pub fn load_in(args: &RenderArgs, builtin: &str) -> Result<Job> {
    let is_mesh = meshes::is_mesh(&args.input);
    if !is_mesh {
        only_for_meshes(args)?;
    }
    let mut overrides = Overrides::new(&args.scene);
    if args.scene.spp.is_none() && args.split.of.is_some() {
        let mut count = Overrides::default();
        count.flag("--of", "/spp", args.split.of);
        overrides.prepend(count);
    }
    if args.machine.exact && args.scene.backend.is_none() {
        // The fastest of those that lose no ray: docs/bvh.md has the numbers.
        let mut fastest = Overrides::default();
        fastest.flag("--exact", "/scene/accelerator", Some("bvh"));
        overrides.prepend(fastest);
    }
    let (mut warnings, mut ready) = (Vec::new(), Vec::new());
    let origin = match &args.mesh.template {
        Some(template) => Origin::file(template)?,
        None if is_mesh => {
            Origin { name: "<studio>".to_string(), text: builtin.into(), folder: PathBuf::new() }
        }
        None if args.input == Path::new("-") => Origin::stdin()?,
        None => return load_file(args, overrides),
    };
    if is_mesh {
        if let Some(limit) = args.machine.max_memory {
            memory::predict_mesh(&args.input)?.check(limit)?;
        }
        let subject = Subject {
            path: &args.input,
            up: args.mesh.up,
            repair: args.mesh.repair,
            no_mmap: args.mesh.no_mmap,
            builtin: args.mesh.template.is_none(),
        };
        let (ours, mesh) = studio::furnish(&subject, &origin, &overrides, &mut warnings)?;
        overrides.prepend(ours);
        ready.push(mesh);
    }
    let mut job = finish(origin.source(), origin.folder.clone(), args, overrides, warnings)?;
    for (path, _) in &mut ready {
        call_as_typed(&mut job.loaded.scene, path, &args.input);
    }
    Ok(Job { ready, ..job })
}

/// Messages name the mesh as the user does, not as the template sees it.
fn call_as_typed(scene: &mut Scene, path: &mut PathBuf, typed: &Path) {
    for shape in &mut scene.shapes {
        if let ShapeKind::Trimesh(spec) = &mut shape.kind {
            if spec.path == *path {
                spec.path = typed.to_owned();
            }
        }
    }
    *path = typed.to_owned();
}

/// Refuses flags that mean nothing for a scene.
fn only_for_meshes(args: &RenderArgs) -> Result<()> {
    let flag = match (args.mesh.up, &args.mesh.template) {
        (Some(_), _) => "--up",
        (_, Some(_)) => "--template",
        _ => return Ok(()),
    };
    let message = format!("found with {}, expected with a .ply file", args.input.display());
    Err(Error::invalid(flag, message)
        .help("a scene says itself how its meshes stand: `rotate` in its trimesh"))
}

fn load_file(args: &RenderArgs, overrides: Overrides) -> Result<Job> {
    let folder = args.input.parent().unwrap_or(Path::new("")).to_owned();
    finish(Source::File(&args.input), folder, args, overrides, Vec::new())
}

fn finish(
    source: Source,
    folder: PathBuf,
    args: &RenderArgs,
    mut overrides: Overrides,
    mut warnings: Vec<Problem>,
) -> Result<Job> {
    let load = |o: &Overrides| scene::load(source, &o.sets()).map_err(|error| o.explain(error));
    let mut loaded = load(&overrides)?;
    if let Some(samples) = args.scene.light_samples {
        if overrides.light_samples(samples, &loaded.description) {
            loaded = load(&overrides)?;
        } else {
            let message = "has no effect: the scene has no area light";
            warnings.push(Problem::new("--light-samples", message));
        }
    }
    if args.machine.fast && loaded.scene.backend != Backend::Embree {
        let message = format!(
            "found with the backend `{}`, which has no fast mode",
            loaded.scene.backend.name()
        );
        return Err(Error::invalid("--fast", message).help("leave --fast out, or --backend embree"));
    }
    if args.machine.exact && loaded.scene.backend == Backend::Coursework {
        let message = "found with the backend `coursework`, which loses rays as the coursework did";
        let help = "leave --exact out, or --backend embree, bvh or brute";
        return Err(Error::invalid("--exact", message).help(help));
    }
    let mattes = |layer: &Layer| matches!(layer, Layer::CryptoObject | Layer::CryptoMaterial);
    let lossy = args.files.compression == Some(CompressionName::Dwaa);
    if lossy && loaded.scene.layers.iter().any(mattes) {
        let message =
            "found dwaa with cryptomatte: its losses change the ids, and no matte is found again";
        return Err(Error::invalid("--compression", message).help("zip, zips, piz, rle or none"));
    }
    warnings.append(&mut loaded.warnings);
    Ok(Job { loaded, folder, warnings, ready: Vec::new() })
}

/// The pixels to render.
///
/// # Errors
/// A crop that is empty or leaves the frame.
pub fn window(crop: Option<&[u32]>, scene: &Scene) -> Result<Window> {
    let (width, height) = (scene.camera.width, scene.camera.height);
    let Some([x0, y0, x1, y1]) = crop.and_then(|c| <[u32; 4]>::try_from(c).ok()) else {
        return Ok(Window::full(width, height));
    };
    let found = format!("found {x0} {y0} {x1} {y1}");
    let wrong = match (x0 < x1 && y0 < y1, x1 <= width && y1 <= height) {
        (true, true) => return Ok(Window { x0, y0, x1, y1 }),
        (false, _) => format!("{found}, which is empty, expected X0 < X1 and Y0 < Y1"),
        (_, false) => format!("{found}, expected pixels within the frame of {width} x {height}"),
    };
    Err(Error::new(Kind::Invalid, Problem::new("--crop", wrong)))
}

/// The text of a scene saved as `target`: its paths seen from there.
///
/// # Errors
/// A path that is not UTF-8.
pub fn saved(job: &Job, target: &Path) -> Result<String> {
    let to = target.parent().unwrap_or(Path::new(""));
    let mut description: Description = job.loaded.description.clone();
    let move_path = |path: &mut String| -> Result<()> {
        *path = seen_from(&job.folder.join(&*path), to)?;
        Ok(())
    };
    let material = |material: &mut written::Material| match &mut material.texture_path {
        Some(path) => move_path(&mut path.0),
        None => Ok(()),
    };
    description.scene.materials.values_mut().try_for_each(material)?;
    for shape in &mut description.scene.shapes {
        if let written::Shape::TriMesh(mesh) = shape {
            move_path(&mut mesh.path.0)?;
        }
        if let written::MaterialUse::Inline(inline) = shape.material_mut() {
            material(inline)?;
        }
    }
    Ok(description.to_text())
}
