//! Fits a template to a mesh by overrides, so that the result is an ordinary scene.

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::json;

use crate::error::{Error, Problem, Result};
use crate::mesh::Mesh;
use crate::paths::{named, seen_from};
use crate::scene::{Document, JsonNode, Loaded, Overrides, Trimesh, escaped};
use crate::world::{self, Bounds, OwnImage, moved_texture_warning, several_textures_warning};

use super::axes::{main_axis, turn};
use super::calibrated::keep_coordinates;
use super::placing::{place, point};
use super::points::UsedVertices;
use super::subject::{Appearance, Subject};
use super::template::{Template, trimesh};

/// A template fitted to a mesh.
#[derive(Debug)]
pub struct FittedTemplate {
    /// Overrides that turn the template into a scene of this mesh.
    pub overrides: Overrides,
    /// The mesh, with the path that the scene names.
    pub mesh: (PathBuf, Mesh),
    /// Centre of the mesh's bounding box after placement, in world space. Zero if the subject is
    /// calibrated.
    pub middle: DVec3,
    /// `None` if the subject is calibrated.
    pub stand: Option<Stand>,
}

/// How a mesh stands in a template, whatever camera looks at it.
#[derive(Debug)]
pub struct Stand {
    /// Overrides that turn the template into a scene of the mesh, without those of the camera.
    overrides: Overrides,
    /// The path of the mesh in the scene.
    pub(super) path: PathBuf,
    middle: DVec3,
    /// The main axis of the camera's `up`, and its sign there: things stand along it.
    up: (usize, bool),
    /// Warnings about the mesh.
    pub(super) warnings: Vec<Problem>,
}

impl Stand {
    /// Fits the template to the mesh for another camera. `user` differs from the overrides that
    /// the mesh was placed with only in this camera, and may not place it: without its `position`
    /// or under another `up`, the mesh is needed again, and the answer is `None`.
    ///
    /// # Errors
    /// Every problem of the scene.
    pub(super) fn fit(&self, template: &Template, user: &Overrides) -> Result<Option<Overrides>> {
        let loaded = load(template, &self.overrides, user)?;
        let camera = &loaded.scene.camera;
        let is_placed = user.touches("/camera/position") && camera.perspective().is_some();
        if !is_placed || up_axis(camera.up) != self.up {
            return Ok(None);
        }
        let mut ours = self.overrides.clone();
        point((&loaded, user), camera.position, self.middle, &mut ours);
        Ok(Some(ours))
    }
}

fn up_axis(up: DVec3) -> (usize, bool) {
    let axis = main_axis(up);
    (axis, up[axis] > 0.0)
}

/// Returns the overrides that fit `template` to the mesh. The caller applies the user's overrides
/// after them. `user` is read because the framing depends on it.
pub fn furnish(
    subject: &Subject,
    mesh: Mesh,
    template: &Template,
    user: &Overrides,
    warnings: &mut Vec<Problem>,
) -> Result<FittedTemplate> {
    let shape = first_trimesh(template)?;
    let mut ours = looks(subject, template, &shape)?;
    // Colours that the user or the template asks for are shown in place of a texture.
    let wanted = wanted(subject, template, user);
    let (spec, textured) = wanted.unzip();
    let colored = spec.is_some_and(|spec| spec.color.is_some());
    colour(subject, &mesh, (template, user), (&shape, colored), &mut ours)?;
    let points = (!subject.calibrated).then(|| UsedVertices::new(&mesh));
    if textured == Some(false) {
        warnings.extend(texture_notes(subject, &mesh, template, colored)?);
    }
    // The placement below needs the scene with all overrides so far.
    let mut loaded = load(template, &ours, user)?;
    let turned = trimesh(&loaded, &shape).is_some_and(|spec| spec.rotate_deg != DVec3::ZERO);
    let y_is_up = main_axis(loaded.scene.camera.up) == 1 && !turned;
    if y_is_up && subject.up.is_none() && subject.rotate.is_none() {
        warnings.extend(points.as_ref().and_then(|points| side_note(subject, points)));
    }
    warnings.extend(up_note(subject, template, &loaded));
    let Some(points) = points else {
        if template.builtin {
            let studio = load(template, &ours, &Overrides::default())?;
            keep_coordinates(subject, &mesh, (&loaded, &studio), &shape, &mut ours)?;
        }
        let path = trimesh(&loaded, &shape).map_or_else(PathBuf::new, |spec| spec.path.clone());
        let (mesh, middle) = ((path, mesh), DVec3::ZERO);
        return Ok(FittedTemplate { overrides: ours, mesh, middle, stand: None });
    };
    let turned = match (subject.rotate, subject.up) {
        (Some(angles), _) => Some(("--rotate", angles)),
        (None, Some(up)) => Some(("--up", turn(up, loaded.scene.camera.up))),
        (None, None) => None,
    };
    if let Some((flag, angles)) = turned {
        ours.flag(flag, &format!("{shape}/rotate"), Some(angles.to_vec()));
        loaded = load(template, &ours, user)?;
    }
    let (middle, position) = place(subject, &points, (&loaded, user), &shape, &mut ours)?;
    let path = trimesh(&loaded, &shape).map_or_else(PathBuf::new, |spec| spec.path.clone());
    let stand = Stand {
        overrides: ours.clone(),
        path: path.clone(),
        middle,
        up: up_axis(loaded.scene.camera.up),
        warnings: warnings.clone(),
    };
    point((&loaded, user), position, middle, &mut ours);
    Ok(FittedTemplate { overrides: ours, mesh: (path, mesh), middle, stand: Some(stand) })
}

