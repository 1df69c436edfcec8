//! Where Embree's library is looked for.
//!
//! The program has no run path: the loader would look there for every library, in folders that are
//! relative to the program. Beside a copy of it, these are folders of anybody.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// Name of the library that `build.rs` found, else the soname of Embree 4.
const FILE: &str = match option_env!("LIGHTPATH_EMBREE_FILE") {
    Some(file) => file,
    None => "libembree4.so.4",
};

/// Folder that `EMBREE_DIR` named when the program was built.
const CHOSEN: Option<&str> = option_env!("LIGHTPATH_EMBREE_DIR");

/// The checkout's folder, relative to that of the program, or absolute.
const VENDOR: Option<&str> = option_env!("LIGHTPATH_VENDOR");

/// The file to load, and what was left out.
#[derive(Debug, PartialEq, Eq)]
pub struct Library {
    /// The path of the file, or only its name, which the dynamic loader then searches for in
    /// `LD_LIBRARY_PATH` and the folders of the system.
    pub file: PathBuf,
    /// A file that other users can change: see [`is_trusted`].
    pub left_out: Option<PathBuf>,
}

impl Library {
    /// Returns what to do about the file that was left out, if there is one.
    pub fn help(&self) -> Option<String> {
        let file = self.left_out.as_ref()?.display();
        Some(format!(
            "{file} was left out: it or its folder is of another user than the program, or all may write it; make it \
             yours, or name the folder in LD_LIBRARY_PATH"
        ))
    }
}

/// Looks for the library as the program of this process.
pub fn library() -> Library {
    let of_loader = env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    // The name of a program that was removed or replaced has an addition, but no other folder.
    let program = env::current_exe().map(|path| path.canonicalize().unwrap_or(path));
    let (Ok(program), Ok(data)) = (program, fs::metadata("/proc/self/exe")) else {
        return Library { file: FILE.into(), left_out: None };
    };
    find(&of_loader, &program, data.uid())
}

/// Looks for the library of a `program` of user `owner`. `of_loader` is `LD_LIBRARY_PATH`.
fn find(of_loader: &OsStr, program: &Path, owner: u32) -> Library {
    let mut found = Library { file: FILE.into(), left_out: None };
    // The loader separates its folders by either sign. An empty name is the working folder: it
    // does not keep the program from its own.
    let mut named = of_loader.as_bytes().split(|byte| b":;".contains(byte));
    let has_file = |folder: &[u8]| Path::new(OsStr::from_bytes(folder)).join(FILE).is_file();
    if named.any(|folder| !folder.is_empty() && has_file(folder)) {
        return found;
    }
    for folder in folders(program) {
        // Without links, which somebody could change between the look and the loading.
        let Ok(path) = folder.path.canonicalize() else { continue };
        let file = path.join(FILE);
        match file.is_file() {
            true if folder.is_chosen || is_trusted(&path, &file, owner) => {
                return Library { file, ..found };
            }
            true => found.left_out = Some(file),
            false => {}
        }
    }
    found
}

/// Returns whether a folder and its file are of the system or of `owner`, and not everybody may
/// change them. Anybody can make `lib/lightpath` beside a `bin` in a folder of all.
fn is_trusted(folder: &Path, file: &Path, owner: u32) -> bool {
    let is_safe = |path| {
        let data = fs::metadata(path);
        data.is_ok_and(|data| [0, owner].contains(&data.uid()) && data.mode() & 0o002 == 0)
    };
    [folder, file].into_iter().all(is_safe)
}

/// A folder that belongs to a program.
struct Folder {
    path: PathBuf,
    /// Whoever built the program named it.
    is_chosen: bool,
}

