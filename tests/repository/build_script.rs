//! The build script: the way from a program to the checkout that it was built in.

#[allow(dead_code)]
#[path = "../../build.rs"]
mod script;

use std::fs;
use std::os::unix::fs::symlink;

use script::folders_up;

#[test]
fn only_target_folders_elsewhere_need_an_absolute_path() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("checkout");
    let out = |target: &str| {
        let out = folder.path().join(target).join("release/build/lightpath-0123/out");
        fs::create_dir_all(&out).expect("a folder");
        out
    };
    let way = |target: &str| {
        folders_up(&root, &out(target)).map(|way| way.to_str().expect("text").to_owned())
    };
    assert_eq!(way("checkout/target").as_deref(), Some("../.."));
    assert_eq!(way("checkout/target/x86_64-unknown-linux-gnu").as_deref(), Some("../../.."));
    assert_eq!(way("checkout/target/../../checkout/target").as_deref(), Some("../.."));
    assert_eq!(way("checkout").as_deref(), Some(".."));
    assert_eq!(way("checkout/a/b/c").as_deref(), Some("../../../.."));
    // As text, this begins with the checkout.
    assert_eq!(way("checkout/../fast"), None);
    symlink(folder.path().join("fast"), root.join("linked")).expect("a link");
    assert_eq!(way("checkout/linked"), None, "a link to another disk");
    symlink(&root, folder.path().join("name")).expect("a link");
    assert!(folders_up(&folder.path().join("name"), &out("checkout/target")).is_some());
}
