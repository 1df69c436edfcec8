//! Versions of the program, its compiler and its libraries.

use std::collections::BTreeMap;

use crate::simd::Isa;

/// Version of this crate.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
const COMMIT: Option<&str> = option_env!("LIGHTPATH_GIT_COMMIT");
const RUSTC: Option<&str> = option_env!("LIGHTPATH_RUSTC_VERSION");

/// Returns the text of `--version`.
pub fn text(verbose: bool) -> String {
    let mut text = format!("lightpath {VERSION}\n");
    if !verbose {
        return text;
    }
    let tiers: Vec<String> = Isa::compiled().iter().map(Isa::to_string).collect();
    let lines = [
        ("commit", COMMIT.unwrap_or("unknown").to_string()),
        ("rustc", RUSTC.unwrap_or("unknown").to_string()),
        ("embree", embree()),
        ("kernels", format!("{} (compiled in: {})", Isa::detect(), tiers.join(", "))),
    ];
    for (name, value) in lines {
        text.push_str(&format!("{name}: {value}\n"));
    }
    text
}

/// Returns the versions for the statistics of a render or measurement.
pub fn versions(backend: &str) -> BTreeMap<String, String> {
    let pairs = [
        ("lightpath", VERSION),
        ("commit", COMMIT.unwrap_or("unknown")),
        ("rustc", RUSTC.unwrap_or("unknown")),
        ("backend", backend),
    ];
    pairs.map(|(k, v)| (k.to_string(), v.to_string())).into()
}

/// Returns the version of Embree and its instruction set, or why it cannot be used.
#[cfg(feature = "embree")]
fn embree() -> String {
    match crate::accel::embree::describe() {
        Ok((version, isa)) => format!("{version} ({isa})"),
        Err(error) => match error.problems.first() {
            Some(problem) => format!("not available: {}", problem.message),
            None => "not available".to_string(),
        },
    }
}

#[cfg(not(feature = "embree"))]
fn embree() -> String {
    "not compiled in".to_string()
}
