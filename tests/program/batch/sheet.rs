//! The contact sheet in a browser: it needs no other file, shows turntables, sorts, and shows
//! failures.

use serde_json::json;

use crate::support::browser::browse;
use crate::support::program::{PYRAMID, Scratch};

/// A batch of turntables of two pyramids, and a file that is not a mesh.
fn sheet() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("scans/tall.ply", &PYRAMID.replace("0 2 0", "0 5 0"));
    scratch.write("scans/flat.ply", &PYRAMID.replace("0 2 0", "0 1 0"));
    scratch.write("scans/a<b>.ply", "ply\nformat ascii 1.0\n");
    let args = ["batch", "scans", "-o", "out", "--turntable", "6", "--size", "96x64", "--spp", "1"];
    let done = scratch.run(&[&args[..], &["--backend", "bvh", "--quiet"]].concat());
    assert_eq!(done.code(), 1, "{}", done.stderr());
    scratch
}

#[test]
fn the_page_has_no_external_references_and_escapes_names() {
    let scratch = sheet();
    let html = String::from_utf8(scratch.read("out/index.html")).unwrap();
    for outside in ["http:", "https:", "@import", "url(", "<b>"] {
        assert!(!html.contains(outside), "{outside}");
    }
    assert_eq!(html.matches("src=\"data:image/jpeg;base64,").count(), 2);
    assert_eq!(html.matches("<article").count(), 3);
    // Links lead to existing files of the batch.
    for link in html.split("href=\"").skip(1) {
        let link = link.split('"').next().unwrap();
        assert!(scratch.path("out").join(link).is_file(), "{link}");
    }
}

#[test]
fn complete_files_count_and_the_journal_does_not() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let turn = |frames: &str, more: &[&str], code: i32| {
        let args = ["batch", "a.ply", "-o", "out", "--turntable", frames, "--size", "24x16"];
        let done = scratch.run(&[&args[..], &["--backend", "bvh", "--quiet"], more].concat());
        assert_eq!(done.code(), code, "{}", done.stderr());
        String::from_utf8(scratch.read("out/index.html")).unwrap()
    };
    assert!(turn("6", &[], 0).contains("6 of 6 frames"));
    // The files are there, but they are of other angles.
    let html = turn("3", &["--sheet-only"], 1);
    assert!(html.contains("3 of 3 frames") && html.contains("class=\"missing\""), "{html}");
    assert!(html.contains("older than the job"), "{html}");
    turn("3", &[], 0);
    turn("3", &["--sheet-only"], 0);
    let whole = scratch.read("out/a/a.0001.exr");
    std::fs::remove_file(scratch.path("out/a/a.0001.exr")).unwrap();
    let html = turn("3", &["--sheet-only"], 1);
    assert!(html.contains("2 of 3 frames") && html.contains("class=\"missing\""), "{html}");
    std::fs::write(scratch.path("out/a/a.0001.exr"), &whole[..whole.len() - 1]).unwrap();
    assert!(turn("3", &["--sheet-only"], 1).contains("2 of 3 frames"));
    std::fs::write(scratch.path("out/a/a.0001.exr"), &whole).unwrap();
    // Only files count, also when no journal exists.
    std::fs::remove_file(scratch.path("out/batch.jsonl")).unwrap();
    let html = turn("3", &["--sheet-only"], 0);
    assert!(html.contains("3 of 3 frames") && html.contains("data-count=\"3\""), "{html}");
}

