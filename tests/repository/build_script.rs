//! The build script: whether a program finds `vendor/embree` by its relative run path.

#[allow(dead_code)]
#[path = "../../build.rs"]
mod script;

use std::fs;
use std::os::unix::fs::symlink;

use script::relative_entries_reach;

#[test]
fn only_target_folders_of_the_right_depth_need_no_absolute_run_path() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("checkout");
    let out = |target: &str| {
        let out = folder.path().join(target).join("release/build/lightpath-0123/out");
        fs::create_dir_all(&out).expect("a folder");
        out
    };
    let reached = |target: &str| relative_entries_reach(&root, &out(target));
    assert!(reached("checkout/target"));
    assert!(reached("checkout/target/x86_64-unknown-linux-gnu"));
    assert!(reached("checkout/target/../../checkout/target"));
    assert!(!reached("checkout"), "the program is in checkout/release");
    assert!(!reached("checkout/a/b/c"), "the tests are five folders deep");
    // As text, this begins with the checkout.
    assert!(!reached("checkout/../fast"));
    symlink(folder.path().join("fast"), root.join("linked")).expect("a link");
    assert!(!reached("checkout/linked"), "a link to another disk");
    symlink(&root, folder.path().join("name")).expect("a link");
    assert!(relative_entries_reach(&folder.path().join("name"), &out("checkout/target")));
}
