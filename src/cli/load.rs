//! Loads the scene of a command's arguments: a file, stdin, or a mesh in a template.

use std::path::{Path, PathBuf};

use crate::{
    error::{Error, Kind, Problem, Result},
    film::Window,
    integrate::TILE,
    memory,
    mesh::Mesh,
    monitor::Monitor,
    paths::seen_from,
    picture,
    scene::{Description, Loaded, MAX_PIXELS, Overrides, Scene, Source, written},
    studio::{self, MeshScene, Subject, Template},
    world::{own_texture, sources},
};

use super::{overrides, render::args::RenderArgs};

/// A checked scene, ready to be rendered.
#[derive(Debug)]
pub struct Job {
    /// The scene with all overrides applied.
    pub loaded: Loaded,
    /// Folder that the scene's paths are relative to.
    pub folder: PathBuf,
    /// Warnings of loading the input.
    pub warnings: Vec<Problem>,
    /// Meshes that had to be read to frame them.
    pub ready: Vec<(PathBuf, Mesh)>,
}

impl Job {
    /// Returns the paths of all files that the render reads, `input` first.
    pub fn inputs(&self, input: &Path) -> Vec<PathBuf> {
        let own = self.ready.iter().filter_map(|(path, mesh)| own_texture(path, mesh));
        let named = sources(&self.loaded.scene).into_iter().chain(own);
        [input.to_owned()].into_iter().chain(named).collect()
    }
}

/// Loads the input of `render`.
///
/// # Errors
/// Contradictory flags; all problems of the scene and its overrides.
pub fn load(args: &RenderArgs) -> Result<Job> {
    load_in(args, Template::STUDIO)
}

/// Loads like [`load`], but shows a mesh in `builtin` if the flags name no template.
///
/// # Errors
/// As for [`load`].
pub fn load_in(args: &RenderArgs, builtin: &str) -> Result<Job> {
    let is_mesh = studio::is_mesh(&args.input);
    if !is_mesh {
        refuse_mesh_flags(args)?;
    }
    let mut overrides = overrides::from_flags(&args.scene, &args.machine)?;
    if args.scene.spp.is_none() {
        let mut count = Overrides::default();
        count.flag("--of", "/spp", args.split.of);
        overrides.prepend(count);
    }
    if is_mesh {
        return in_template(args, builtin, overrides);
    }
    let mut warnings = Vec::new();
    let load = |source| studio::load(source, overrides, args.scene.light_samples, &mut warnings);
    let (loaded, folder) = if args.input == Path::new("-") {
        (load(Template::stdin()?.source())?, PathBuf::new())
    } else {
        let folder = args.input.parent().unwrap_or(Path::new("")).to_owned();
        (load(Source::File(&args.input))?, folder)
    };
    check_storage(args, Job { loaded, folder, warnings, ready: Vec::new() })
}

/// Reads a mesh and frames it in the template.
fn in_template(args: &RenderArgs, builtin: &str, overrides: Overrides) -> Result<Job> {
    let template = match &args.mesh.template {
        Some(template) => Template::file(template)?,
        None => Template::builtin("<studio>", builtin),
    };
    if let Some(limit) = args.machine.max_memory {
        memory::predict_mesh(&args.input)?.check(limit)?;
    }
    let room = args.machine.max_memory.map(memory::room).or_else(memory::machine);
    let subject = Subject { room, ..args.mesh.subject(&args.input) };
    // Nothing watches signals yet: a signal ends the program at once.
    let monitor = Monitor::default();
    let samples = args.scene.light_samples;
    let shown = studio::show(&subject, &template, overrides, samples, &monitor)?;
    let MeshScene { loaded, warnings, mesh, .. } = shown;
    check_storage(args, Job { loaded, folder: template.folder, warnings, ready: vec![mesh] })
}

/// Refuses flags that apply only to a mesh without a scene.
fn refuse_mesh_flags(args: &RenderArgs) -> Result<()> {
    let mesh = &args.mesh;
    let flags = [
        ("--up", mesh.placement.up.is_some()),
        ("--rotate", mesh.placement.rotate.is_some()),
        ("--margin", mesh.placement.margin.is_some()),
        ("--template", mesh.template.is_some()),
        ("--smooth", mesh.looks.smooth.is_some()),
        ("--texture", mesh.looks.texture.is_some()),
        ("--no-ground", mesh.looks.no_ground),
    ];
    let Some((flag, _)) = flags.into_iter().find(|(_, given)| *given) else {
        return Ok(());
    };
    let message = format!("found with {}, expected with a .ply file", args.input.display());
    Err(Error::invalid(flag, message)
        .help("a scene sets this in its trimesh: `rotate`, `smooth`, `material`"))
}

/// Refuses storage flags that contradict the scene.
fn check_storage(args: &RenderArgs, job: Job) -> Result<Job> {
    picture::check_storage(&job.loaded.scene, args.files.storage())?;
    Ok(job)
}

/// Returns the window of pixels to render.
///
/// # Errors
/// A crop that is empty or exceeds the frame.
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

/// Returns the margin for `pixels` of overscan, and the window in the coordinates of the enlarged
/// frame.
///
/// The margin is a whole number of tiles, so the packets of the frame stay the same.
///
/// # Errors
/// More pixels than a picture may have.
pub fn overscan(pixels: u32, scene: &Scene) -> Result<(u32, Window)> {
    let (width, height) = (scene.camera.width, scene.camera.height);
    let margin = pixels.next_multiple_of(TILE);
    let [x0, y0] = [margin - pixels; 2];
    let [x1, y1] = [width, height].map(|side| margin + side + pixels);
    let window = Window { x0, y0, x1, y1 };
    if u64::from(window.width()) * u64::from(window.height()) > MAX_PIXELS {
        let [w, h] = [window.width(), window.height()];
        let message = format!("found {pixels}, a picture of {w} x {h} pixels with the frame");
        let message = format!("{message}, expected at most {MAX_PIXELS} pixels");
        return Err(Error::invalid("--overscan", message));
    }
    Ok((margin, window))
}

/// Returns the text of the scene for the file `target`, with paths relative to its folder.
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
