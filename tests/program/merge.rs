//! Merged parts of a picture have the bytes of one render, or are refused with a reason.

use crate::support::program::{Done, PYRAMID, Scratch};

/// Lights, mirrors, an area light, a lens, antialiasing, shapes that share a name.
const SCENE: &str = r#"{
  "spp": 24, "nbounces": 2, "seed": 5,
  "camera": { "type": "thinlens", "width": 75, "height": 53, "fov": 40, "aperture": 0.05, "focaldistance": 4,
              "position": [0, 1, 4], "lookat": [0, -0.2, -1], "up": [0, 1, 0] },
  "scene": {
    "backgroundcolor": [0.1, 0.2, 0.3], "ambient": [0.05, 0.05, 0.05],
    "lightsources": [
      { "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3], "name": "sun" },
      { "type": "arealight", "id": [2, 1, 1], "v0": [-2, 4, 2], "v1": [-1, 4, 2], "v2": [-2, 4, 3],
        "samples": 4, "name": "sky" }],
    "materials": { "chalk": { "ka": 0.5 }, "steel": { "kr": 0.5, "ks": 0.6, "specularexponent": 40 } },
    "shapes": [
      { "type": "sphere", "center": [-0.8, 0, 0], "radius": 0.9, "material": "steel", "name": "ball" },
      { "type": "sphere", "center": [0.9, -0.2, 0.4], "radius": 0.7, "material": "chalk" },
      { "type": "sphere", "center": [0.3, -0.7, 1.5], "radius": 0.2, "material": "chalk", "name": "ball" },
      { "type": "plane", "v0": [-4, -1, 4], "v1": [4, -1, 4], "v2": [4, -1, -4], "v3": [-4, -1, -4],
        "material": "chalk" }]
  }
}"#;

/// Flags for everything that decides how files are written and samples are taken.
const WRITTEN: &[&str] = &[
    "--aov",
    "all",
    "--multipart",
    "--compression",
    "zips",
    "--png-bits",
    "16",
    "--frame",
    "-7",
    "--fps",
    "24000/1001",
    "--sampler",
    "random",
    "--adaptive-shadows",
];

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch
}

