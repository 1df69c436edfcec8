//! Writes `index.html`: one card per input, which can be sorted and searched. Failures are red.

use std::fmt::Write;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use crate::batch::job::Job;
use crate::error::Problem;
use crate::report::escape;
use crate::units;

use super::entry::SheetEntry;
use super::thumbnails::Strip;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// What stands near the start of every page.
const TITLE: &str = "<title>Contact sheet</title>";
/// Bytes of a page in which the title is looked for.
const START: u64 = 4096;

/// Returns true if a file is there that is no page of a contact sheet. An empty file does not
/// count: nothing is lost with it.
pub fn is_foreign(path: &Path) -> bool {
    if !std::fs::metadata(path).is_ok_and(|data| data.is_file() && data.len() > 0) {
        return false;
    }
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(START).read_to_end(&mut start));
    read.is_err() || !start.windows(TITLE.len()).any(|bytes| bytes == TITLE.as_bytes())
}

/// Returns the text of the page. `problems` has those of each input, or is empty.
pub fn html(
    job: &Job,
    entries: &[SheetEntry],
    strips: &[Option<Strip>],
    problems: &[Vec<Problem>],
) -> String {
    let mut html = String::new();
    let frames: usize = entries.iter().map(|entry| entry.frames.len()).sum();
    let of: u64 = entries.iter().map(|entry| u64::from(entry.of)).sum();
    let failed = entries.iter().filter(|entry| !entry.failures.is_empty()).count();
    let seconds: f64 = entries.iter().map(SheetEntry::seconds).sum();
    let rays: u64 = entries.iter().map(SheetEntry::rays).sum();
    let _ = write!(
        html,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         {TITLE}\n<style>\n{STYLE}</style>\n</head>\n<body>\n<header>\n\
         <h1>Contact sheet</h1>\n<p>{}, {} of {}, \
         <span class=\"{}\">{failed} failed</span>; frames took {}, {} million rays</p>\n\
         <p class=\"controls\"><label>Sort by <select id=\"sort\">\
         <option value=\"order\">input order</option><option value=\"name\">name</option>\
         <option value=\"state\">failures first</option><option value=\"triangles\">triangles</option>\
         <option value=\"seconds\">time</option><option value=\"rays\">rays</option>\
         <option value=\"bytes\">memory</option></select></label> \
         <label><input type=\"checkbox\" id=\"down\"> descending</label> \
         <label><input type=\"checkbox\" id=\"bad\"> failures only</label> \
         <label>Find <input type=\"search\" id=\"find\"></label></p>\n</header>\n<main>\n",
        units::plural(entries.len(), "input"),
        units::count(frames as u64),
        units::plural(of as usize, "frame"),
        if failed > 0 { "bad" } else { "good" },
        units::duration(seconds),
        units::count(rays / 1_000_000),
    );
    for (entry, strip) in entries.iter().zip(strips) {
        let problems = problems.get(entry.number).map_or(&[][..], Vec::as_slice);
        card(&mut html, job, entry, strip.as_ref(), problems);
    }
    let _ = write!(html, "</main>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n");
    html
}

