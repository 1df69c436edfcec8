//! Cryptomattes through the program: how many objects a pixel can hold, and which parts of a file
//! announce them.

use std::collections::BTreeMap;

use crate::support::program::{Done, Scratch};
use serde_json::{Value, json};

/// A scene whose pixels see up to a dozen spheres, some with the same name.
fn scene(output: Value) -> Value {
    let sphere = |i: u32| {
        let (x, y) = (f64::from(i % 12) - 5.5, f64::from(i / 12) - 3.5);
        json!({ "type": "sphere", "center": [0.5 * x, 0.5 * y, 0.1 * x], "radius": 0.23,
                "name": format!("s{}", i % 90), "material": if i % 3 == 0 { "chalk" } else { "ink" } })
    };
    json!({
        "spp": 64, "output": output,
        "camera": { "type": "pinhole", "width": 4, "height": 3, "fov": 40,
                    "position": [0, 0, 6], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": {
            "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
            "materials": { "chalk": {}, "ink": { "kd": 0.1 } },
            "shapes": (0..96).map(sphere).collect::<Vec<_>>() }
    })
}

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", &scene(json!({ "layers": ["cryptomatte"] })).to_string());
    scratch
}

fn render(scratch: &Scratch, name: &str, flags: &[&str]) -> Done {
    scratch.run(&[&["render", "s.json", "--quiet", "-o", name], flags].concat())
}