#[track_caller]
fn render(scratch: &Scratch, name: &str, flags: &[&str]) {
    let done = scratch.run(&[&["render", "s.json", "--quiet", "-o", name], flags].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

fn merge(scratch: &Scratch, parts: &[&str], flags: &[&str]) -> Done {
    scratch.run(&[&["merge", "-o", "merged", "--quiet"], parts, flags].concat())
}

/// Merges parts and compares the files with `whole`.
#[track_caller]
fn same(scratch: &Scratch, parts: &[&str], flags: &[&str], files: &[&str]) {
    let done = merge(scratch, parts, flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    for file in files {
        let (merged, whole) = (format!("merged.{file}"), format!("whole.{file}"));
        assert!(scratch.read(&merged) == scratch.read(&whole), "{file} differs");
    }
}

#[track_caller]
fn refused(done: &Done, texts: &[&str]) {
    assert_eq!(done.code(), 2, "{}", done.stderr());
    for text in texts {
        assert!(done.stderr().contains(text), "{text:?} is not in: {}", done.stderr());
    }
}

/// `light_` and 24 letters have 30 bytes, with `.R` 32: one byte more than a file without the
/// long-names flag may have.
#[test]
fn long_names_of_layers_survive() {
    let scratch = Scratch::new();
    scratch.write("s.json", &SCENE.replace("\"sun\"", &format!("{:?}", "k".repeat(24))));
    let layers = ["--aov", "light"];
    render(&scratch, "whole", &layers);
    for (name, part) in [("a", "0..16"), ("b", "16..24")] {
        let more = ["--samples", part, "--of", "24"];
        render(&scratch, name, &[&layers[..], &more].concat());
    }
    same(&scratch, &["a.exr", "b.exr"], &[], &["exr", "png"]);
}

#[test]
fn tiles_give_the_bytes_of_the_whole() {
    let scratch = scratch();
    for flags in [
        &[][..],
        &["--aov", "all", "--transparent"],
        &["--aov", "Z,light", "--float"],
        &["--noise", "0.2", "--spp", "16"],
        WRITTEN,
    ] {
        render(&scratch, "whole", flags);
        for (i, tile) in ["1/3", "2/3", "3/3"].into_iter().enumerate() {
            let threads = (i + 1).to_string();
            let more = ["--tile", tile, "--threads", threads.as_str()];
            render(&scratch, &format!("t{i}"), &[flags, &more].concat());
        }
        same(&scratch, &["t2.exr", "t0.exr", "t1.exr"], &[], &["exr", "png"]);
    }
}

#[test]
fn samples_give_the_bytes_of_the_whole() {
    let scratch = scratch();
    // Packets of one, four and sixteen samples; ranges that begin and end anywhere.
    let splits: &[(&str, &[&str])] = &[
        ("24", &["0..16", "16..24"]),
        ("24", &["0..1", "1..13", "13..20", "20..24"]),
        ("64", &["0..16", "16..32", "32..64"]),
        ("9", &["0..3", "3..4", "4..9"]),
        ("3", &["0..1", "1..2", "2..3"]),
    ];
    for (of, ranges) in splits {
        for aov in ["all", "variance", ""] {
            let aov: &[&str] = if aov.is_empty() { &[] } else { &["--aov", aov] };
            render(&scratch, "whole", &[&["--spp", of], aov].concat());
            let mut parts = Vec::new();
            for (i, range) in ranges.iter().enumerate() {
                let more = ["--samples", range, "--of", of];
                render(&scratch, &format!("p{i}"), &[aov, &more].concat());
                parts.insert(0, format!("p{i}.exr"));
            }
            let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
            same(&scratch, &parts, &[], &["exr", "png"]);
        }
    }
}

#[test]
fn samples_of_adaptive_shadows_are_cut_between_packets() {
    let scratch = scratch();
    let shadows = ["--adaptive-shadows", "--light-samples", "16"];
    for (spp, parts) in
        [("24", ["0..16", "16..24"]), ("12", ["0..8", "8..12"]), ("3", ["0..1", "1..3"])]
    {
        let flags = [&shadows[..], &["--spp", spp]].concat();
        render(&scratch, "whole", &flags);
        for (name, part) in ["a", "b"].into_iter().zip(parts) {
            render(&scratch, name, &[&flags[..], &["--samples", part]].concat());
        }
        same(&scratch, &["b.exr", "a.exr"], &[], &["exr", "png"]);
    }
}

#[test]
fn samples_by_quarters_of_a_light_give_the_bytes_of_samples_in_order() {
    // With one light point per camera sample and no lens, 64 samples of a pixel are taken together.
    let scene = SCENE
        .replace("\"thinlens\"", "\"pinhole\"")
        .replace("\"aperture\": 0.05, \"focaldistance\": 4,", "")
        .replace("\"samples\": 4", "\"samples\": 1");
    let scratch = scratch();
    scratch.write("s.json", &scene);
    for (of, ranges) in [("64", ["0..32", "32..64"]), ("150", ["0..40", "40..150"])] {
        let whole = ["--spp", of];
        for flags in [&[][..], &["--aov", "variance"], &["--set", "/nbounces=0"]] {
            render(&scratch, "whole", &[&whole, flags].concat());
            for (i, range) in ranges.iter().enumerate() {
                let more = ["--samples", range, "--of", of];
                render(&scratch, &format!("p{i}"), &[flags, &more].concat());
            }
            same(&scratch, &["p1.exr", "p0.exr"], &[], &["exr", "png"]);
        }
    }
}

/// A packet with a catcher uses all lights, so samples must not move to other packets.
#[test]
fn samples_of_drawn_lights_and_a_catcher_stay_in_order() {
    let scene = SCENE
        .replace("\"thinlens\"", "\"pinhole\"")
        .replace("\"aperture\": 0.05, \"focaldistance\": 4,", "")
        .replace("\"samples\": 4", "\"samples\": 1")
        .replace("\"nbounces\": 2,", "\"nbounces\": 2, \"emittersamples\": 1,")
        .replace(
            "\"material\": \"chalk\" }]",
            "\"material\": \"chalk\", \"shadow_catcher\": true }]",
        );
    assert!(scene.contains("emittersamples") && scene.contains("shadow_catcher"));
    let scratch = scratch();
    scratch.write("s.json", &scene);
    render(&scratch, "plain", &["--spp", "64", "--float"]);
    render(&scratch, "layers", &["--spp", "64", "--float", "--aov", "Z"]);
    for channel in ["R", "G", "B", "A"] {
        assert!(scratch.floats("plain.exr")[channel] == scratch.floats("layers.exr")[channel]);
    }
}

#[test]
fn merged_files_have_the_format_of_the_parts() {
    let scratch = scratch();
    render(&scratch, "whole", WRITTEN);
    for (name, range) in [("a", "0..5"), ("b", "5..24")] {
        // Each part records its own render time.
        render(&scratch, name, &[WRITTEN, &["--samples", range, "--record-time"]].concat());
    }
    same(&scratch, &["a.exr", "b.exr"], &[], &["exr", "png"]);
    let other = [WRITTEN, &["--samples", "5..24"]].concat();
    let other: Vec<&str> =
        other.iter().map(|flag| if *flag == "-7" { "8" } else { flag }).collect();
    render(&scratch, "c", &other);
    refused(
        &merge(&scratch, &["a.exr", "c.exr"], &[]),
        &["c.exr", "another frame number: 8, expected"],
    );
    // A crop without --part has its layers in parts of the file.
    render(&scratch, "d", &["--crop", "0", "0", "75", "20", "--multipart", "--aov", "Z"]);
    refused(&merge(&scratch, &["d.exr"], &[]), &["d.exr", "several parts", "--part"]);
}

#[test]
fn tiles_and_samples_of_a_crop_with_previews_and_sidecars() {
    let scratch = scratch();
    let crop = ["--crop", "5", "7", "70", "50", "--aov", "all", "--compression", "piz"];
    let beside = ["--crypto-sidecar", "--png-layer", "all"];
    render(&scratch, "whole", &[&crop[..], &beside].concat());
    let mut parts = Vec::new();
    for tile in ["1/2", "2/2"] {
        for samples in ["0..8", "8..24"] {
            let name = format!("p{}", parts.len());
            let more = ["--tile", tile, "--samples", samples];
            render(&scratch, &name, &[&crop[..], &more].concat());
            parts.push(format!("{name}.exr"));
        }
    }
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let names: Vec<String> = scratch.names();
    let files: Vec<&str> = names.iter().filter_map(|name| name.strip_prefix("whole.")).collect();
    assert!(files.len() > 20, "{files:?}");
    let done = merge(&scratch, &parts, &beside);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    for file in files {
        // The header names the sidecar. The whole render is a crop, but its merge is not.
        if file != "exr" {
            assert!(
                scratch.read(&format!("merged.{file}")) == scratch.read(&format!("whole.{file}")),
                "{file} differs"
            );
        }
    }
    let compared = scratch.run(&["compare", "merged.exr", "whole.exr", "--fail-above", "max=0"]);
    assert_eq!(compared.code(), 0, "{}{}", compared.stdout(), compared.stderr());
}

#[test]
fn previews_are_selected_as_by_render() {
    let scratch = scratch();
    for tile in ["1/2", "2/2"] {
        let flags = ["--aov", "all", "--spp", "1", "--tile", tile];
        render(&scratch, &format!("part{}", &tile[..1]), &flags);
    }
    let all = ["--aov", "all", "--spp", "1"];
    for layers in ["N,all,Z", "Z,N,Z", "light", "shadow,light_sun", "components", "cryptomatte"] {
        let new = || Scratch::new();
        let (one, other) = (new(), new());
        let prefix = |folder: &Scratch| folder.path("x").display().to_string();
        render(&scratch, &prefix(&one), &[&all[..], &["--png-layer", layers]].concat());
        let parts = ["part1.exr", "part2.exr", "--quiet", "--png-layer", layers];
        scratch.run(&[&["merge", "-o", &prefix(&other)], &parts[..]].concat()).good();
        assert_eq!(one.names(), other.names(), "{layers}");
        assert!(one.names().len() > 3, "{layers}: {:?}", one.names());
    }
    let none = merge(&scratch, &["part1.exr", "part2.exr"], &["--png-layer", "lights"]);
    refused(&none, &["lights", "the parts do not have", "light_sun"]);
}

#[test]
fn a_folder_gets_the_name_of_the_first_part() {
    let scratch = scratch();
    for tile in ["1/2", "2/2"] {
        render(&scratch, &format!("part{}", &tile[..1]), &["--spp", "1", "--tile", tile]);
    }
    scratch.write("out/x", "");
    scratch.run(&["merge", "part1.exr", "part2.exr", "-o", "out"]).good();
    assert!(scratch.path("out/part1.exr").is_file() && scratch.path("out/part1.png").is_file());
    let done = scratch.run(&["merge", "part1.exr", "part2.exr", "-o", "."]);
    refused(&done, &["would overwrite an input"]);
}

#[test]
fn notes_say_what_parts_have_lost() {
    let scratch = scratch();
    let crops = [["0", "0", "75", "20"], ["0", "20", "75", "53"]];
    for (compression, note) in [
        ("dwaa", "have lost precision in their compression"),
        ("zip", "hold 16-bit floats: the EXR has the bytes of one render"),
    ] {
        for float in [&[][..], &["--float"]] {
            let mut parts = Vec::new();
            for (i, crop) in crops.iter().enumerate() {
                let flags = ["--spp", "1", "--compression", compression, "--crop"];
                render(&scratch, &format!("{i}"), &[&flags[..], &crop[..], float].concat());
                parts.push(format!("{i}.exr"));
            }
            let done = scratch.run(&["merge", &parts[0], &parts[1], "-o", "merged"]).good();
            let noted = !(compression == "zip" && float == ["--float"]);
            assert_eq!(done.stderr().contains(note), noted, "{compression}: {}", done.stderr());
        }
    }
}

#[test]
fn flags_for_layers_that_the_parts_lack_get_a_warning() {
    let scratch = scratch();
    for tile in ["1/2", "2/2"] {
        render(&scratch, &format!("part{}", &tile[..1]), &["--spp", "1", "--tile", tile]);
    }
    let parts = ["merge", "part1.exr", "part2.exr", "-o", "merged"];
    let done = scratch.run(&[&parts[..], &["--png-layer", "all", "--crypto-sidecar"]].concat());
    let said = done.good().stderr();
    for flag in
        ["--crypto-sidecar: found without cryptomattes", "--png-layer: found without layers"]
    {
        assert!(said.contains(&format!("warning: {flag}; it has no effect")), "{said}");
    }
    assert!(!scratch.run(&parts).good().stderr().contains("warning"));
}

#[cfg(unix)]
#[test]
fn parts_of_a_mesh_from_a_pipe_get_a_warning() {
    let scratch = Scratch::new();
    let ball =
        r#"{ "type": "sphere", "center": [0.9, -0.2, 0.4], "radius": 0.7, "material": "chalk" }"#;
    assert!(SCENE.contains(ball));
    let mesh = r#"{ "type": "trimesh", "path": "pipe.ply", "material": "chalk" }"#;
    scratch.write("s.json", &SCENE.replace(ball, mesh));
    let pipe = scratch.pipe("pipe.ply");
    for tile in ["1/2", "2/2"] {
        let pipe = pipe.clone();
        let writer = std::thread::spawn(move || std::fs::write(pipe, PYRAMID).unwrap());
        render(&scratch, &format!("part{}", &tile[..1]), &["--spp", "1", "--tile", tile]);
        writer.join().unwrap();
    }
    let done = scratch.run(&["merge", "part1.exr", "part2.exr", "-o", "merged"]).good();
    assert!(done.stderr().contains("was not checked"), "{}", done.stderr());
}

#[test]
fn drawn_lights_with_a_catcher_are_cut_between_packets() {
    let scratch = Scratch::new();
    let floor = r#""v3": [-4, -1, -4],"#;
    assert!(SCENE.contains(floor));
    scratch.write("s.json", &SCENE.replace(floor, &format!(r#"{floor} "shadow_catcher": true,"#)));
    let flags = ["--spp", "32", "--emitter-samples", "1"];
    render(&scratch, "whole", &flags);
    render(&scratch, "a", &[&flags[..], &["--samples", "0..16"]].concat());
    render(&scratch, "b", &[&flags[..], &["--samples", "16..32"]].concat());
    same(&scratch, &["a.exr", "b.exr"], &[], &["exr", "png"]);
    let cut = [&["render", "s.json"], &flags[..], &["--samples", "0..8"]].concat();
    refused(&scratch.run(&cut), &["multiples of 16", "shadow catcher", "0..16"]);
    // Both lights are used, so none is drawn.
    render(&scratch, "cut", &["--spp", "32", "--emitter-samples", "2", "--samples", "0..8"]);
}

#[test]
fn crops_give_the_bytes_of_the_frame() {
    let scratch = scratch();
    let crops = [["0", "0", "30", "53"], ["30", "0", "75", "20"], ["30", "20", "75", "53"]];
    render(&scratch, "whole", &["--aov", "all"]);
    for (flag, files) in [(&[][..], &["exr"][..]), (&["--part"], &["exr", "png"])] {
        for (i, crop) in crops.iter().enumerate() {
            let flags = [&["--aov", "all", "--crop"], &crop[..], flag].concat();
            render(&scratch, &format!("c{i}"), &flags);
        }
        same(&scratch, &["c0.exr", "c1.exr", "c2.exr"], &[], files);
    }
}

/// A file of floats has the largest float in place of infinity.
#[test]
fn crops_with_infinite_pixels_give_the_bytes_of_the_frame() {
    let scratch = scratch();
    let huge = r#"{
        "camera": { "type": "pinhole", "width": 16, "height": 12, "fov": 50,
            "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "lightsources": [{ "type": "pointlight", "position": [2, 3, 4],
                "id": [1e18, 1, 1], "is": [0, 0, 0] }],
            "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1,
                "material": { "kd": 1e6, "diffusecolor": [1e18, 1, 1] } }] } }"#;
    scratch.write("s.json", huge);
    render(&scratch, "whole", &["--float"]);
    // A file has the largest number for infinity.
    let whole = scratch.rgba("whole.exr");
    assert!(whole.iter().flatten().any(|pixel| pixel[0] == f32::MAX), "no infinite pixel");
    render(&scratch, "left", &["--float", "--crop", "0", "0", "8", "12"]);
    render(&scratch, "right", &["--float", "--crop", "8", "0", "16", "12"]);
    same(&scratch, &["left.exr", "right.exr"], &[], &["exr", "png"]);
}

/// Tiles of a crop merge to the crop, which is a part of the frame again.
#[test]
fn tiles_of_a_crop_give_the_bytes_of_the_crop() {
    let scratch = scratch();
    let (above, below) = (["0", "0", "75", "20"], ["0", "20", "75", "53"]);
    for float in [&[][..], &["--float"]] {
        let flags = |crop: &[&'static str]| [&["--aov", "Z", "--crop"], crop, float].concat();
        render(&scratch, "whole", &flags(&above));
        for (name, tile) in [("a", "1/2"), ("b", "2/2")] {
            render(&scratch, name, &[&flags(&above)[..], &["--tile", tile]].concat());
        }
        same(&scratch, &["a.exr", "b.exr"], &[], &["exr", "png"]);
        std::fs::rename(scratch.path("merged.exr"), scratch.path("above.exr")).unwrap();
        render(&scratch, "below", &flags(&below));
        render(&scratch, "whole", &[&["--aov", "Z"], float].concat());
        same(&scratch, &["above.exr", "below.exr"], &[], &["exr"]);
    }
}

#[test]
fn a_legend_is_drawn_into_the_merged_picture() {
    let scratch = Scratch::new();
    let values = PYRAMID.replace("property float z", "property float z\nproperty float quality");
    let vertices = PYRAMID.split("end_header\n").nth(1).unwrap().lines().take(5);
    let numbered = vertices.clone().enumerate().map(|(i, line)| format!("{line} {i}.5"));
    let (old, new) =
        (vertices.collect::<Vec<_>>().join("\n"), numbered.collect::<Vec<_>>().join("\n"));
    scratch.write("q.ply", &values.replace(&old, &new));
    let flags = ["--color", "quality", "--size", "120x90", "--spp", "1", "--light-samples", "1"];
    for legend in [&["--legend"][..], &[]] {
        for (name, tile) in
            [("whole", &[][..]), ("a", &["--tile", "1/2"]), ("b", &["--tile", "2/2"])]
        {
            let args = [&["render", "q.ply", "--quiet", "-o", name], &flags[..], legend, tile];
            scratch.run(&args.concat()).good();
        }
        same(&scratch, &["a.exr", "b.exr"], &[], &["exr", "png"]);
        let kept = scratch.path(&format!("{}.png", legend.len()));
        std::fs::copy(scratch.path("merged.png"), kept).unwrap();
    }
    assert!(scratch.read("0.png") != scratch.read("1.png"));
}

#[test]
fn parts_over_a_plate_merge_without_it_and_say_so() {
    let scratch = scratch();
    image::RgbImage::new(75, 53).save(scratch.path("plate.png")).unwrap();
    for (name, crop) in [("a", ["0", "0", "75", "20"]), ("b", ["0", "20", "75", "53"])] {
        let flags = [&["--transparent", "--spp", "1", "--crop"], &crop[..]].concat();
        render(&scratch, name, &[&flags[..], &["--over", "plate.png"]].concat());
        render(&scratch, &format!("{name}{name}"), &flags);
    }
    let said = scratch.run(&["merge", "a.exr", "b.exr", "-o", "merged"]).good().stderr();
    assert!(said.contains("without the plate"), "{said}");
    let said = scratch.run(&["merge", "aa.exr", "bb.exr", "-o", "whole"]).good().stderr();
    assert!(!said.contains("plate"), "{said}");
    assert!(scratch.read("merged.exr") == scratch.read("whole.exr"));
    for (parts, name) in [(["a.exr", "bb.exr"], "one"), (["aa.exr", "b.exr"], "other")] {
        let said = scratch.run(&["merge", parts[0], parts[1], "-o", name]).good().stderr();
        assert!(said.contains("without the plate"), "{said}");
        assert!(scratch.read(&format!("{name}.exr")) == scratch.read("whole.exr"));
    }
}

#[test]
fn missing_and_duplicate_parts_are_named() {
    let scratch = scratch();
    for i in 1..=3 {
        let tile = format!("{i}/3");
        render(&scratch, &format!("t{i}"), &["--tile", &tile]);
    }
    let done = merge(&scratch, &["t1.exr", "t3.exr"], &[]);
    refused(&done, &["missing", "x 0..75, y 17..35", "--tile 2/3"]);
    let done = merge(&scratch, &["t1.exr", "t2.exr", "t2.exr", "t3.exr"], &[]);
    refused(&done, &["t2.exr", "also in t2.exr", "x 0..75, y 17..35"]);
    render(&scratch, "a", &["--samples", "0..10"]);
    render(&scratch, "b", &["--samples", "8..20"]);
    let done = merge(&scratch, &["a.exr", "b.exr"], &[]);
    refused(
        &done,
        &["b.exr: samples 8..10 of 24", "also in a.exr", "missing: samples 20..24 of 24"],
    );
    assert!(!scratch.names().iter().any(|name| name.starts_with("merged")));
}

#[test]
fn parts_of_different_pictures_are_refused() {
    let scratch = scratch();
    render(&scratch, "a", &["--tile", "1/2"]);
    let others: &[(&[&str], &str)] = &[
        (&["--seed", "6"], "another lightpath:seed: 6, expected 5"),
        (&["--set", "/scene/shapes/0/radius=0.8"], "another fingerprint: "),
        (&["--spp", "25"], "another --of: 25, expected 24"),
        (&["--size", "75x54"], "another frame: 75 x 54, expected 75 x 53"),
        (&["--float"], "another float of the files: true, expected false"),
        (&["--exposure", "1"], "another exposure of the files: 1.0, expected 0.0"),
        (&["--set", "/camera/fov=50"], "another lightpath:camera: "),
        (&["--aov", "Z"], "another lightpath:Z: "),
    ];
    for (flags, what) in others {
        render(&scratch, "b", &[&["--tile", "2/2"], *flags].concat());
        let done = merge(&scratch, &["a.exr", "b.exr"], &[]);
        refused(&done, &["b.exr: found another", "as in a.exr"]);
        assert!(done.stderr().contains(what), "{what}: {}", done.stderr());
    }
}

#[test]
fn files_that_are_not_parts_are_refused() {
    let scratch = scratch();
    render(&scratch, "whole", &[]);
    render(&scratch, "t1", &["--tile", "1/2", "--aov", "all"]);
    render(&scratch, "t2", &["--tile", "2/2", "--aov", "all"]);
    render(&scratch, "p1", &["--samples", "0..5", "--aov", "all"]);
    render(&scratch, "p2", &["--samples", "5..24", "--aov", "all"]);
    refused(&merge(&scratch, &["whole.exr"], &[]), &["whole.exr", "lightpath:part", "--tile"]);
    refused(&merge(&scratch, &["whole.png"], &[]), &["whole.png", "cannot read this EXR"]);
    refused(&merge(&scratch, &["nosuch.exr"], &[]), &["nosuch.exr"]);
    refused(&merge(&scratch, &["s.json"], &[]), &["s.json"]);
    refused(&merge(&scratch, &[], &[]), &["PART.exr"]);
    // A truncated or changed file is refused or read, and never crashes the program.
    let mut failures = 0;
    for (name, other) in [("t1", "t2.exr"), ("p1", "p2.exr")] {
        let bytes = scratch.read(&format!("{name}.exr"));
        for keep in [0, 3, 100, bytes.len() / 2, bytes.len() - 1] {
            std::fs::write(scratch.path("cut.exr"), &bytes[..keep]).unwrap();
            refused(&merge(&scratch, &["cut.exr", other], &[]), &["cut.exr"]);
        }
        let mut state = 1u32;
        for _ in 0..60 {
            let mut damaged = bytes.clone();
            for _ in 0..3 {
                state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                let at = (state >> 8) as usize % damaged.len().min(8000);
                damaged[at] ^= 1 << (state & 7);
            }
            std::fs::write(scratch.path("bad.exr"), &damaged).unwrap();
            let done = merge(&scratch, &["bad.exr", other], &[]);
            // Some bits of a header do not matter.
            assert!([0, 2, 3].contains(&done.code()), "{}: {}", done.code(), done.stderr());
            failures += u32::from(done.code() != 0);
            assert!(!done.stderr().contains("panicked"), "{}", done.stderr());
        }
    }
    assert!(failures > 60, "{failures}");
    assert!(!scratch.names().iter().any(|name| name.ends_with(".part")));
}

#[test]
fn flags_are_checked() {
    let scratch = scratch();
    let cases: &[(&[&str], &[&str])] = &[
        (&["--tile", "0/3"], &["I/N"]),
        (&["--tile", "4/3"], &["I/N"]),
        (&["--tile", "1/54"], &["--tile", "at most 53"]),
        (&["--samples", "4..4"], &["A..B"]),
        (&["--samples", "0..25"], &["--samples", "0..24"]),
        (&["--of", "32"], &["--samples"]),
        (&["--samples", "0..8", "--of", "32", "--spp", "16"], &["--of", "16"]),
        (&["--samples", "0..8", "--of", "0"], &["--of"]),
        (&["--tile", "1/2", "--png-layer", "all", "--aov", "Z"], &["--png-layer", "merge"]),
        (&["--samples", "0..8", "--noise", "0.1"], &["--samples", "--tile"]),
        (&["--samples", "0..24", "--noise", "0.1"], &["--samples", "--tile"]),
        (&["--tile", "1/2", "--time", "1"], &["--time", "--noise"]),
        (&["--part", "--crop", "0", "0", "9", "9", "--time", "1"], &["--time"]),
        (&["--tile", "1/2", "--overscan", "8"], &["--overscan"]),
        (&["--samples", "0..8", "--overscan", "8"], &["--overscan"]),
        (&["--part", "--overscan", "8"], &["--overscan"]),
        (&["--part", "--crypto-sidecar"], &["--crypto-sidecar", "merge"]),
    ];
    for (flags, texts) in cases {
        let done = scratch.run(&[&["render", "s.json", "-o", "x"], *flags].concat());
        refused(&done, texts);
    }
    render(&scratch, "t1", &["--tile", "1/1"]);
    let done = scratch.run(&["merge", "t1.exr", "-o", "t1"]);
    refused(&done, &["t1.exr", "would overwrite"]);
    let done = merge(&scratch, &["t1.exr"], &["--png-layer", "Z"]);
    refused(&done, &["--png-layer", "\"Z\""]);
    assert_eq!(scratch.names(), ["s.json", "t1.exr", "t1.png"]);
}

#[test]
fn irreproducible_parts_are_refused() {
    use lightpath::film::{Film, Window};
    use lightpath::merge::{PartDescription, PictureFormat, part};
    use lightpath::output::exr;
    use lightpath::scene::Source;
    use std::path::Path;

    let scratch = scratch();
    render(&scratch, "timed", &["--crop", "0", "0", "75", "20", "--time", "0.2"]);
    refused(&merge(&scratch, &["timed.exr"], &[]), &["timed.exr", "cannot be reproduced"]);
    let source = Source::Text { name: "scene", text: SCENE.as_bytes(), folder: Path::new("") };
    let scene = lightpath::scene::load(source, &[]).unwrap().scene;
    let film = Film::new([4, 4], Window::full(4, 4)).unwrap();
    let part = PartDescription {
        fingerprint: None,
        isa: None,
        whole: [0, 0, 4, 4],
        tile: None,
        samples: [0, 1],
        of: 1,
        exact: true,
        files: PictureFormat::new(&scene.tonemap),
        layout: Default::default(),
    };
    let write = |name: &str, part: &PartDescription, reproducible: &str| {
        let said = serde_json::to_string(part).unwrap();
        let attributes =
            [(part::ATTRIBUTE, said.as_str()), ("lightpath:reproducible", reproducible)];
        let attributes = attributes.map(|(name, value)| (name.to_string(), value.to_string()));
        let options = exr::Options { attributes: &attributes, ..exr::Options::default() };
        let path = scratch.path(name);
        let mut file = std::fs::File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&path)
            .unwrap();
        exr::write(&film, &options, &mut file, &path).unwrap();
    };
    for (reproducible, code) in [("yes", 0), ("no", 2)] {
        write("part.exr", &part, reproducible);
        let done = merge(&scratch, &["part.exr"], &[]);
        assert_eq!(done.code(), code, "{}", done.stderr());
        assert_eq!(done.stderr().contains("cannot be reproduced"), code == 2, "{}", done.stderr());
    }
    // Only Embree's last bits may depend on its instruction set.
    for (name, isa) in [("sse.exr", "SSE"), ("avx.exr", "AVX-512")] {
        write(name, &PartDescription { isa: Some(isa.to_string()), ..part.clone() }, "yes");
    }
    let said = ["avx.exr", "another instruction set of Embree: AVX-512, expected SSE"];
    refused(&merge(&scratch, &["sse.exr", "avx.exr"], &[]), &said);
}