/// Returns overrides for the path and the look of the mesh, which do not depend on its contents.
fn looks(subject: &Subject, template: &Template, shape: &str) -> Result<Overrides> {
    let mut ours = Overrides::default();
    ours.flag("FILE.ply", &format!("{shape}/path"), Some(within(template, subject.path)?));
    add_looks(&subject.looks, shape, &mut ours);
    Ok(ours)
}

fn add_looks(looks: &Appearance, shape: &str, ours: &mut Overrides) {
    let smooth = looks.smooth.as_ref().map(|smooth| json!(smooth));
    ours.flag("--smooth", &format!("{shape}/smooth"), smooth);
    let color = looks.color.as_ref().map(|color| json!(color));
    ours.flag("--color", &format!("{shape}/color"), color);
    ours.flag("--points", &format!("{shape}/points"), looks.points);
}

/// Lets the looks that flags choose win over `user`, the overrides of a job file. `turned` says
/// that a flag turns the mesh. [`show`](super::show) applies the looks and the turn before `user`.
///
/// # Errors
/// A template without a trimesh.
pub fn flags_win(
    looks: &Appearance,
    turned: bool,
    template: &Template,
    user: &mut Overrides,
) -> Result<()> {
    let shape = first_trimesh(template)?;
    if turned {
        user.remove(&format!("{shape}/rotate"));
    }
    if looks.quality.is_some() {
        user.remove("/spp");
    }
    user.flags_follow();
    add_looks(looks, &shape, user);
    if let Some(image) = &looks.texture {
        let pointer = format!("{}/tPath", material(template, &shape, Some(user))?);
        user.flag("--texture", &pointer, Some(within(template, image)?));
    }
    Ok(())
}

/// Returns the shape of the mesh before it is placed, and whether its material has a texture. The
/// result decides which data of the file are read. `None` if the scene has errors, which
/// [`furnish`] reports.
pub fn wanted(subject: &Subject, template: &Template, user: &Overrides) -> Option<(Trimesh, bool)> {
    let shape = first_trimesh(template).ok()?;
    let ours = looks(subject, template, &shape).ok()?;
    let loaded = load(template, &ours, user).ok()?;
    let index: usize = shape.rsplit('/').next()?.parse().ok()?;
    let material = &loaded.scene.materials[loaded.scene.shapes.get(index)?.material];
    let textured = material.texture.is_some() || subject.looks.texture.is_some();
    let mut spec = trimesh(&loaded, &shape)?.clone();
    if let (Some(color), true) = (&mut spec.color, subject.looks.color.is_some()) {
        // Messages name the flag and not the override.
        "--color".clone_into(&mut color.place);
    }
    Some((spec, textured))
}