/// By their numbers, the frames are those of other records.
#[test]
fn records_of_other_frames_do_not_count() {
    let scratch = Scratch::new();
    scratch.write("scan.ply", PYRAMID);
    let run = |more: &[&str], code: i32| {
        let args = ["batch", "scan.ply", "-o", "out", "--threads", "2", "--backend", "bvh"];
        let done = scratch.run(&[&args[..], &["--spp", "1"], more].concat());
        assert_eq!(done.code(), code, "{more:?}: {}", done.stderr());
        done.stderr()
    };
    // The first camera leaves its list.
    let camera = |name: &&str| {
        json!({ "image": name, "camera": { "type": "pinhole", "width": 24, "height": 16,
            "fov": 40, "position": [0, 1, 8], "target": [0, 1, 0], "up": [0, 1, 0] } })
    };
    let list = |names: &[&str]| {
        let cameras: Vec<_> = names.iter().map(camera).collect();
        scratch.write("list.json", &json!({ "cameras": cameras }).to_string());
    };
    list(&["a", "b", "c"]);
    run(&["--cameras", "list.json"], 0);
    list(&["b", "c"]);
    for end in ["exr", "png"] {
        std::fs::remove_file(scratch.path(&format!("out/scan/a.{end}"))).unwrap();
    }
    let said = run(&["--cameras", "list.json", "--resume"], 0);
    assert!(said.contains("0 frames rendered, 2 kept"), "{said}");
    run(&["--cameras", "list.json", "--sheet-only"], 0);
    // A still of the same mesh whose files are gone, and one that failed.
    let turning = ["--size", "24x16", "--turntable", "3"];
    run(&turning, 0);
    run(&["--size", "24x16"], 0);
    for end in ["exr", "png"] {
        std::fs::remove_file(scratch.path(&format!("out/scan.{end}"))).unwrap();
    }
    run(&[&turning[..], &["--sheet-only"]].concat(), 0);
    run(&["--size", "24x16", "--max-memory", "1M"], 1);
    run(&[&turning[..], &["--sheet-only"]].concat(), 0);
    let html = String::from_utf8(scratch.read("out/index.html")).unwrap();
    assert!(html.contains("3 of 3 frames") && html.contains("class=\"done\""), "{html}");
}

/// As on a farm: every task has a range.
#[test]
fn a_failure_after_the_frames_were_made_counts() {
    let scratch = Scratch::new();
    scratch.write("scans/a.ply", PYRAMID);
    scratch.write("scans/b.ply", PYRAMID);
    let batch = |more: &[&str], code: i32| {
        let args = ["batch", "scans", "-o", "out", "--turntable", "2", "--size", "24x16"];
        let done = scratch.run(&[&args[..], &["--threads", "2"], more].concat());
        assert_eq!(done.code(), code, "{more:?}: {}", done.stderr());
        done.stderr()
    };
    let task = |range: &str, code: i32| batch(&["--range", range, "--resume", "--quiet"], code);
    for range in ["0..1", "1..2", "2..4"] {
        task(range, 0);
    }
    batch(&["--sheet-only"], 0);
    // All pictures of the mesh exist, but none is of the new file.
    scratch.write("scans/a.ply", "ply\n");
    for (range, code) in [("0..1", 1), ("1..2", 1), ("2..4", 0)] {
        task(range, code);
    }
    let said = batch(&["--sheet-only"], 1);
    assert!(said.contains("1 of 2 inputs lack frames or failed:"), "{said}");
    assert!(said.contains("scans/a.ply: all frames are older than a failure: "), "{said}");
    // A later success of a frame resolves the failure of this frame only.
    scratch.write("scans/a.ply", PYRAMID);
    task("1..2", 0);
    let said = batch(&["--sheet-only"], 1);
    assert!(said.contains("scans/a.ply: frame 0 is older than a failure: "), "{said}");
    task("0..1", 0);
    batch(&["--sheet-only"], 0);
}