#[track_caller]
fn rendered(scratch: &Scratch, name: &str, flags: &[&str]) -> Vec<u8> {
    let done = render(scratch, name, flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    scratch.read(&format!("{name}.exr"))
}

type Channels = BTreeMap<String, Vec<f32>>;

fn channels(scratch: &Scratch, name: &str) -> Channels {
    scratch.floats(&format!("{name}.exr"))
}

/// Returns id and coverage of every rank of every pixel.
fn ranks(channels: &Channels, kind: &str) -> Vec<Vec<[f32; 2]>> {
    let names: Vec<&String> = channels.keys().filter(|name| name.starts_with(kind)).collect();
    assert_eq!(names.len() % 4, 0, "{names:?}");
    let channel = |layer: usize, suffix: &str| &channels[&format!("{kind}{layer:02}.{suffix}")];
    let pixel = |i: usize| {
        let layer = |n: usize| {
            let [r, g, b, a] = ["R", "G", "B", "A"].map(|suffix| channel(n, suffix)[i]);
            [[r, g], [b, a]]
        };
        (0..names.len() / 4).flat_map(layer).collect()
    };
    (0..channels["A"].len()).map(pixel).collect()
}

#[test]
fn a_pixel_holds_as_many_objects_as_it_has_ranks() {
    let scratch = scratch();
    let usual = rendered(&scratch, "usual", &["--transparent", "--float"]);
    let same = rendered(&scratch, "same", &["--transparent", "--float", "--crypto-ranks", "6"]);
    assert!(same == usual, "6 is the default");
    rendered(&scratch, "most", &["--transparent", "--float", "--crypto-ranks", "16"]);
    let most = channels(&scratch, "most");
    let mut coverages = Vec::new();
    for count in ["2", "4", "6", "10", "16"] {
        rendered(&scratch, "x", &["--transparent", "--float", "--crypto-ranks", count]);
        let set = format!("/output/cryptoranks={count}");
        rendered(&scratch, "set", &["--transparent", "--float", "--set", &set]);
        assert!(scratch.read("set.exr") == scratch.read("x.exr"), "{count}");
        let (found, count) = (channels(&scratch, "x"), count.parse::<usize>().unwrap());
        let mut covered = 0.0;
        for kind in ["CryptoObject", "CryptoMaterial"] {
            let (all, some) = (ranks(&most, kind), ranks(&found, kind));
            for (i, (all, some)) in all.iter().zip(&some).enumerate() {
                assert_eq!((all.len(), some.len()), (16, count));
                // With fewer ranks, a pixel keeps those with the most coverage.
                assert!(all[..count] == some[..], "{kind}, pixel {i}");
                assert!(some.windows(2).all(|two| two[0][1] >= two[1][1]));
                let sum: f32 = some.iter().map(|[_, coverage]| coverage).sum();
                covered += sum;
                let alpha = found["A"][i];
                assert!(sum <= alpha, "{sum} of {alpha}");
                assert!(count < 16 || sum == alpha, "{sum} of {alpha}");
            }
        }
        coverages.push(covered);
    }
    // This scene needs every rank.
    assert!(coverages.windows(2).all(|two| two[0] < two[1]), "{coverages:?}");
}

/// Returns the warning of a render or a merge, without its first word.
fn warning(done: &Done) -> Option<String> {
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let text = done.stderr();
    let (_, rest) = text.split_once("warning: ")?;
    Some(rest.lines().take(2).collect::<Vec<_>>().join("\n"))
}

#[test]
fn coverage_that_no_rank_holds_is_counted() {
    let scratch = scratch();
    let run = |name: &str, flags: &[&str]| {
        let common = ["render", "s.json", "-o", name, "--transparent", "--float"];
        scratch.run(&[&common, flags].concat())
    };
    let mut enough = String::new();
    for count in ["2", "6"] {
        let said = warning(&run("x", &["--crypto-ranks", count])).expect(count);
        let found = channels(&scratch, "x");
        let lost = |pixel: usize| {
            let sum = |kind| ranks(&found, kind)[pixel].iter().map(|[_, share]| share).sum();
            let sums: [f32; 2] = ["CryptoObject", "CryptoMaterial"].map(sum);
            found["A"][pixel] - sums[0].min(sums[1])
        };
        let lost: Vec<f32> = (0..12).map(lost).collect();
        let pixels = lost.iter().filter(|lost| **lost > 0.0).count();
        let most = lost.iter().copied().fold(0.0, f32::max);
        assert!(pixels > 0);
        assert!(said.starts_with(&format!("{pixels} pixels see more things")), "{said}");
        assert!(said.contains(&format!("up to {most:.2} of a pixel's coverage is lost")), "{said}");
        let (_, help) = said.split_once("--crypto-ranks ").unwrap();
        enough = help.split_once(' ').unwrap().0.to_string();
        // Partial sums hold everything. Only the merge must drop some.
        let parts = [("a", "0..24"), ("b", "24..64")];
        for (name, part) in parts {
            let flags = ["--crypto-ranks", count, "--of", "64", "--samples", part];
            assert_eq!(warning(&run(name, &flags)), None);
        }
        let merged = scratch.run(&["merge", "a.exr", "b.exr", "-o", "merged"]);
        assert_eq!(warning(&merged).as_ref(), Some(&said));
    }
    assert_eq!(warning(&run("x", &["--crypto-ranks", &enough])), None);
    let fewer = (enough.parse::<u32>().unwrap() - 2).to_string();
    assert!(warning(&run("x", &["--crypto-ranks", &fewer])).is_some());
    assert_eq!(warning(&run("x", &["--set", "/output/layers=[\"N\"]"])), None);
    // Adaptive sampling uses other code.
    let adaptive = ["--crypto-ranks", "2", "--spp", "16", "--noise", "0.5", "--max-spp", "64"];
    assert!(warning(&run("x", &adaptive)).is_some());
}

#[test]
fn ranks_that_no_reader_expects_are_refused() {
    let scratch = scratch();
    for bad in ["0", "1", "5", "18", "-2", "4294967298", "9223372036854775807"] {
        let done = render(&scratch, "x", &["--crypto-ranks", bad]);
        assert_eq!(done.code(), 2, "{bad}: {}", done.stderr());
        let expected = format!("found {bad}, expected an even integer in [2, 16]");
        assert!(done.stderr().contains(&expected), "{}", done.stderr());
        assert!(done.stderr().contains("--crypto-ranks"), "{}", done.stderr());
    }
    for bad in ["six", "4.0", ""] {
        let done = render(&scratch, "x", &["--crypto-ranks", bad]);
        assert_eq!(done.code(), 2, "{bad}: {}", done.stderr());
    }
    for (bad, found) in [("3", "found 3"), ("\"6\"", "found \"6\""), ("[6]", "found an array")] {
        let done = render(&scratch, "x", &["--set", &format!("/output/cryptoranks={bad}")]);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        assert!(done.stderr().contains(found), "{}", done.stderr());
    }
    assert_eq!(scratch.names(), ["s.json"]);
}

#[test]
fn parts_keep_their_ranks() {
    let scratch = scratch();
    for ranks in ["2", "14"] {
        let flags = ["--crypto-ranks", ranks];
        let whole = rendered(&scratch, "whole", &flags);
        for (flag, parts) in [("--tile", ["1/2", "2/2"]), ("--samples", ["0..24", "24..64"])] {
            for (name, part) in ["a", "b"].into_iter().zip(parts) {
                rendered(&scratch, name, &[&flags[..], &[flag, part]].concat());
            }
            let done = scratch.run(&["merge", "a.exr", "b.exr", "-o", "merged", "--quiet"]);
            assert_eq!(done.code(), 0, "{}", done.stderr());
            assert!(scratch.read("merged.exr") == whole, "{ranks} by {flag}");
            rendered(&scratch, "b", &["--crypto-ranks", "6", flag, parts[1]]);
            let done = scratch.run(&["merge", "a.exr", "b.exr", "-o", "mixed", "--quiet"]);
            assert_eq!(done.code(), 2, "{}", done.stderr());
            assert!(done.stderr().contains("b.exr: found another"), "{}", done.stderr());
        }
    }
    assert!(!scratch.names().iter().any(|name| name.starts_with("mixed")));
}

#[test]
fn a_job_sets_the_ranks_of_all_frames() {
    let scratch = scratch();
    let job = json!({ "inputs": ["s.json"], "cryptoranks": 4, "output": { "folder": "out" } });
    scratch.write("job.json", &job.to_string());
    let batch = |flags: &[&str]| {
        let done = scratch.run(&[&["batch", "job.json", "--quiet", "--no-sheet"], flags].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
        ranks(&channels(&scratch, "out/s"), "CryptoObject")[0].len()
    };
    assert_eq!(batch(&[]), 4);
    let kept = scratch.read("out/s.exr");
    assert_eq!(batch(&["--resume"]), 4);
    assert!(scratch.read("out/s.exr") == kept);
    // Flags win. A frame with another number of ranks is not the same frame.
    assert_eq!(batch(&["--resume", "--crypto-ranks", "8"]), 8);
    scratch.write("job.json", &job.to_string().replace('4', "7"));
    let done = scratch.run(&["batch", "job.json"]);
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("found 7, expected an even integer"), "{}", done.stderr());
}

#[test]
fn memory_grows_with_the_ranks() {
    let scratch = scratch();
    let film = |output: Value| {
        scratch.write("m.json", &scene(output).to_string());
        let done = scratch.run(&["info", "--json", "m.json"]);
        let info: Value = serde_json::from_str(&done.stdout()).unwrap();
        info["memory"]["film_bytes"].as_u64().unwrap()
    };
    let of = |ranks: u32| film(json!({ "layers": ["CryptoObject"], "cryptoranks": ranks }));
    let (pixels, word) = (4 * 3, 4);
    assert_eq!(of(6), film(json!({ "layers": ["CryptoObject"] })));
    assert_eq!(of(16) - of(6), pixels * word * 2 * 10);
    assert_eq!(of(6) - of(2), pixels * word * 2 * 4);
    // Without mattes, the number of ranks needs no memory.
    let none = |ranks: u32| film(json!({ "layers": ["Z"], "cryptoranks": ranks }));
    assert_eq!(none(2), none(16));
}

#[test]
fn names_of_any_language_are_stored_unchanged() {
    let scratch = scratch();
    // The first name is the specification's own example.
    let names = ["равнина", "Käse \"1\" \\ 日本"];
    let mut scene = scene(json!({ "layers": ["CryptoObject"] }));
    for (shape, name) in scene["scene"]["shapes"].as_array_mut().unwrap().iter_mut().zip(names) {
        shape["name"] = json!(name);
    }
    scratch.write("s.json", &scene.to_string());
    let whole = rendered(&scratch, "whole", &[]);
    let said = scratch.run(&["info", "whole.exr"]).stdout();
    for pair in ["\"равнина\":\"9623511e\"", "{\"Käse \\\"1\\\" \\\\ 日本\":"] {
        assert!(whole.windows(pair.len()).any(|bytes| bytes == pair.as_bytes()), "{said}");
        assert!(said.contains(pair), "{said}");
    }
    for (name, tile) in [("a", "1/2"), ("b", "2/2")] {
        rendered(&scratch, name, &["--tile", tile]);
    }
    let merge = |flags: &[&str]| {
        let done = scratch.run(&[&["merge", "a.exr", "b.exr", "--quiet", "-o"], flags].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
    };
    merge(&["merged"]);
    assert!(scratch.read("merged.exr") == whole);
    // File names may have any language, too.
    rendered(&scratch, "кадр", &["--crypto-sidecar"]);
    let text = scratch.read("кадр.CryptoObject.json");
    let known: BTreeMap<String, String> = serde_json::from_slice(&text).unwrap();
    assert_eq!(known[names[0]], "9623511e");
    assert!(known.contains_key(names[1]));
    let file = &announced(&scratch, "кадр.exr")[""];
    assert!(file.iter().any(|(_, value)| value == "кадр.CryptoObject.json"), "{file:?}");
    merge(&["картина", "--crypto-sidecar"]);
    assert!(scratch.read("картина.CryptoObject.json") == text);
}

/// Returns the attributes of cryptomattes, by the name of the part.
fn announced(scratch: &Scratch, file: &str) -> BTreeMap<String, BTreeMap<String, String>> {
    let info: Value =
        serde_json::from_str(&scratch.run(&["info", "--json", file]).stdout()).unwrap();
    let part = |part: &Value| {
        let attributes = part["attributes"].as_object().unwrap().iter();
        let mattes = attributes.filter(|(name, _)| name.starts_with("cryptomatte/"));
        let text = |value: &Value| value.as_str().unwrap().to_string();
        let mattes = mattes.map(|(name, value)| (name.clone(), text(value))).collect();
        (part["name"].as_str().unwrap_or_default().to_string(), mattes)
    };
    info["parts"].as_array().unwrap().iter().map(part).collect()
}

#[test]
fn mattes_are_announced_in_the_first_part_and_in_their_own() {
    let scratch = scratch();
    for sidecar in [&[][..], &["--crypto-sidecar"]] {
        let layers = ["--aov", "Z,N,cryptomatte"];
        rendered(&scratch, "one", &[&layers[..], sidecar].concat());
        let one = &announced(&scratch, "one.exr")[""];
        assert_eq!(one.len(), 8);
        rendered(&scratch, "many", &[&layers[..], &["--multipart"], sidecar].concat());
        let many = announced(&scratch, "many.exr");
        let names: Vec<&str> = many.keys().map(String::as_str).collect();
        assert_eq!(names, ["CryptoMaterial", "CryptoObject", "N", "Z", "rgba"]);
        let renamed =
            |(name, value): (&String, &String)| (name.clone(), value.replace("one.", "many."));
        assert_eq!(many["rgba"], one.iter().map(renamed).collect());
        for kind in ["CryptoObject", "CryptoMaterial"] {
            let own = &many[kind];
            assert_eq!(own.len(), 4, "{own:?}");
            assert!(own.iter().any(|(name, value)| name.ends_with("/name") && value == kind));
            assert!(own.iter().all(|(name, value)| many["rgba"][name] == *value));
        }
        assert!(many["N"].is_empty() && many["Z"].is_empty());
    }
}