/// Loads the template with the path and the look of the mesh, and with the placement of its own
/// trimesh. The memory of that scene can be predicted before the mesh is read.
pub fn with_default_placement(
    subject: &Subject,
    template: &Template,
    user: &Overrides,
) -> Result<Loaded> {
    let ours = looks(subject, template, &first_trimesh(template)?)?;
    load(template, &ours, user)
}

/// Returns `path` as the template has to name it: relative to the template's folder.
fn within(template: &Template, path: &Path) -> Result<String> {
    match template.folder.as_os_str().is_empty() {
        true => named(path),
        false => seen_from(path, &template.folder),
    }
}

fn load(template: &Template, ours: &Overrides, user: &Overrides) -> Result<Loaded> {
    let mut all = ours.clone();
    all.append(user.clone());
    all.load(template.source())
}

/// Returns the JSON pointer of the template's first trimesh, which the mesh replaces.
fn first_trimesh(template: &Template) -> Result<String> {
    let document = Document::parse(&template.name, &template.text)?;
    let shapes = (0..).map(|i| format!("/scene/shapes/{i}"));
    let mut shapes = shapes.take_while(|shape| document.get(shape).is_some());
    let is_trimesh = |shape: &String| {
        let kind = document.get(&format!("{shape}/type"));
        kind.and_then(JsonNode::text) == Some("trimesh")
    };
    shapes.find(is_trimesh).ok_or_else(|| {
        let message = "found no shape of type trimesh, expected one that the mesh replaces";
        Error::invalid(document.place("/scene/shapes"), message)
    })
}

/// Sets the texture of `--texture`. In the built-in studio, the texture of the file, its colours or
/// its property replace the neutral grey.
fn colour(
    subject: &Subject,
    mesh: &Mesh,
    (template, user): (&Template, &Overrides),
    (shape, colored): (&str, bool),
    ours: &mut Overrides,
) -> Result<()> {
    let image = subject.looks.texture.as_ref();
    if image.is_none() && !template.builtin {
        return Ok(());
    }
    let material = material(template, shape, image.map(|_| user))?;
    if let Some(image) = image {
        if mesh.uvs.is_none() {
            let what = match mesh.is_cloud() {
                true => "is shown as points, without a texture",
                false => "has no texture coordinates",
            };
            let message = format!("found with {}, which {what}", subject.path.display());
            return Err(Error::invalid("--texture", message));
        }
        let path = within(template, image)?;
        ours.flag("--texture", &format!("{material}/tPath"), Some(path));
        if template.builtin {
            ours.flag("--texture", &format!("{material}/filter"), Some("trilinear"));
        }
    }
    if template.builtin {
        if mesh.colors.is_some() || mesh.face_colors.is_some() || mesh.property.is_some() {
            let white = json!([1.0, 1.0, 1.0]);
            ours.flag("FILE.ply", &format!("{material}/diffusecolor"), Some(white));
        }
        // If faces have different textures, the world loads them from the mesh.
        let single = !colored && mesh.textures.is_none();
        let image = if single { own_texture(subject, mesh)? } else { None };
        if let Some(image) = image.and_then(OwnImage::file) {
            let path = seen_from(&image, &template.folder)?;
            ours.flag("FILE.ply", &format!("{material}/tPath"), Some(path));
            ours.flag("FILE.ply", &format!("{material}/filter"), Some("trilinear"));
        }
    }
    Ok(())
}

/// Returns the JSON pointer of a shape's material, which is inline or named. `user`: the overrides
/// that follow if it gets a texture.
///
/// # Errors
/// A named material that another shape uses, too: a texture would show on both.
fn material(template: &Template, shape: &str, user: Option<&Overrides>) -> Result<String> {
    let mut document = Document::parse(&template.name, &template.text)?;
    let inline = format!("{shape}/material");
    let name =
        |document: &Document| document.get(&inline).and_then(JsonNode::text).map(str::to_string);
    let Some(own) = name(&document) else { return Ok(inline) };
    if let Some(user) = user {
        user.apply(&mut document);
    }
    let name = name(&document).unwrap_or(own);
    let others = (0..).map(|i| format!("/scene/shapes/{i}"));
    let mut others = others.take_while(|other| document.get(other).is_some());
    let uses = |other: &String| {
        let material = document.get(&format!("{other}/material"));
        other != shape && material.and_then(JsonNode::text) == Some(&name)
    };
    if let Some(other) = others.find(uses) {
        let message = format!("found the material {name:?}, which {other} has, too");
        let help = "give the mesh a material of its own";
        return Err(Error::invalid("--texture", message).help(help));
    }
    Ok(format!("/scene/materials/{}", escaped(&name)))
}

