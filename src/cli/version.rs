//! Versions of the program, its compiler and its backends.

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
    let mut lines = vec![
        ("commit".to_string(), COMMIT.unwrap_or("unknown").to_string()),
        ("rustc".to_string(), RUSTC.unwrap_or("unknown").to_string()),
    ];
    lines.extend(backends());
    let tiers: Vec<String> = Isa::compiled().iter().map(Isa::to_string).collect();
    let tiers = format!("{} (compiled in: {})", Isa::detect(), tiers.join(", "));
    lines.push(("kernels".to_string(), tiers));
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

/// Returns name and version of Embree, or why it is not available.
fn backends() -> Vec<(String, String)> {
    #[cfg(feature = "embree")]
    let embree = match crate::accel::embree::describe() {
        Ok((version, isa)) => format!("{version} ({isa})"),
        Err(error) => match error.problems.first() {
            Some(problem) => format!("not available: {}", problem.message),
            None => "not available".to_string(),
        },
    };
    #[cfg(not(feature = "embree"))]
    let embree = "not compiled in".to_string();
    vec![("embree".to_string(), embree)]
}