fn card(
    html: &mut String,
    job: &Job,
    entry: &SheetEntry,
    strip: Option<&Strip>,
    problems: &[Problem],
) {
    let failure = entry.message();
    let missing = entry.frames.len() < entry.of as usize;
    let (class, state) = match (&failure, missing || !problems.is_empty()) {
        (Some(_), _) => ("failed", 0),
        (None, true) => ("missing", 1),
        (None, false) => ("done", 2),
    };
    let (triangles, bytes) =
        entry.mesh.as_ref().map_or((0, 0), |mesh| (mesh.triangles, mesh.bytes));
    let _ = writeln!(
        html,
        "<article class=\"{class}\" data-order=\"{}\" data-name=\"{}\" data-state=\"{state}\" \
         data-triangles=\"{triangles}\" data-seconds=\"{:.3}\" data-rays=\"{}\" data-bytes=\"{bytes}\">",
        entry.number,
        escape(entry.name()),
        entry.seconds(),
        entry.rays(),
    );
    match strip {
        Some(strip) => picture(html, job, entry, strip),
        None => html.push_str("<div class=\"empty\">no picture</div>\n"),
    }
    let _ = writeln!(html, "<h2 title=\"{}\">{}</h2>", escape(&entry.input), escape(entry.name()));
    if let Some(message) = &failure {
        let _ = writeln!(html, "<p class=\"message\">{}</p>", escape(message));
    }
    // The reason of missing frames is the first line of the failure.
    let told = failure.as_ref().and_then(|message| message.lines().next());
    for problem in problems.iter().filter(|p| told.is_none_or(|line| !p.message.contains(line))) {
        let _ = writeln!(html, "<p class=\"message\">{}</p>", escape(&problem.message));
    }
    let mut facts = vec![("frames", format!("{} of {}", entry.frames.len(), entry.of))];
    let absent: Vec<u32> = (0..entry.of).filter(|n| !entry.frames.contains_key(n)).collect();
    if missing {
        facts.push(("missing", units::ranges(&absent)));
    }
    if let Some(mesh) = &entry.mesh {
        facts.push(("triangles", units::count(mesh.triangles)));
        let read = format!("{} + {}", units::duration(mesh.load_s), units::duration(mesh.build_s));
        facts.push(("load + build", read));
        facts.push(("memory", units::bytes(mesh.bytes)));
    }
    let seconds = entry.seconds();
    if seconds > 0.0 {
        let each = seconds / entry.frames.values().flatten().count() as f64;
        facts.push(("a frame", units::duration(each)));
        facts.push(("rays", format!("{:.1} Mray/s", entry.rays() as f64 / seconds / 1e6)));
    }
    html.push_str("<dl>");
    for (name, value) in facts {
        let _ = write!(html, "<div><dt>{name}</dt><dd>{value}</dd></div>");
    }
    html.push_str("</dl>\n");
    let warnings = entry.warnings();
    if !warnings.is_empty() {
        let _ = write!(html, "<details><summary>warnings: {}</summary>", warnings.len());
        for warning in warnings {
            let _ = write!(html, "<p>{}</p>", escape(warning));
        }
        html.push_str("</details>\n");
    }
    html.push_str("</article>\n");
}

/// Writes the thumbnail of one frame as a link to its file. The mouse or the slider selects another
/// frame.
fn picture(html: &mut String, job: &Job, entry: &SheetEntry, strip: &Strip) {
    let count = strip.frames.len();
    let [width, height] = strip.cell;
    let data = STANDARD.encode(&strip.jpeg);
    let files = strip.frames.iter().map(|&frame| address(job, entry.number, frame));
    let files: Vec<String> = files.collect();
    let (first, name) = (files.first().map_or("", String::as_str), escape(entry.name()));
    let list = escape(&serde_json::to_string(&files).unwrap_or_default());
    let _ = writeln!(
        html,
        "<a class=\"strip\" href=\"{first}.png\" data-ending=\".png\" data-files=\"{list}\" \
         data-count=\"{count}\" style=\"aspect-ratio:{width}/{height}\">\
         <img alt=\"{name}\" style=\"width:{}%\" src=\"data:image/jpeg;base64,{data}\"></a>",
        100 * count,
    );
    if count > 1 {
        let _ = writeln!(
            html,
            "<input type=\"range\" min=\"0\" max=\"{}\" value=\"0\" aria-label=\"frame\">",
            count - 1
        );
    }
    let link =
        |ending| format!("<a href=\"{first}.{ending}\" data-ending=\".{ending}\">{ending}</a>");
    let _ = writeln!(html, "<p class=\"files\">{} {}</p>", link("png"), link("exr"));
}

/// Returns the path of a frame relative to the page, without the ending, as a relative URL.
fn address(job: &Job, input: usize, frame: u32) -> String {
    let prefix = job.prefix(input, frame);
    let path = prefix.strip_prefix(&job.folder).unwrap_or(&prefix);
    let mut url = String::new();
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'/' | b'-' | b'_' | b'.' | b'~' => url.push(char::from(*byte)),
            byte if byte.is_ascii_alphanumeric() => url.push(char::from(*byte)),
            byte => url.push_str(&format!("%{byte:02X}")),
        }
    }
    url
}
