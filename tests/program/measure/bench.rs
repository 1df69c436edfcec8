//! `lightpath bench` through the program: table, JSON, page, baselines, and refusals.

use crate::support::program::{self, PYRAMID, Scratch};
use lightpath::lab::result::{BenchReport, WorkKind};
use serde_json::Value;

fn bench(scratch: &Scratch, flags: &[&str]) -> program::Done {
    scratch.run(&[&["bench", "--quick", "--threads", "2"], flags].concat())
}

fn pyramid() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("p.ply", PYRAMID);
    scratch
}

#[test]
fn a_mesh_is_measured_with_every_class_of_rays() {
    measured(["bvh", "bvh:portable"], "lightpath BVH ");
}

#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn a_mesh_is_measured_with_embree() {
    measured(["embree", "embree-fast"], "Embree 4.");
    measured(["embree", "embree-compact"], "Embree 4.");
}

/// Measured by Embree's own memory monitor; the ratio is 0.54 on the bunny.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn compact_embree_holds_less_than_three_quarters_of_the_memory() {
    let scratch = Scratch::new();
    let side = 240;
    std::fs::write(scratch.path("sheet.ply"), program::sheet(side)).unwrap();
    let flags = ["--backends", "embree,embree-compact", "--classes", "primary", "--json", "s.json"];
    let done = bench(&scratch, &[&["sheet.ply"], &flags[..]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let report: BenchReport = serde_json::from_slice(&scratch.read("s.json")).unwrap();
    let scene = &report.scenes[0];
    assert!(scene.triangles > 100_000 && scene.triangles >= u64::from(2 * side * side));
    let [full, compact] = &scene.backends[..] else { panic!("{:?}", scene.backends) };
    assert_eq!((full.name.as_str(), compact.name.as_str()), ("embree", "embree-compact"));
    assert!(4 * compact.bytes < 3 * full.bytes, "{} of {}", compact.bytes, full.bytes);
    assert!(compact.peak_bytes < full.peak_bytes);
    assert!(done.stdout().contains("B/triangle"), "{}", done.stdout());
}

/// Compact Embree is a column of measurements only. No picture can use it.
#[test]
fn compact_embree_cannot_render() {
    let scratch = pyramid();
    for flags in [["render", "p.ply", "-o", "x"], ["crosscheck", "p.ply", "--rays", "9"]] {
        let done = scratch.run(&[&flags[..], &["--backend", "embree-compact"]].concat());
        assert_eq!(done.code(), 2, "{flags:?}: {}", done.stderr());
        let said = "invalid value 'embree-compact'";
        assert!(done.stderr().contains(said), "{flags:?}: {}", done.stderr());
    }
    assert_eq!(scratch.names(), ["p.ply"]);
}

fn measured([first, second]: [&str; 2], version: &str) {
    let scratch = pyramid();
    let backends = format!("{first},{second}");
    let flags = ["p.ply", "--backends", &backends, "--json", "p.json", "--html", "p.html"];
    let done = bench(&scratch, &flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let report: BenchReport = serde_json::from_slice(&scratch.read("p.json")).unwrap();
    let scene = &report.scenes[0];
    assert_eq!((scene.name.as_str(), scene.backends.len()), ("p.ply", 2));
    // Only triangles of the mesh count, not the ground.
    assert_eq!(scene.triangles, 6);
    let classes = ["diffuse", "mirror", "primary", "shadow-area", "shadow-point"];
    assert_eq!(scene.rays.keys().collect::<Vec<_>>(), classes);
    for class in classes {
        assert!(scene.rays[class] > 0 && scene.rays[class] <= 4096, "{class}");
        for mode in ["single", "packets"] {
            for threads in [1, 2] {
                let key = (class, mode, threads);
                let mut rows = scene.rows.iter();
                let row = rows.find(|r| (r.name.as_str(), r.mode.as_str(), r.threads) == key);
                let row = row.unwrap_or_else(|| panic!("{class} {mode} {threads}"));
                for (i, entry) in row.entries.iter().enumerate() {
                    // Two rounds of A B B A.
                    assert_eq!(entry.seconds.len(), 4);
                    assert!(entry.seconds.iter().all(|s| *s > 0.0));
                    assert_eq!(entry.work, scene.rays[class]);
                    assert_eq!(entry.ratio.is_some(), i > 0);
                    assert_eq!(entry.wrong, Some(0), "{class} {mode}");
                    assert!(entry.hits.unwrap() <= entry.work);
                }
            }
        }
    }
    for what in [WorkKind::Build, WorkKind::Image] {
        assert_eq!(scene.rows.iter().filter(|row| row.what == what).count(), 2);
    }
    for backend in &scene.backends {
        assert!(backend.bytes > 0 && backend.peak_bytes >= backend.bytes);
        assert!(backend.version.starts_with(version));
    }
    let every_pair = 5 * 2;
    assert_eq!(scene.agreement.len(), every_pair);
    for pair in &scene.agreement {
        let a = &pair.agreement;
        assert_eq!(a.same + a.tie + a.depth + a.missed, scene.rays[&pair.name]);
    }
    let html = String::from_utf8(scratch.read("p.html")).unwrap();
    assert!(
        html.starts_with("<!DOCTYPE html>") && html.contains(&format!("{second} against {first}"))
    );
    let table = done.stdout();
    for text in ["p.ply: 6 triangles", "1 thread ", "2 threads", "shadow-area, packets", "p.html"] {
        assert!(table.contains(text), "{text}: {table}");
    }
    assert_eq!(scratch.names(), ["p.html", "p.json", "p.ply"]);
}

#[test]
fn missing_classes_are_reported_and_left_out() {
    let scratch = Scratch::new();
    scratch.write(
        "s.json",
        r#"{"nbounces": 0, "camera": {"type": "pinhole", "width": 40, "height": 30, "fov": 40,
            "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0]},
            "scene": {"lightsources": [], "shapes": [{"type": "sphere", "center": [0, 0, 0], "radius": 1,
            "material": {"kd": 1}}]}}"#,
    );
    let flags = ["s.json", "--backends", "bvh", "--classes", "diffuse,primary,mirror,shadow-area"];
    let done = bench(&scratch, &flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let table = done.stdout();
    assert!(table.contains("no mirror") && table.contains("no shadow-area"), "{table}");
    assert!(table.contains("primary, packets") && !table.contains("mirror, single"), "{table}");
    assert!(!table.contains("shadow-point"), "{table}");
}

#[test]
fn a_run_is_compared_with_a_baseline() {
    let scratch = pyramid();
    let base = ["p.ply", "--backends", "bvh", "--classes", "primary", "--quiet"];
    let first = bench(&scratch, &[&base[..], &["--save-baseline", "b.json"]].concat());
    assert_eq!((first.code(), first.stderr().as_str()), (0, ""));
    // The baseline is a thousand times slower, so the run is faster whatever the noise.
    let mut then: BenchReport = serde_json::from_slice(&scratch.read("b.json")).unwrap();
    for row in &mut then.scenes[0].rows {
        for seconds in row.entries.iter_mut().flat_map(|entry| &mut entry.seconds) {
            *seconds *= 1e3;
        }
    }
    scratch.write("b.json", &serde_json::to_string(&then).unwrap());
    let flags = ["--baseline", "b.json", "--json", "now.json"];
    let second = bench(&scratch, &[&base[..], &flags[..]].concat());
    let table = second.stdout();
    let changes = table.split("since the baseline").nth(1).expect("a comparison");
    assert_eq!(changes.lines().filter(|line| line.ends_with("  faster")).count(), 8, "{table}");

    let now: Value = serde_json::from_slice(&scratch.read("now.json")).unwrap();
    assert_eq!(now["growth"], serde_json::json!([]));
    let changes = now["since_baseline"]["changes"].as_array().unwrap();
    assert_eq!(changes.len(), 8);
    let faster = |change: &Value| change["ratio"]["value"].as_f64().unwrap() > 10.0;
    assert!(changes.iter().all(faster), "{changes:?}");

    let flags = ["--backends", "bvh:portable", "--html", "page.html"];
    let done = bench(&scratch, &[&["p.ply", "--baseline", "b.json"], &flags[..]].concat());
    let said = "no backend in common: bvh then, bvh:portable now";
    assert!(done.stdout().contains(&format!("baseline: {said}")), "{}", done.stdout());
    assert!(String::from_utf8(scratch.read("page.html")).unwrap().contains(said));
    scratch.write("other.ply", &PYRAMID.replace("0 2 0", "0 3 0"));
    let done = bench(&scratch, &["other.ply", "--backends", "bvh", "--baseline", "b.json"]);
    assert!(done.stdout().contains("no scene in common"), "{}", done.stdout());
}

/// A damaged baseline is refused by name, or compared with. The comparison may be nonsense, but the
/// run must end normally. Both cases must occur, or the test would check nothing.
#[test]
fn a_damaged_baseline_is_refused_or_compared_with() {
    let scratch = pyramid();
    let base = ["p.ply", "--backends", "bvh", "--classes", "primary", "--quiet"];
    let first = bench(&scratch, &[&base[..], &["--save-baseline", "b.json"]].concat());
    assert_eq!(first.code(), 0, "{}", first.stderr());
    let whole = scratch.read("b.json");
    let mut codes = [0, 0];
    let mut run = |what: &str, bytes: &[u8], expected: Option<i32>| {
        std::fs::write(scratch.path("m.json"), bytes).unwrap();
        let done = bench(&scratch, &[&base[..], &["--baseline", "m.json"]].concat());
        let (code, said) = (done.code(), done.stderr());
        assert!(code == 0 || code == 2, "{what}: exit {code}: {said}");
        assert!(expected.is_none_or(|expected| code == expected), "{what}: exit {code}: {said}");
        assert_eq!(code == 2, said.contains("m.json: "), "{what}: {said}");
        codes[usize::from(code == 2)] += 1;
    };
    let mut random = 1u64;
    let mut below = |n: usize| {
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (random >> 33) as usize % n
    };
    let digits: Vec<usize> = (0..whole.len()).filter(|&i| whole[i].is_ascii_digit()).collect();
    for n in 0..40 {
        let mut bytes = whole.clone();
        let at = below(bytes.len());
        let what = match n % 4 {
            0 => {
                bytes[digits[below(digits.len())]] = b'0' + below(10) as u8;
                "a digit"
            }
            1 => {
                bytes[at] ^= 1 << below(8);
                "a bit"
            }
            2 => {
                bytes.truncate(at);
                "an end"
            }
            _ => {
                bytes.remove(at);
                "a byte less"
            }
        };
        run(&format!("{what} at {at}"), &bytes, None);
    }
    run("no UTF-8", b"\xff\xfe{}", Some(2));
    run("untouched", &whole, Some(0));
    // Values that a reader might divide by or take the median of.
    for seconds in ["[]", "[0.0]", "[-1.0, 2.0]", "[1e308, 1e308, 1e308]"] {
        let mut then: serde_json::Value = serde_json::from_slice(&whole).unwrap();
        for row in then["scenes"][0]["rows"].as_array_mut().unwrap() {
            row["entries"][0]["seconds"] = serde_json::from_str(seconds).unwrap();
        }
        run(seconds, then.to_string().as_bytes(), None);
    }
    assert!(codes[0] >= 5 && codes[1] >= 5, "{codes:?}");
}

/// `--size` holds before the first measurement, as for a render.
#[test]
fn a_size_completes_a_scene() {
    let scratch = Scratch::new();
    scratch.write(
        "s.json",
        r#"{ "camera": { "type": "pinhole", "fov": 40, "position": [0, 0, 5], "lookat": [0, 0, -1],
                         "up": [0, 1, 0] },
             "scene": { "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1,
                                     "material": {} }] } }"#,
    );
    let run = |flags: &[&str]| {
        let args = ["bench", "s.json", "--backends", "bvh", "--classes", "primary"];
        scratch.run(&[&args, flags].concat())
    };
    run(&["--quick"]).good();
    let few = ["--rays", "1024", "--rounds", "2", "--threads", "1", "--size"];
    run(&[&few[..], &["40x30"]].concat()).good();
    let refused = run(&[&few[..], &["40000x40000"]].concat());
    assert!(refused.code() == 2 && refused.stdout().is_empty(), "{}", refused.stderr());
    assert!(refused.stderr().contains("--size"), "{}", refused.stderr());
}

