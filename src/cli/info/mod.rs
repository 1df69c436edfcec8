//! `lightpath info`: describes files and checks whether they would render.
//!
//! The first bytes of a file decide its type. If they are not those of a PLY or EXR file, an ending
//! such as `.ply.gz` makes it a mesh, and any other file is a scene. All files are checked, also
//! after an invalid one, and all errors are reported at the end.

pub mod args;
mod attributes;
mod cameras;
mod facts;
mod scene;

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use ::exr::compression::Compression;
use ::exr::meta::MetaData;
use ::exr::meta::header::Header;
use serde_json::{Map, Value, json};

use crate::accel::memory_footprint;
use crate::error::{Error, Failures, Problem, Result};
use crate::film::Window;
use crate::memory::{self, Prediction};
use crate::monitor::Monitor;
use crate::output::exr_check::{check_whole, exr_error};
use crate::scene::{Backend, Overrides};
use crate::studio::{self, Appearance, Studio, Subject, Template, UsedVertices};
use crate::world::{Bounds, Detail};
use crate::{mesh, units};

use super::print;

use self::args::InfoArgs;
use self::facts::{Facts, resolution_line};

/// Describes every file, then reports all errors.
pub fn run(args: &InfoArgs) -> Result<()> {
    let mut failures = Failures::default();
    for path in &args.files {
        let described = describe(path, args);
        if let (Err(error), true) = (&described, args.json) {
            print::json(&error_json(path, error))?;
        }
        match failures.keep(described) {
            Some(facts) if args.json => print::json(&facts.json())?,
            Some(mut facts) => print::text(&facts.begin(path))?,
            None => {}
        }
    }
    failures.check()
}

fn error_json(path: &Path, error: &Error) -> Value {
    let one = |p: &Problem| json!({ "place": p.place, "message": p.message, "help": p.help });
    let errors: Vec<Value> = error.problems.iter().map(one).collect();
    json!({ "file": path.display().to_string(), "ok": false, "errors": errors })
}

fn describe(path: &Path, args: &InfoArgs) -> Result<Facts> {
    // The first bytes of a pipe could not be read again, and one without a writer would never end.
    let is_special = |data: std::fs::Metadata| !data.is_file() && !data.is_dir();
    if path == Path::new("-") || std::fs::metadata(path).is_ok_and(is_special) {
        let message = "found a pipe or a device, expected a regular file";
        return Err(Error::invalid(path.display().to_string(), message)
            .help("write its contents to a file first"));
    }
    let mut start = Vec::new();
    let opened = File::open(path).and_then(|file| file.take(4).read_to_end(&mut start));
    let mut facts = Facts::default();
    facts.add("file", json!(path.display().to_string()), "");
    facts.add("ok", json!(true), "");
    match opened {
        // A folder can be opened but not read. The scene parser gives the best message for it.
        Err(error) if error.kind() != ErrorKind::IsADirectory => {
            return Err(Error::io(path, "read", &error));
        }
        _ => {}
    }
    match start.as_slice() {
        b"ply\n" | b"ply\r" => ply(path, args, &mut facts)?,
        _ if args.cameras.is_some() && !studio::is_mesh(path) => {
            return Err(cameras::refuse(&path.display().to_string()));
        }
        [0x76, 0x2f, 0x31, 0x01] => exr(path, &mut facts)?,
        _ if studio::is_mesh(path) => ply(path, args, &mut facts)?,
        _ => scene::describe(path, args, &mut facts)?,
    }
    Ok(facts)
}

/// Array size in bytes above which the header's facts are printed before the mesh is read, because
/// reading takes long.
const LARGE_MESH_BYTES: u64 = 256 << 20;

