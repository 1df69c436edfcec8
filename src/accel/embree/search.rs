//! Where Embree's library is looked for.
//!
//! The program has no run path: the loader would look there for every library, in folders that are
//! relative to the program. Beside a copy of it, these are folders of anybody.

use std::env;
use std::path::{Path, PathBuf};

/// Name of the library that `build.rs` found, else the soname of Embree 4.
const FILE: &str = match option_env!("LIGHTPATH_EMBREE_FILE") {
    Some(file) => file,
    None => "libembree4.so.4",
};

/// Folder that `EMBREE_DIR` named when the program was built.
const CHOSEN: Option<&str> = option_env!("LIGHTPATH_EMBREE_DIR");

/// The checkout's folder, relative to that of the program, or absolute.
const VENDOR: Option<&str> = option_env!("LIGHTPATH_VENDOR");

/// Returns the file to load: its path, or only its name, which the dynamic loader then searches for
/// in `LD_LIBRARY_PATH` and the folders of the system.
pub fn library() -> PathBuf {
    let of_loader = env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    // An unset variable is split into one empty name.
    let mut folders = env::split_paths(&of_loader).filter(|folder| !folder.as_os_str().is_empty());
    if folders.any(|folder| folder.join(FILE).is_file()) {
        return FILE.into();
    }
    let program = env::current_exe().and_then(|program| program.canonicalize());
    let own = program.iter().flat_map(|program| self::folders(program));
    own.map(|folder| folder.join(FILE)).find(|file| file.is_file()).unwrap_or(FILE.into())
}

/// Returns the folders that belong to a program: that of an installation, the one that `EMBREE_DIR`
/// named, and that of the checkout for what cargo has built there.
fn folders(program: &Path) -> Vec<PathBuf> {
    let own = program.parent().unwrap_or(program);
    let is_named = |names: &[&str]| names.iter().any(|name| own.ends_with(name));
    let mut folders = Vec::new();
    if is_named(&["bin"]) {
        folders.push(own.with_file_name("lib").join("lightpath"));
    }
    folders.extend(CHOSEN.filter(|folder| !folder.is_empty()).map(PathBuf::from));
    // Tests and examples are a folder deeper.
    let built = if is_named(&["deps", "examples"]) { own.parent().unwrap_or(own) } else { own };
    if built.join("deps").is_dir() {
        folders.extend(VENDOR.filter(|folder| !folder.is_empty()).map(|way| built.join(way)));
    }
    folders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_looks_in_no_folder_beside_it() {
        let scratch = tempfile::tempdir().unwrap();
        let root = scratch.path().canonicalize().unwrap();
        let chosen: Vec<PathBuf> =
            CHOSEN.filter(|folder| !folder.is_empty()).map(PathBuf::from).into_iter().collect();
        let of = |program: &str| {
            let all = folders(&root.join(program));
            all.into_iter().filter(|folder| !chosen.contains(folder)).collect::<Vec<_>>()
        };
        assert_eq!(of("ann/bin/lightpath"), [root.join("ann/lib/lightpath")]);
        assert_eq!(of("ann/lightpath"), Vec::<PathBuf>::new());
        assert_eq!(of("ann/target/release/lightpath"), Vec::<PathBuf>::new());
        std::fs::create_dir_all(root.join("ann/target/release/deps")).unwrap();
        let built = of("ann/target/release/lightpath");
        assert_eq!(of("ann/target/release/deps/library-0123"), built);
        assert_eq!(of("ann/target/release/examples/rays"), built);
        let way = VENDOR.filter(|way| !way.is_empty());
        assert_eq!(
            built,
            way.map(|way| root.join("ann/target/release").join(way))
                .into_iter()
                .collect::<Vec<_>>()
        );
    }
}
