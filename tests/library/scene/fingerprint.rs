//! The hash of everything that determines a picture's pixels. It does not depend on paths and names
//! of files, and differs for every visible change.

use std::{fs, path::Path};

use crate::support::program::PYRAMID;
use lightpath::{
    error::ErrorKind,
    monitor::Monitor,
    scene::{self, Source},
    world::{ContentHashes, LoadOptions, World, fingerprint},
};

const SCENE: &str = r#"{
  "camera": { "type": "pinhole", "width": 40, "height": 24, "fov": 40,
              "position": [0, 1, 9], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
    "materials": { "brick": { "tPath": "brick.ppm" }, "unused": { "kd": 0.5 } },
    "shapes": [
      { "type": "trimesh", "path": "a.ply", "material": { "tPath": "brick.ppm" } },
      { "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": "brick" }]
  }
}"#;

const BRICK: &str = "P3 1 1 255 200 80 60\n";

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.write("s.json", SCENE);
        folder.write("a.ply", PYRAMID);
        folder.write("brick.ppm", BRICK);
        folder
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path().join(name), text).unwrap();
    }

    fn hash_with(&self, sets: &[&str], repair: bool) -> String {
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        let loaded = scene::load(Source::File(&self.path().join("s.json")), &sets).unwrap();
        fingerprint(&loaded, repair, &mut ContentHashes::default()).unwrap().unwrap()
    }

    fn hash(&self, sets: &[&str]) -> String {
        self.hash_with(sets, false)
    }
}

#[test]
fn contents_of_files_count_and_names_do_not() {
    let here = Folder::new();
    let hash = here.hash(&[]);
    assert_eq!(hash.len(), 64);
    assert_eq!(hash, Folder::new().hash(&[]), "another folder");

    here.write("s.json", &SCENE.replace("a.ply", "b.ply").replace("brick.ppm", "stone.ppm"));
    here.write("b.ply", PYRAMID);
    here.write("stone.ppm", BRICK);
    assert_eq!(hash, here.hash(&[]), "other names");
    here.write("b.ply", &PYRAMID.replace("0 2 0", "0 3 0"));
    assert_ne!(hash, here.hash(&[]), "another mesh");
    here.write("b.ply", PYRAMID);
    here.write("stone.ppm", "P3 1 1 255 200 80 61\n");
    assert_ne!(hash, here.hash(&[]), "another texture");
}

#[test]
fn visible_settings_change_the_hash() {
    let here = Folder::new();
    let hash = here.hash(&[]);
    assert_eq!(hash, here.hash(&["/spp=1", "/seed=0"]), "defaults");
    assert_eq!(hash, here.hash(&["/scene/materials/unused/kd=0.25"]), "what nothing uses");
    let sets = ["/spp=2", "/seed=7", "/camera/width=41", "/output/layers=[\"Z\"]", "/nbounces=2"];
    let mut all: Vec<String> = sets.iter().map(|set| here.hash(&[set])).collect();
    all.push(here.hash_with(&[], true));
    all.push(hash);
    all.sort();
    all.dedup();
    assert_eq!(all.len(), sets.len() + 2);
}

#[test]
fn images_that_a_mesh_names_and_names_of_mattes_count() {
    let here = Folder::new();
    let comment = "format ascii 1.0\ncomment TextureFile own.ppm";
    here.write("a.ply", &PYRAMID.replace("format ascii 1.0", comment));
    here.write("own.ppm", BRICK);
    let hash = here.hash(&[]);
    here.write("own.ppm", "P3 1 1 255 1 2 3\n");
    assert_ne!(hash, here.hash(&[]));
    let two = "format ascii 1.0\ncomment TextureFile own.ppm\ncomment TextureFile other.ppm";
    here.write("a.ply", &PYRAMID.replace("format ascii 1.0", two));
    let hash = here.hash(&[]);
    fs::rename(here.path().join("own.ppm"), here.path().join("other.ppm")).unwrap();
    assert_ne!(hash, here.hash(&[]), "the same image, the other name");
    let far = "format ascii 1.0\ncomment TextureFile C:\\scans\\other.ppm";
    here.write("a.ply", &PYRAMID.replace("format ascii 1.0", far));
    let hash = here.hash(&[]);
    here.write("other.ppm", "P3 1 1 255 9 9 9\n");
    assert_ne!(hash, here.hash(&[]), "an image without the folders of its name");
    here.write("a.ply", &PYRAMID.replace("format ascii 1.0", comment));
    here.write("own.ppm", "P3 1 1 255 1 2 3\n");

    let mattes = "/output/layers=[\"cryptomatte\"]";
    let listed = "/output/layers=[\"CryptoMaterial\", \"CryptoObject\"]";
    let hash = here.hash(&[mattes]);
    assert_eq!(hash, here.hash(&[listed]));
    assert_eq!(hash, here.hash(&[mattes, "/output/cryptoranks=6"]), "the default");
    assert_ne!(hash, here.hash(&[mattes, "/output/cryptoranks=8"]));
    assert_eq!(here.hash(&[]), here.hash(&["/output/cryptoranks=8"]), "ranks of nothing");
    here.write("s.json", &SCENE.replace("a.ply", "b.ply"));
    fs::rename(here.path().join("a.ply"), here.path().join("b.ply")).unwrap();
    assert_ne!(hash, here.hash(&[mattes]), "the matte is called trimesh.b now");
}