/// A second submission may die before its tasks begin.
#[test]
fn frames_of_other_settings_or_files_are_older() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    scratch.write("b.ply", PYRAMID);
    let job = |exposure: u32| {
        let job = json!({ "inputs": ["a.ply", "b.ply"], "size": [24, 16],
                          "set": { "/tonemap/exposure": exposure },
                          "turntable": { "frames": 2 } });
        scratch.write("job.json", &job.to_string());
    };
    let run = |more: &[&str], code: i32| {
        let args = ["batch", "job.json", "-o", "out", "--threads", "2", "--quiet"];
        let done = scratch.run(&[&args[..], more].concat());
        assert_eq!(done.code(), code, "{more:?}: {}", done.stderr());
        done.stderr()
    };
    job(0);
    run(&[], 0);
    run(&["--sheet-only"], 0);
    job(1);
    let said = run(&["--sheet-only"], 1);
    assert!(said.contains("2 of 2 inputs lack frames or failed:"), "{said}");
    let older = "a.ply: all frames are older than the job: out/a/a.0000.exr: the scene changed";
    assert!(said.contains(older), "{said}");
    let page = || String::from_utf8(scratch.read("out/index.html")).unwrap();
    assert_eq!(page().matches("all frames are older than the job: ").count(), 2);
    assert_eq!(page().matches("<article class=\"missing\"").count(), 2);
    job(0);
    run(&["--sheet-only"], 0);
    assert_eq!(page().matches("<article class=\"done\"").count(), 2);
    assert!(!page().contains("older than"));
    // A frame that is cut short is missing, and the rest is older: the mesh changed.
    let whole = scratch.read("out/b/b.0000.exr");
    std::fs::write(scratch.path("out/b/b.0000.exr"), &whole[..whole.len() / 2]).unwrap();
    let said = run(&["--sheet-only"], 1);
    let broken = "b.ply: frame 0 is missing: out/b/b.0000.exr is not whole";
    assert!(said.contains(broken) && said.contains("1 of 2 inputs"), "{said}");
    scratch.write("b.ply", &PYRAMID.replace("0 2 0", "0 2.5 0"));
    let said = run(&["--sheet-only"], 1);
    assert!(said.contains("b.ply: frame 1 is older than the job: "), "{said}");
    // A mesh that became invalid cannot be compared, though no run has tried it.
    run(&["--resume"], 0);
    run(&["--sheet-only"], 0);
    scratch.write("b.ply", "ply\n");
    let said = run(&["--sheet-only"], 1);
    assert!(said.contains("b.ply: its frames cannot be compared with it: "), "{said}");
}

/// The same mesh twice, once with an invalid setting.
#[test]
fn inputs_of_one_path_have_their_own_records() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    let job = r#"{ "inputs": ["PATH", { "path": "PATH", "set": { "/camera/fov": 500 } }],
                   "output": { "name": "{input}" }, "size": [24, 16] }"#;
    scratch.write("job.json", &job.replace("PATH", "a.ply"));
    let run = |more: &[&str]| {
        let args = ["batch", "job.json", "-o", "out", "--threads", "2", "--quiet"];
        let done = scratch.run(&[&args[..], more].concat());
        assert_eq!(done.code(), 1, "{}", done.stderr());
        (done.stderr(), String::from_utf8(scratch.read("out/index.html")).unwrap())
    };
    let cards = |html: &str| {
        ["done", "failed"].map(|class| html.matches(&format!("<article class=\"{class}\"")).count())
    };
    let (said, html) = run(&[]);
    assert!(said.contains("1 of 2 inputs failed:"), "{said}");
    assert_eq!(cards(&html), [1, 1]);
    // Another spelling of the path.
    let other = scratch.path("a.ply").display().to_string();
    scratch.write("job.json", &job.replace("PATH", &other));
    let (said, html) = run(&["--sheet-only"]);
    assert!(said.contains(": all frames are missing: job.json:1:"), "{said}");
    assert!(said.contains("(/inputs/1/set/~1camera~1fov): found 500"), "{said}");
    assert_eq!(cards(&html), [1, 1]);
    // Journals of earlier versions know only the path.
    let old = String::from_utf8(scratch.read("out/batch.jsonl")).unwrap();
    let failed = old.lines().find(|line| line.contains("\"failed\"")).unwrap();
    let mut failed: serde_json::Value = serde_json::from_str(failed).unwrap();
    failed.as_object_mut().unwrap().remove("name").unwrap();
    scratch.write("out/batch.jsonl", &format!("{failed}\n"));
    scratch.write("job.json", &job.replace("PATH", "a.ply"));
    let (said, _) = run(&["--sheet-only"]);
    assert!(said.contains("all frames are missing: job.json:1:"), "{said}");
    // Two inputs fail, not one.
    scratch.write("a.ply", "ply\n");
    assert!(run(&[]).0.contains("2 of 2 inputs failed:"));
}