fn ply(path: &Path, args: &InfoArgs, facts: &mut Facts) -> Result<()> {
    let (summary, cloud) = inspect(path)?;
    if cloud && args.cameras.is_some() {
        return Err(cameras::refuse(&format!("{}, which has no faces", path.display())));
    }
    let packed = summary.packed.map_or(String::new(), |packing| format!(", packed with {packing}"));
    facts.add("type", json!("ply"), format!("PLY, {}{packed}", summary.format));
    let elements = summary.elements.iter().map(|element| {
        let names = element.properties.iter().map(|p| p.name.as_str());
        let names: Vec<&str> = names.collect();
        format!("{} {} ({})", units::count(element.count), element.name, names.join(" "))
    });
    let line = format!("elements: {}", elements.collect::<Vec<_>>().join(", "));
    facts.add("header", json!(summary), line);
    let list = |names: &[String]| match names.is_empty() {
        true => "none".to_string(),
        false => names.join(", "),
    };
    facts.add("used", json!(summary.used), format!("used: {}", list(&summary.used)));
    facts.add("ignored", json!(summary.ignored), format!("ignored: {}", list(&summary.ignored)));
    let missing = if summary.missing.is_empty() { "nothing" } else { &summary.missing.join(", ") };
    facts.add("missing", json!(summary.missing), format!("missing: {missing}"));
    if let Some(of) = summary.colors_of {
        facts.add("colors_of", json!(of), format!("colours: of each {of}"));
    }
    let line = format!("for --color: {}", list(&summary.scalars));
    facts.add("scalars", json!(summary.scalars), line);
    if let Some(texture) = summary.texture_files.first() {
        let all = list(&summary.texture_files);
        facts.add("texture_file", json!(texture), format!("texture: {all}"));
    }
    if let Some(prediction) = prediction(path, args, cloud) {
        let line = format!(
            "memory in the studio: about {} at most: {prediction}",
            units::bytes(prediction.peak_bytes)
        );
        facts.add("memory", json!(prediction), line);
    }
    if summary.array_bytes > LARGE_MESH_BYTES && !args.json {
        print::text(&facts.begin(path))?;
    }
    let memory_limit = memory::limit_of_machine();
    let subject = Subject { no_mmap: args.no_mmap, memory_limit, ..Subject::new(path) };
    let wanted = mesh::ReadOptions::default().points(cloud);
    let mesh = studio::read(&subject, wanted, &Monitor::default())?;
    if cloud {
        points(&mesh, facts);
        return Ok(());
    }
    let triangles = mesh.triangles.len() as u64;
    facts.add("triangles", json!(triangles), units::plural(mesh.triangles.len(), "triangle"));
    notes(&mesh.notes, mesh.stitches.len() as u64, facts);
    let points = UsedVertices::new(&mesh);
    let what = ["vertex that no triangle uses", "vertices that no triangle uses"];
    facts.add_count("vertices_unused", points.unused(), what);
    let Bounds { min: low, max: high } = points.bounds(|p| p);
    let size = high - low;
    let line = format!("bounds of the triangles: {low} to {high}, size {size}");
    facts.add("bounds", json!([low.to_array(), high.to_array()]), line);
    resolution(&mesh, Bounds { min: low, max: high }, facts);
    drop(mesh);
    args.cameras.as_ref().map_or(Ok(()), |list| cameras::describe(path, list, args, facts))
}

/// Reads the header of a mesh, or of a cloud of points. The second value is true for a cloud.
fn inspect(path: &Path) -> Result<(mesh::PlySummary, bool)> {
    mesh::inspect_ply(path).map(|summary| (summary, false)).or_else(|error| {
        let options = mesh::ReadOptions::default().points(true);
        let Ok(summary) = mesh::inspect_ply_with(path, &options) else { return Err(error) };
        let is_face = |name: &str| matches!(name, "face" | "tristrips");
        let mut elements = summary.elements.iter();
        let faces = elements.any(|element| is_face(&element.name) && element.count > 0);
        if faces { Err(error) } else { Ok((summary, true)) }
    })
}

/// One byte, and several, that a file has beyond its rows.
const TRAILING: [&str; 2] =
    ["byte after the last declared row", "bytes after the last declared row"];

/// Adds the facts of a cloud of points.
fn points(mesh: &mesh::Mesh, facts: &mut Facts) {
    let count = mesh.positions.len();
    facts.add("points", json!(count), units::plural(count, "point"));
    facts.add_count("trailing_bytes", mesh.notes.trailing_bytes, TRAILING);
    let Bounds { min: low, max: high } = UsedVertices::new(mesh).bounds(|p| p);
    let size = high - low;
    let line = format!("bounds of the points: {low} to {high}, size {size}");
    facts.add("bounds", json!([low.to_array(), high.to_array()]), line);
    // Half the distance of neighbours if the points lay evenly on the surface of the bounding box,
    // rounded to one digit.
    let area = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
    let radius = (area / count as f64).sqrt() / 2.0;
    if radius.is_normal() {
        let radius: f64 = format!("{radius:.0e}").parse().unwrap_or(radius);
        let line = format!("a radius to start with: --points {radius}");
        facts.add("radius", json!(radius), line);
    }
}

/// Adds the resolution of single precision relative to the middle of the mesh.
fn resolution(mesh: &mesh::Mesh, bounds: Bounds, facts: &mut Facts) {
    let origin = bounds.origin();
    let exact = |i: u32| mesh.positions.get(i as usize);
    let rounded = |p: glam::DVec3| (p - origin).as_vec3().to_array();
    let farthest = (bounds.min - origin).abs().max((bounds.max - origin).abs()).max_element();
    let one = Detail::new(farthest, &mesh.triangles, 1.0, exact, rounded);
    facts.add("resolution", json!(one), resolution_line(&one, " around its middle"));
}