/// Detects a file that is replaced or written between reading and hashing.
#[test]
fn a_file_that_changes_between_reading_and_hashing_is_detected() {
    let here = Folder::new();
    let vertices = "property float z\nproperty float s\nproperty float t";
    let mut mesh =
        PYRAMID.replace("format ascii 1.0", "format ascii 1.0\ncomment TextureFile own.ppm");
    mesh = mesh.replace("property float z", vertices);
    for vertex in ["-1 0 -1", "1 0 -1", "1 0 1", "-1 0 1", "0 2 0"] {
        mesh = mesh.replace(&format!("\n{vertex}\n"), &format!("\n{vertex} 0 1\n"));
    }
    here.write(
        "s.json",
        &SCENE.replace(
            "\"a.ply\", \"material\": { \"tPath\": \"brick.ppm\" }",
            "\"a.ply\", \"material\": {}",
        ),
    );
    here.write("a.ply", &mesh);
    here.write("own.ppm", BRICK);
    let loaded = scene::load(Source::File(&here.path().join("s.json")), &[]).unwrap();
    let hashed_after = |act: &dyn Fn()| {
        let options = LoadOptions::default();
        let (world, _) = World::load(&loaded.scene, options, &Monitor::default()).unwrap();
        assert_eq!(world.read.paths().count(), 3);
        act();
        let mut contents = ContentHashes::default();
        fingerprint(&loaded, false, &mut contents).unwrap();
        contents.check(&world.read)
    };
    assert_eq!(hashed_after(&|| ()), Ok(()));
    for name in ["a.ply", "own.ppm", "brick.ppm"] {
        let text = fs::read_to_string(here.path().join(name)).unwrap();
        // A new file with the same bytes is another file. A longer one has changed.
        for longer in ["", "\n"] {
            let error = hashed_after(&|| {
                here.write("next", &format!("{text}{longer}"));
                fs::rename(here.path().join("next"), here.path().join(name)).unwrap();
            });
            let error = error.unwrap_err();
            assert_eq!(error.kind, ErrorKind::Retry, "{name}");
            assert!(error.to_string().contains("changed while it was read"), "{error}");
        }
        let error = hashed_after(&|| here.write(name, &format!("{text}\n\n"))).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
        // A new mode may hide new bytes with the old date, so the help names it.
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let error = hashed_after(&|| {
                // More than a tick of the file system's clock.
                std::thread::sleep(std::time::Duration::from_millis(50));
                let mode = fs::Permissions::from_mode(0o600);
                fs::set_permissions(here.path().join(name), mode).unwrap();
            });
            let error = error.unwrap_err().to_string();
            assert!(error.contains("changes its mode, owner or links"), "{error}");
        }
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_has_no_fingerprint() {
    let here = Folder::new();
    let pipe = here.path().join("a.ply");
    fs::remove_file(&pipe).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let loaded = scene::load(Source::File(&here.path().join("s.json")), &[]).unwrap();
    assert_eq!(fingerprint(&loaded, false, &mut ContentHashes::default()).unwrap(), None);
}

#[test]
fn a_file_is_read_once() {
    let here = Folder::new();
    let loaded = scene::load(Source::File(&here.path().join("s.json")), &[]).unwrap();
    let mut contents = ContentHashes::default();
    let first = fingerprint(&loaded, false, &mut contents).unwrap();
    here.write("brick.ppm", "P3 1 1 255 0 0 0\n");
    assert_eq!(fingerprint(&loaded, false, &mut contents).unwrap(), first);
}