#[test]
fn failures_are_listed_although_the_sheet_fails_too() {
    let scratch = Scratch::new();
    scratch.write("a.ply", PYRAMID);
    scratch.write("b.ply", "ply\n");
    std::fs::create_dir_all(scratch.path("out/index.html")).unwrap();
    let args = ["batch", "a.ply", "b.ply", "-o", "out", "--size", "24x16", "--threads", "2"];
    let done = scratch.run(&args);
    let said = done.stderr();
    assert_eq!(done.code(), 1, "{said}");
    let listed = said.split("1 of 2 inputs failed:").nth(1).unwrap();
    assert!(listed.contains("b.ply: ") && listed.contains("out/index.html"), "{said}");
    assert_eq!(scratch.run(&[&args[..2], &args[3..]].concat()).code(), 2);
}

#[test]
fn a_browser_shows_the_sheet() {
    let scratch = sheet();
    let page = scratch.path("out/index.html");
    // A script acts like the mouse and the menu, and writes the result into the page.
    let html = String::from_utf8(scratch.read("out/index.html")).unwrap();
    let acts = "<script>
      const all = () => [...document.querySelectorAll('article:not([hidden]) h2')];
      const order = () => all().map((h) => h.textContent).join(',');
      const set = (id, key, value) => {
        document.getElementById(id)[key] = value;
        document.getElementById(id).dispatchEvent(new Event('input'));
      };
      const said = [];
      set('sort', 'value', 'name'); set('down', 'checked', true); said.push(order());
      set('sort', 'value', 'state'); set('down', 'checked', false); said.push(order());
      set('bad', 'checked', true); said.push(order()); set('bad', 'checked', false);
      set('find', 'value', 'TALL'); said.push(order()); set('find', 'value', '');
      const slider = document.querySelector('input[type=range]');
      slider.value = 3; slider.dispatchEvent(new Event('input'));
      said.push(document.querySelector('.strip img').style.transform);
      const image = document.querySelector('.strip img');
      said.push(image.naturalWidth / image.naturalHeight);
      document.body.dataset.said = said.join(' | ');
    </script></body>";
    scratch.write("out/acted.html", &html.replace("</body>", acts));
    let Some(dom) = browse(&["--dump-dom"], &scratch.path("out/acted.html")) else {
        return;
    };
    let said = dom.split("data-said=\"").nth(1).and_then(|rest| rest.split('"').next());
    let bad = "a&lt;b&gt;.ply";
    let expected = format!(
        "tall.ply,flat.ply,{bad} | {bad},flat.ply,tall.ply | {bad} | tall.ply | translateX(-50%) | 9"
    );
    assert_eq!(said, Some(expected.as_str()), "{dom}");
    // The screenshot is red where a mesh failed and has many colours elsewhere.
    let shot = scratch.path("shot.png");
    let args = [format!("--screenshot={}", shot.display()), "--window-size=900,700".to_string()];
    browse(&[&args[0], &args[1]], &page).unwrap();
    let picture = image::open(&shot).unwrap().to_rgb8();
    let red = picture.pixels().filter(|p| p.0 == [0xc8, 0x10, 0x2e]).count();
    assert!(red > 300, "{red}");
    let colours: std::collections::HashSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
    assert!(colours.len() > 100, "{}", colours.len());
    if let Ok(keep) = std::env::var("LIGHTPATH_KEEP_SHEET") {
        std::fs::copy(&shot, keep).unwrap();
    }
}