/// Predicts the memory of a render in the built-in studio from the header alone.
fn prediction(path: &Path, args: &InfoArgs, cloud: bool) -> Option<Prediction> {
    let looks = Appearance { points: cloud.then_some(1.0), ..Appearance::default() };
    let subject = Subject { looks, ..Subject::new(path) };
    let template = Template::studio(Studio::default());
    let loaded = studio::with_default_placement(&subject, &template, &Overrides::default()).ok()?;
    let camera = &loaded.scene.camera;
    let window = Window::full(camera.width, camera.height);
    let prediction = memory::predict(&loaded.scene, window).ok()?;
    let backend = args.backend.map_or(loaded.scene.backend, Backend::from);
    let footprint = memory_footprint(backend, rayon::current_num_threads());
    Some(match footprint {
        Ok(footprint) => prediction.with(&footprint),
        Err(_) => prediction,
    })
}

fn notes(notes: &mesh::Notes, stitches: u64, facts: &mut Facts) {
    let counts = [
        ("faces", notes.faces, ["face", "faces"]),
        (
            "polygons_split",
            notes.polygons_split,
            ["polygon split into triangles", "polygons split into triangles"],
        ),
        (
            "faces_too_small",
            notes.faces_too_small,
            [
                "face with fewer than three corners skipped",
                "faces with fewer than three corners skipped",
            ],
        ),
        (
            "degenerate_dropped",
            notes.degenerate_dropped.saturating_sub(stitches),
            ["triangle without area dropped", "triangles without area dropped"],
        ),
        (
            "stitches",
            stitches,
            [
                "triangle without area kept: it closes a T-junction",
                "triangles without area kept: they close T-junctions",
            ],
        ),
        (
            "duplicates_dropped",
            notes.duplicates_dropped,
            ["duplicate triangle dropped", "duplicate triangles dropped"],
        ),
        (
            "textures",
            notes.textures.saturating_sub(1),
            ["more texture selected by texnumber", "more textures selected by texnumber"],
        ),
        ("trailing_bytes", notes.trailing_bytes, TRAILING),
    ];
    for (key, count, what) in counts {
        facts.add_count(key, count, what);
    }
}

fn exr(path: &Path, facts: &mut Facts) -> Result<()> {
    let read = MetaData::read_from_file(path, true);
    let meta = read.map_err(|error| exr_error(path, error))?;
    let parts = meta.headers.len();
    facts.add("type", json!("exr"), format!("EXR, {}", units::plural(parts, "part")));
    let parts: Vec<Value> = meta.headers.iter().map(|header| part(header, facts)).collect();
    facts.add("parts", json!(parts), "");
    check_whole(path)
}

fn part(header: &Header, facts: &mut Facts) -> Value {
    let display = header.shared_attributes.display_window;
    let data = header.own_attributes.layer_position;
    let size = header.layer_size;
    facts.lines.push(format!(
        "frame {} x {}, data {} x {} at {}, {}; {}, {:?}",
        display.size.x(),
        display.size.y(),
        size.x(),
        size.y(),
        data.x(),
        data.y(),
        compression(header.compression),
        header.line_order
    ));
    let own = &header.own_attributes;
    let name = own.layer_name.as_ref().map(ToString::to_string);
    facts.lines.extend(name.as_ref().map(|name| format!("part {name}")));
    let channels = header.channels.list.iter();
    let channels: Vec<[String; 2]> = channels
        .map(|c| [c.name.to_string(), format!("{:?}", c.sample_type).to_lowercase()])
        .collect();
    let names: Vec<String> = channels.iter().map(|[name, kind]| format!("{name} {kind}")).collect();
    facts.lines.push(format!("channels: {}", names.join(", ")));
    let attributes = attributes::attributes(header);
    facts.lines.extend(attributes.iter().map(|(name, text)| format!("{name}: {text}")));
    let attributes: Map<String, Value> =
        attributes.into_iter().map(|(name, text)| (name, text.into())).collect();
    json!({
        "name": name,
        "display_window": [display.position.x(), display.position.y(), display.size.x(), display.size.y()],
        "data_window": [data.x(), data.y(), size.x(), size.y()],
        "compression": compression(header.compression),
        "channels": channels,
        "attributes": attributes,
    })
}

/// Returns the name of a method, as `--compression` and OpenEXR's tools have it.
fn compression(method: Compression) -> &'static str {
    match method {
        Compression::Uncompressed => "none",
        Compression::RLE => "rle",
        Compression::ZIP1 => "zips",
        Compression::ZIP16 => "zip",
        Compression::PIZ => "piz",
        Compression::PXR24 => "pxr24",
        Compression::B44 => "b44",
        Compression::B44A => "b44a",
        Compression::DWAA(_) => "dwaa",
        Compression::DWAB(_) => "dwab",
        Compression::HTJ2K32 => "htj2k32",
        Compression::HTJ2K256 => "htj2k256",
    }
}