/// Returns where the image is that the mesh file names. `None` if `--texture` replaces it, or if
/// the mesh has no texture coordinates.
///
/// # Errors
/// As for [`world::own_texture`].
fn own_texture(subject: &Subject, mesh: &Mesh) -> Result<Option<OwnImage>> {
    match subject.looks.texture.is_none() && mesh.uvs.is_some() {
        true => world::own_texture(subject.path, mesh),
        false => Ok(None),
    }
}

/// Returns warnings about textures that are not shown, or that are not where the mesh says, if its
/// material has none.
///
/// # Errors
/// As for [`world::own_texture`].
fn texture_notes(
    subject: &Subject,
    mesh: &Mesh,
    template: &Template,
    colored: bool,
) -> Result<Vec<Problem>> {
    let place = || subject.path.display().to_string();
    let shows_own = !colored && mesh.textures.is_none();
    if !template.builtin || !shows_own {
        return Ok(Vec::new());
    }
    let several = || several_textures_warning(mesh, subject.path);
    let image = own_texture(subject, mesh)?;
    Ok(match (&mesh.texture_file, image) {
        (Some(_), Some(OwnImage::Named(_))) => several().into_iter().collect(),
        (Some(name), Some(OwnImage::Moved(image))) => {
            let moved = moved_texture_warning(subject.path, name, &image);
            [moved].into_iter().chain(several()).collect()
        }
        (None, _) if mesh.uvs.is_some() => {
            let message = "found texture coordinates and no texture";
            vec![Problem::new(place(), message).help("show an image on it: --texture FILE")]
        }
        (Some(name), None) if mesh.uvs.is_none() => {
            let message = format!(
                "found the texture \"{name}\", which is not used: the mesh has no texture \
                 coordinates"
            );
            vec![Problem::new(place(), message)]
        }
        // The world warns of an image that is missing.
        _ => Vec::new(),
    })
}

/// Returns a warning about a camera whose `up` is not that of the built-in studio, where things
/// stand on a plane across y, under its lights.
fn up_note(subject: &Subject, template: &Template, loaded: &Loaded) -> Option<Problem> {
    let axis = ["x", "y", "z"][main_axis(loaded.scene.camera.up)];
    if !template.builtin || subject.calibrated || axis == "y" {
        return None;
    }
    let message =
        format!("found {axis}, but y points up in the studio, with its ground and lights");
    let help = format!("if {axis} points up in the file: --up {axis}, and no `up`");
    Some(Problem::new("/camera/up", message).help(help))
}

/// Returns a warning about a mesh that seems to lie on its side, if y points up in the scene.
fn side_note(subject: &Subject, points: &UsedVertices) -> Option<Problem> {
    let [x, y, z] = size(points)?;
    let on_its_side = z > MIN_LENGTH_RATIO * x.max(y) || y < MAX_HEIGHT_RATIO * z;
    let message = format!("lies on its side? It is {x:.3} x {y:.3} x {z:.3}, and y points up");
    let problem = Problem::new(subject.path.display().to_string(), message);
    on_its_side.then(|| problem.help("if z points up: --up z"))
}

/// A mesh seems to lie on its side (z is up in its file) if its size along z is more than this
/// factor times its sizes along x and y.
const MIN_LENGTH_RATIO: f64 = 1.25;

/// A mesh also seems to lie on its side if its size along y is below this fraction of its size
/// along z.
const MAX_HEIGHT_RATIO: f64 = 0.4;

/// Returns the side lengths of the bounding box of the used vertices; `None` if there are none.
fn size(points: &UsedVertices) -> Option<[f64; 3]> {
    let Bounds { min, max } = points.bounds(|p| p);
    Some((max - min).to_array()).filter(|sides| sides.iter().all(|side| side.is_finite()))
}