/// Returns the folders that belong to a program: that of an installation, the one that `EMBREE_DIR`
/// named, and that of the checkout for what cargo has built there.
fn folders(program: &Path) -> Vec<Folder> {
    let own = program.parent().unwrap_or(program);
    let is_named = |names: &[&str]| names.iter().any(|name| own.ends_with(name));
    let mut folders = Vec::new();
    if is_named(&["bin"]) {
        folders
            .push(Folder { path: own.with_file_name("lib").join("lightpath"), is_chosen: false });
    }
    if let Some(path) = CHOSEN.filter(|folder| !folder.is_empty()) {
        folders.push(Folder { path: path.into(), is_chosen: true });
    }
    // Tests and examples are a folder deeper.
    let built = if is_named(&["deps", "examples"]) { own.parent().unwrap_or(own) } else { own };
    if built.join("deps").is_dir() {
        let way = VENDOR.filter(|folder| !folder.is_empty());
        folders.extend(way.map(|way| Folder { path: built.join(way), is_chosen: false }));
    }
    folders
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// Makes a program in `bin` and its library, and returns the path of both and the owner.
    fn installation(root: &Path) -> (PathBuf, PathBuf, u32) {
        let library = root.join("lib/lightpath").join(FILE);
        for file in [root.join("bin/lightpath"), library.clone()] {
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(&file, "").unwrap();
            set_mode(file.parent().unwrap(), 0o755);
            set_mode(&file, 0o644);
        }
        (root.join("bin/lightpath"), library, fs::metadata(root).unwrap().uid())
    }

    fn set_mode(path: &Path, mode: u32) {
        fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn a_library_that_others_can_change_is_left_out() {
        let scratch = tempfile::tempdir().unwrap();
        let (program, library, owner) = installation(&scratch.path().canonicalize().unwrap());
        let folder = library.parent().unwrap();
        let loaded = |file: PathBuf| Library { file, left_out: None };
        assert_eq!(find(OsStr::new(""), &program, owner), loaded(library.clone()));
        let left_out = || {
            let found = find(OsStr::new(""), &program, owner);
            assert_eq!(found.left_out, Some(folder.canonicalize().unwrap().join(FILE)));
            assert_ne!(found.file, library);
            let help = found.help().unwrap();
            assert!(help.starts_with(found.left_out.unwrap().to_str().unwrap()), "{help}");
        };
        for path in [&library, folder] {
            set_mode(path, 0o777);
            left_out();
            set_mode(path, 0o755);
        }
        assert_eq!(find(OsStr::new(""), &program, owner), loaded(library.clone()));
        // A link does not hide it: neither to a folder nor to a file.
        let elsewhere = scratch.path().canonicalize().unwrap().join("elsewhere");
        fs::rename(folder, &elsewhere).unwrap();
        std::os::unix::fs::symlink(&elsewhere, folder).unwrap();
        let file = elsewhere.join(FILE);
        assert_eq!(find(OsStr::new(""), &program, owner), loaded(file.clone()));
        set_mode(&elsewhere, 0o777);
        left_out();
        set_mode(&elsewhere, 0o755);
        let other = elsewhere.join("other");
        fs::rename(&file, &other).unwrap();
        std::os::unix::fs::symlink(&other, &file).unwrap();
        assert_eq!(find(OsStr::new(""), &program, owner), loaded(file.clone()));
        set_mode(&other, 0o666);
        left_out();
        set_mode(&other, 0o644);
        // A file of somebody else. Who may give it away tests it.
        if std::os::unix::fs::chown(&other, Some(owner + 1), None).is_ok() {
            left_out();
            assert!(is_trusted(&elsewhere, &file, owner + 1) == (owner == 0));
        }
    }

    #[test]
    fn the_library_path_wins_if_it_has_the_file() {
        let scratch = tempfile::tempdir().unwrap();
        let root = scratch.path().canonicalize().unwrap();
        let (program, library, owner) = installation(&root);
        let with = |of_loader: &str| {
            find(OsStr::new(&of_loader.replace("ROOT", root.to_str().unwrap())), &program, owner)
                .file
        };
        for nowhere in ["", ":", "ROOT", "ROOT/bin:", ";ROOT/lib"] {
            assert_eq!(with(nowhere), library, "{nowhere}");
        }
        for found in ["ROOT/lib/lightpath", "ROOT:ROOT/lib/lightpath", "ROOT;ROOT/lib/lightpath/"] {
            assert_eq!(with(found), Path::new(FILE), "{found}");
        }
    }

    #[test]
    fn a_copy_looks_in_no_folder_beside_it() {
        let scratch = tempfile::tempdir().unwrap();
        let root = scratch.path().canonicalize().unwrap();
        let of = |program: &str| {
            let own = folders(&root.join(program)).into_iter().filter(|folder| !folder.is_chosen);
            own.map(|folder| folder.path).collect::<Vec<_>>()
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
