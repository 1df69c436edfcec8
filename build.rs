//! Passes facts about the build machine to the crate: the file name and folders of Embree 4,
//! whether tests can use it, whether this compiler supports AVX-512, and the commit.
//!
//! Nothing here can fail the build. Without Embree it prints a warning that names the way to
//! install it.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Name to load if no library is found now: the soname of Embree 4.
const EMBREE_SONAME: &str = "libembree4.so.4";

/// The first Rust release whose AVX-512 target features and intrinsics are stable.
const AVX512_SINCE: (u32, u32) = (1, 89);

/// Paths that the executable is built from. A change in one of them makes a build "dirty".
const BUILT_FROM: [&str; 4] = ["build.rs", "Cargo.toml", "Cargo.lock", "src"];

fn main() {
    let root = PathBuf::from(variable("CARGO_MANIFEST_DIR"));
    for path in BUILT_FROM {
        // A missing path would rerun this script on every build.
        if root.join(path).exists() {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    compiler();
    commit(&root);
    println!("cargo::rustc-check-cfg=cfg(lightpath_embree, lightpath_embree_headers)");
    if env::var_os("CARGO_FEATURE_EMBREE").is_some() {
        embree(&root);
    }
}

/// Returns an environment variable as text: empty if it is not set or not UTF-8.
fn variable(name: &str) -> String {
    env::var(name).unwrap_or_default()
}

/// Returns the first line that a command prints, or `None` if it fails.
fn first_line(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?;
    Some(text.lines().next().unwrap_or_default().trim().to_owned())
}

// -------------------------------------------------------------------------------------------------
// The compiler

fn compiler() {
    println!("cargo::rustc-check-cfg=cfg(lightpath_avx512)");
    let version = first_line(Command::new(variable("RUSTC")).arg("--version")).unwrap_or_default();
    let number = version.split_whitespace().nth(1).unwrap_or("unknown");
    println!("cargo::rustc-env=LIGHTPATH_RUSTC_VERSION={number}");
    let mut parts = number.split(['.', '-']).map_while(|part| part.parse::<u32>().ok());
    let release = (parts.next().unwrap_or(0), parts.next().unwrap_or(0));
    if release >= AVX512_SINCE && variable("CARGO_CFG_TARGET_ARCH") == "x86_64" {
        println!("cargo::rustc-cfg=lightpath_avx512");
    }
}

// -------------------------------------------------------------------------------------------------
// The commit

/// Sets `LIGHTPATH_GIT_COMMIT`: the short hash, `-dirty` if a built file differs from it, or
/// `unknown` if the source tree is not the root of a git checkout.
fn commit(root: &Path) {
    let commit = git_commit(root).unwrap_or_else(|| "unknown".to_owned());
    println!("cargo::rustc-env=LIGHTPATH_GIT_COMMIT={commit}");
}

fn git_commit(root: &Path) -> Option<String> {
    let git = |arguments: &[&str]| {
        let mut command = Command::new("git");
        command.arg("--no-optional-locks").arg("-C").arg(root).args(arguments);
        command.env_remove("GIT_DIR").env_remove("GIT_WORK_TREE").env_remove("GIT_INDEX_FILE");
        first_line(&mut command)
    };
    // A copy of the sources inside another checkout must not report that checkout's commit.
    let top = PathBuf::from(git(&["rev-parse", "--show-toplevel"])?);
    if top.canonicalize().ok()? != root.canonicalize().ok()? {
        return None;
    }
    // The log of HEAD changes with every commit and checkout, and at no other time.
    for name in ["HEAD", "logs/HEAD"] {
        let path = git(&["rev-parse", "--git-path", name])?;
        if root.join(&path).exists() {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    // A fixed length: git's own choice depends on how many objects this clone has.
    let hash = git(&["rev-parse", "--short=10", "HEAD"])?;
    let changed = git(&[&["status", "--porcelain", "--"][..], &BUILT_FROM[..]].concat())?;
    Some(if changed.is_empty() { hash } else { format!("{hash}-dirty") })
}

// -------------------------------------------------------------------------------------------------
// Embree

/// An Embree library found on this machine.
struct Library {
    folder: PathBuf,
    file: String,
}

/// Sets what `accel/embree/search.rs` looks for at run time: `LIGHTPATH_EMBREE_FILE`, the library's
/// name; `LIGHTPATH_EMBREE_DIR`, the folder that `EMBREE_DIR` chose, or empty; `LIGHTPATH_VENDOR`,
/// the checkout's folder, relative to that of the program, or absolute, or empty.
fn embree(root: &Path) {
    println!("cargo::rerun-if-env-changed=EMBREE_DIR");
    let vendor = root.join("vendor").join("embree");
    let chosen = env::var_os("EMBREE_DIR")
        .filter(|folder| !folder.is_empty())
        .map(|folder| root.join(folder));
    let from_user = chosen.as_deref().and_then(|folder| {
        let found = ["lib", "lib64", ""].iter().find_map(|inner| library_in(&folder.join(inner)));
        if found.is_none() {
            println!(
                "cargo::warning=EMBREE_DIR is {}, but there is no libembree4.so in it or in its lib folder",
                folder.display()
            );
        }
        found
    });
    headers(chosen.as_deref());
    let explicit = from_user.as_ref().map(|library| library.folder.clone());
    let found = from_user
        .or_else(|| library_in(&vendor))
        .or_else(|| system_folders().iter().find_map(|folder| library_in(folder)));

    match &found {
        Some(library) => {
            println!("cargo::rerun-if-changed={}", library.folder.join(&library.file).display());
            // Only for tests: those that need Embree are ignored without it.
            println!("cargo::rustc-cfg=lightpath_embree");
        }
        None => println!(
            "cargo::warning=Embree 4 is not installed, so `--backend embree` is not available: `make setup` installs it."
        ),
    }
    let file = found.as_ref().map_or(EMBREE_SONAME, |library| &library.file);
    println!("cargo::rustc-env=LIGHTPATH_EMBREE_FILE={file}");

    println!("cargo::rustc-env=LIGHTPATH_EMBREE_DIR={}", explicit.unwrap_or_default().display());
    // A program in a target folder elsewhere needs the absolute path. All others have the same
    // bytes wherever they are built, as all have with SOURCE_DATE_EPOCH (reproducible-builds.org).
    // The folder need not exist yet, so `make setup` needs no rebuild.
    println!("cargo::rerun-if-env-changed=SOURCE_DATE_EPOCH");
    let vendor = match folders_up(root, Path::new(&variable("OUT_DIR"))) {
        Some(up) => up.join("vendor").join("embree"),
        None if env::var_os("SOURCE_DATE_EPOCH").is_none() => vendor,
        None => PathBuf::new(),
    };
    println!("cargo::rustc-env=LIGHTPATH_VENDOR={}", vendor.display());
}

/// Returns the path from the folder of the program to the checkout, `../..` for `target/release`;
/// `None` if it is not in the checkout. Symbolic links are resolved.
pub fn folders_up(root: &Path, out_dir: &Path) -> Option<PathBuf> {
    let (root, out_dir) = (root.canonicalize().ok()?, out_dir.canonicalize().ok()?);
    // OUT_DIR is build/lightpath-HASH/out in the folder of the program.
    let program = out_dir.ancestors().nth(3)?.strip_prefix(root).ok()?;
    Some(program.components().map(|_| "..").collect())
}

/// Sets `LIGHTPATH_EMBREE_HEADERS`, the include folder (or empty), for the test that compares
/// structures.
fn headers(chosen: Option<&Path>) {
    let chosen = chosen.map(|folder| folder.join("include"));
    let folders = chosen.into_iter().chain(["/usr/include", "/usr/local/include"].map(Into::into));
    let found = folders.into_iter().find(|folder| folder.join("embree4/rtcore.h").is_file());
    if found.is_some() {
        println!("cargo::rustc-cfg=lightpath_embree_headers");
    }
    let folder = found.unwrap_or_default();
    println!("cargo::rustc-env=LIGHTPATH_EMBREE_HEADERS={}", folder.display());
}

/// Returns the library folders of distributions and of `make install`, if the build is for this
/// machine.
fn system_folders() -> Vec<PathBuf> {
    if variable("HOST") != variable("TARGET") {
        return Vec::new();
    }
    let architecture = variable("CARGO_CFG_TARGET_ARCH");
    let multiarch = format!("/usr/lib/{architecture}-linux-gnu");
    [multiarch.as_str(), "/usr/lib64", "/usr/lib", "/usr/local/lib"]
        .iter()
        .map(PathBuf::from)
        .collect()
}

/// Returns the Embree 4 library of a folder: preferably the soname, then a name with a version
/// (`libembree4-4aef3270.so.4`, `libembree4.so.4.4.0`), then the developer's link `libembree4.so`.
fn library_in(folder: &Path) -> Option<Library> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| {
            name.starts_with("libembree4") && name.contains(".so") && folder.join(name).is_file()
        })
        .collect();
    names.sort_by_key(|name| (name != EMBREE_SONAME, !name.contains(".so."), name.clone()));
    let file = names.into_iter().next()?;
    Some(Library { folder: folder.to_path_buf(), file })
}