#[test]
fn bad_use_is_refused_and_nothing_is_written() {
    let scratch = pyramid();
    scratch.write("no-report.json", "{\"version\": 1}");
    for (flags, said) in [
        (&["p.ply", "--backends", "embre"][..], "--backends: found \"embre\", expected some of"),
        (&["p.ply", "--backends", "embree,embree"], "found embree twice"),
        (&["p.ply", "--backends", "embree-compat"], "embree-fast, embree-compact, coursework"),
        (&["p.ply", "--backends", "embree:avx2"], "an instruction set only after bvh"),
        (&["p.ply", "--backends", "bvh:sse9"], "expected portable, neon, avx2 or avx512"),
        (&["p.ply", "--isa", "mmx"], "invalid value 'mmx' for '--isa"),
        (
            &["p.ply", "--classes", "primry"],
            "--classes: found \"primry\", expected some of primary",
        ),
        (&["p.ply", "--baseline", "none.json"], "none.json: cannot read"),
        (&["p.ply", "--baseline", "no-report.json"], "expected a file of `lightpath bench"),
        (&["p.ply", "--json", "p.ply"], "would overwrite"),
        (&["p.ply", "--json", "x", "--html", "./x"], "would overwrite"),
        (&["p.ply", "--json", "nowhere/x"], "no such folder"),
        (&["none.ply"], "none.ply"),
        (&["none.json"], "none.json"),
        (&["p.ply", "none.ply"], "none.ply"),
        (&["p.ply", "none.json"], "none.json"),
        (&["p.ply", "--rays", "9"], "cannot be used with"),
        (&[], "required"),
    ] {
        let done = bench(&scratch, flags);
        assert_eq!(done.code(), 2, "{flags:?}: {}", done.stderr());
        assert!(done.stderr().contains(said), "{flags:?}: {}", done.stderr());
        assert!(!done.stderr().contains("panicked"), "{}", done.stderr());
        assert_eq!(done.stdout(), "", "{flags:?}");
        assert_eq!(scratch.names(), ["no-report.json", "p.ply"], "{flags:?}");
    }
    let done = scratch.run(&["bench", "p.ply", "--seconds", "nan"]);
    assert!(
        done.code() == 2 && done.stderr().contains("--seconds: found NaN"),
        "{}",
        done.stderr()
    );
}
