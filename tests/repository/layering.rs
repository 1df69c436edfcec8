//! The layers of the source tree: a module uses only modules of lower floors. The table of floors
//! is that of ARCHITECTURE.md.
//!
//! This reads the tokens of every file under `src/`, not only its `use` lines, so a path within a
//! function counts, too. Comments and links in documentation do not count.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::rust_files;

/// Folders and single files that may contain `unsafe`.
const UNSAFE_ALLOWED: &[&str] = &[
    "src/accel/embree/",
    "src/accel/bvh/simd/",
    "src/simd.rs",
    "src/mesh/ply/source.rs",
    "src/exhausted.rs",
    "src/memory/freed.rs",
    "src/rays/filling.rs",
    "src/shading/image_file/file_pages.rs",
];

/// Maximum number of lines of `main.rs`: everything else belongs in `cli`.
const MAIN_LINES: usize = 40;

#[test]
fn modules_use_only_lower_floors() {
    let files = source_files();
    let modules: BTreeSet<String> = files.iter().map(|file| file.modules[0].clone()).collect();
    let floors = floors();
    let floor = |module: &str| floors.get(module).copied();
    let mut complaints = Vec::new();
    for module in modules.iter().filter(|module| *module != "lib" && floor(module).is_none()) {
        complaints.push(format!(
            "src/{module} has no floor: give it a line in the table of ARCHITECTURE.md, on the \
             lowest floor that works"
        ));
    }
    for module in floors.keys().filter(|module| !modules.contains(*module)) {
        complaints.push(format!("ARCHITECTURE.md: {module} has a floor, but is no module of src/"));
    }
    for file in files.iter().filter(|file| file.modules[0] != "lib") {
        let from = &file.modules[0];
        for (line, to) in paths_to_modules(&file.tokens, &file.modules) {
            if to == *from {
                continue;
            }
            let place = format!("{}:{line}", file.name);
            match (floor(from), floor(&to)) {
                (Some(above), Some(below)) if above > below => {}
                (Some(above), Some(below)) => complaints.push(format!(
                    "{place}: {from} (floor {above}) uses {to} (floor {below}): only lower floors may be used"
                )),
                (_, None) if !modules.contains(&to) => complaints.push(format!(
                    "{place}: crate::{to} is no module of src/: name the thing by its module's path"
                )),
                _ => {} // A module without a floor is reported above, once.
            }
        }
    }
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

#[test]
fn unsafe_code_is_confined_and_justified() {
    let mut complaints = Vec::new();
    for file in source_files() {
        let allowed = UNSAFE_ALLOWED.iter().any(|place| {
            file.name == *place || place.ends_with('/') && file.name.starts_with(place)
        });
        for pair in file.tokens.windows(2).filter(|pair| pair[0].text == "unsafe") {
            let line = pair[0].line;
            if !allowed {
                complaints.push(format!(
                    "{}:{line}: unsafe is only for {}",
                    file.name,
                    UNSAFE_ALLOWED.join(", ")
                ));
            } else if ["{", "impl"].contains(&pair[1].text.as_str())
                && !says_safety(&file.text, line)
            {
                complaints.push(format!("{}:{line}: no SAFETY: comment", file.name));
            }
        }
    }
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

#[test]
fn main_is_short() {
    let lines = fs::read_to_string(root().join("src/main.rs")).unwrap().lines().count();
    assert!(
        lines < MAIN_LINES,
        "src/main.rs has {lines} lines: fewer than {MAIN_LINES} are allowed"
    );
}

#[test]
fn the_reader_of_paths_finds_all_modules() {
    let text = r##"
        //! crate::comment
        use crate::{mesh::{Mesh, self}, scene, error::Error};
        /* crate::block /* crate::nested */ crate::block */
        pub(crate) fn f<'a>(x: &'a str) -> char { crate::math::g("crate::string", r#"crate::"raw"#); '"' }
        macro_rules! m { () => { $crate::film::Film } }
        use super::sampler;
        use super::super::top as renamed;
        use self::inner::Thing;
        mod tests { use super::*; use super::super::camera; fn f() { mod deep { use super::super::own; } } }
        use super::world;
    "##;
    let found = |modules: &[&str]| -> Vec<String> {
        let modules: Vec<String> = modules.iter().map(|module| module.to_string()).collect();
        paths_to_modules(&tokens(text), &modules).into_iter().map(|(_, to)| to).collect()
    };
    // In src/accel.rs `super::` is the crate. `super::super::` leaves it and is not a valid path.
    assert_eq!(
        found(&["accel"]),
        ["mesh", "scene", "error", "math", "film", "sampler", "camera", "world"]
    );
    assert_eq!(found(&["accel", "bvh"]), ["mesh", "scene", "error", "math", "film", "top"]);
}

// -------------------------------------------------------------------------------------------------
// Files

struct Source {
    /// From the root of the repository, with forward slashes.
    name: String,
    /// The module path: `["accel", "bvh"]` for `src/accel/bvh/mod.rs` and `src/accel/bvh.rs`.
    modules: Vec<String>,
    text: String,
    tokens: Vec<Token>,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Returns the floor of every top module, from the table of ARCHITECTURE.md.
fn floors() -> BTreeMap<String, u32> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let (_, table) = text.split_once("\n| floor | modules | what |\n").expect("a table of floors");
    let mut floors = BTreeMap::new();
    // The line below the heads holds no names.
    for row in table.lines().skip(1).take_while(|line| line.starts_with('|')) {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let floor = cells[1].parse().unwrap_or_else(|_| panic!("{row}: found no floor"));
        // Names are in backticks.
        for module in cells[2].split('`').skip(1).step_by(2) {
            let before = floors.insert(module.to_owned(), floor);
            assert_eq!(before, None, "ARCHITECTURE.md: {module} has two floors");
        }
    }
    floors
}

fn source_files() -> Vec<Source> {
    rust_files("src").iter().map(|path| source(path)).collect()
}

fn source(path: &Path) -> Source {
    let text = fs::read_to_string(path).unwrap();
    let name: Vec<String> = path
        .strip_prefix(root())
        .unwrap()
        .components()
        .map(|part| part.as_os_str().to_str().unwrap().to_owned())
        .collect();
    let mut modules: Vec<String> = name[1..].iter().map(|part| part.replace(".rs", "")).collect();
    if modules.len() > 1 && modules.last().is_some_and(|module| module == "mod") {
        modules.pop();
    }
    Source { name: name.join("/"), modules, tokens: tokens(&text), text }
}

/// Returns true if a `SAFETY:` comment stands on this line, or above it with only comments,
/// attributes and the beginning of the same statement between.
fn says_safety(text: &str, line: usize) -> bool {
    let lines: Vec<&str> = text.lines().take(line).collect();
    for (step, text) in lines.iter().rev().map(|line| line.trim()).enumerate() {
        if text.contains("SAFETY:") {
            return true;
        }
        let goes_on = text.starts_with("//")
            || text.starts_with("#[")
            || !text.ends_with([';', '{', '}', ',']);
        if step > 0 && (text.is_empty() || !goes_on) {
            return false;
        }
    }
    false
}

// -------------------------------------------------------------------------------------------------
// Paths

/// Returns the top module that each path of a file leads to, with its line.
fn paths_to_modules(tokens: &[Token], modules: &[String]) -> Vec<(usize, String)> {
    let text = |at: usize| tokens.get(at).map_or("", |token: &Token| token.text.as_str());
    let mut found = Vec::new();
    // Inside `mod name { ... }`, `super` leads only out of that block.
    let mut braces = 0;
    let mut inline_modules = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        match text(at) {
            "{" => braces += 1,
            "}" => {
                braces -= 1;
                if inline_modules.last() == Some(&braces) {
                    inline_modules.pop();
                }
            }
            "mod" if text(at + 2) == "{" => inline_modules.push(braces),
            "crate" | "lightpath" if text(at + 1) == "::" && text(at.wrapping_sub(1)) != "::" => {
                names_after(tokens, at + 2, &mut found);
            }
            "super" if text(at + 1) == "::" && text(at.wrapping_sub(1)) != "::" => {
                let mut levels = 0;
                while text(at) == "super" && text(at + 1) == "::" {
                    levels += 1;
                    at += 2;
                }
                if levels == modules.len() + inline_modules.len() {
                    names_after(tokens, at, &mut found);
                }
                continue;
            }
            _ => {}
        }
        at += 1;
    }
    found
}

/// Collects the first names of the rest of a path: `a` of `a::b`, and `a` and `c` of `{a::b, c}`.
fn names_after(tokens: &[Token], start: usize, found: &mut Vec<(usize, String)>) {
    let mut push = |token: &Token| {
        if token.text.starts_with(|first: char| first.is_alphabetic() || first == '_') {
            found.push((token.line, token.text.clone()));
        }
    };
    match tokens.get(start) {
        Some(token) if token.text != "{" => push(token),
        _ => {
            let mut depth = 0;
            for pair in tokens[start..].windows(2) {
                match pair[0].text.as_str() {
                    "{" => depth += 1,
                    "}" => depth -= 1,
                    _ => {}
                }
                if depth == 0 {
                    break;
                }
                if depth == 1 && ["{", ","].contains(&pair[0].text.as_str()) {
                    push(&pair[1]);
                }
            }
        }
    }
}

// -------------------------------------------------------------------------------------------------
// Tokens

struct Token {
    line: usize,
    text: String,
}

/// Returns the words and signs of a Rust file, without comments and without the content of
/// literals.
fn tokens(text: &str) -> Vec<Token> {
    let text: Vec<char> = text.chars().collect();
    let mut tokens = Vec::new();
    let (mut at, mut line) = (0, 1);
    while at < text.len() {
        let start = at;
        let next = text.get(at + 1).copied().unwrap_or('\0');
        match text[at] {
            '/' if next == '/' => at = find(&text, at, "\n"),
            '/' if next == '*' => at = end_of_block_comment(&text, at),
            '"' => at = end_of_quotes(&text, at, '"'),
            // A lifetime is 'name without a closing quote; everything else is a character.
            '\'' if next != '\\' && text.get(at + 2) != Some(&'\'') => at += 1,
            '\'' => at = end_of_quotes(&text, at, '\''),
            first if first.is_alphanumeric() || first == '_' => {
                while at < text.len() && (text[at].is_alphanumeric() || text[at] == '_') {
                    at += 1;
                }
                let word: String = text[start..at].iter().collect();
                let hashes = text[at..].iter().take_while(|sign| **sign == '#').count();
                if ["r", "br", "cr"].contains(&word.as_str()) && text.get(at + hashes) == Some(&'"')
                {
                    let closing = format!("\"{}", "#".repeat(hashes));
                    at = find(&text, at + hashes + 1, &closing) + closing.len();
                } else {
                    tokens.push(Token { line, text: word });
                }
            }
            ':' if next == ':' => {
                tokens.push(Token { line, text: "::".to_owned() });
                at += 2;
            }
            first => {
                if !first.is_whitespace() {
                    tokens.push(Token { line, text: first.to_string() });
                }
                at += 1;
            }
        }
        at = at.min(text.len());
        line += text[start..at].iter().filter(|sign| **sign == '\n').count();
    }
    tokens
}

/// Returns the position of `wanted` at or after `start`, or the end of the text.
fn find(text: &[char], start: usize, wanted: &str) -> usize {
    let wanted: Vec<char> = wanted.chars().collect();
    (start..text.len()).find(|at| text[*at..].starts_with(&wanted)).unwrap_or(text.len())
}

fn end_of_block_comment(text: &[char], start: usize) -> usize {
    let (mut at, mut depth) = (start, 0);
    while at < text.len() {
        match text[at..].get(..2) {
            Some(['/', '*']) => depth += 1,
            Some(['*', '/']) => depth -= 1,
            _ => {
                at += 1;
                continue;
            }
        }
        at += 2;
        if depth == 0 {
            break;
        }
    }
    at
}

fn end_of_quotes(text: &[char], start: usize, quote: char) -> usize {
    let mut at = start + 1;
    while at < text.len() && text[at] != quote {
        at += if text[at] == '\\' { 2 } else { 1 };
    }
    at + 1
}
