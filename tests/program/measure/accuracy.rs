//! `accuracy` through the program: the whole quick catalogue passes; outputs and exit codes.

use std::collections::BTreeSet;

use crate::support::program::{Done, Scratch};
use serde_json::Value;

fn json(scratch: &Scratch, name: &str) -> Value {
    serde_json::from_slice(&scratch.read(name)).unwrap()
}

fn names(report: &Value, list: &str) -> Vec<String> {
    let list = report[list].as_array().unwrap();
    list.iter().map(|entry| entry["name"].as_str().unwrap().to_string()).collect()
}

#[test]
fn the_quick_catalogue_holds_and_is_documented() {
    let scratch = Scratch::new();
    let files = ["--json", "a.json", "--html", "a.html", "--markdown", "a.md"];
    let done = scratch.run(&[&["accuracy", "--quick"], &files[..]].concat());
    assert_eq!(done.code(), 0, "{}\n{}", done.stdout(), done.stderr());
    assert_eq!(scratch.names(), ["a.html", "a.json", "a.md"]);
    let report = json(&scratch, "a.json");

    // Every backend and instruction set of this machine is listed.
    let columns = names(&report, "columns");
    for name in ["bvh:portable", "coursework", "brute"] {
        assert!(columns.iter().any(|column| column == name), "{columns:?}");
    }
    assert_eq!(columns.iter().any(|column| column == "embree"), cfg!(lightpath_embree));
    assert_eq!(report["version"], 1);
    assert!(report["machine"]["versions"]["lightpath"].is_string());

    // Our tree and the oracle must have judged rays and no failure.
    let rows = report["rows"].as_array().unwrap();
    assert!(rows.len() >= 60, "{}", rows.len());
    for row in rows {
        let entries = row["entries"].as_array().unwrap();
        assert_eq!(entries.len(), columns.len());
        for (column, entry) in columns.iter().zip(entries) {
            let place = format!("{}, {column}", row["name"]);
            assert!(entry["rays"].as_u64().unwrap() > 0, "{place}");
            if column.starts_with("bvh") || column == "brute" {
                assert_eq!(entry["failed"], 0, "{place}");
                assert_eq!(entry["missed"], Value::Null, "{place}");
            }
        }
    }
    // The cases can fail: `coursework` fails where its offset is too large and where it is too
    // small.
    let coursework = columns.iter().position(|column| column == "coursework").unwrap();
    for name in ["occluder in contact, scale 1e-6", "self-intersection, scale 1e6", "tiny and far"]
    {
        let row = rows.iter().find(|row| row["name"] == name).unwrap();
        assert!(row["entries"][coursework]["failed"].as_u64().unwrap() > 0, "{name}");
    }

    // docs/notebook/accuracy-catalogue.md has the same rows.
    let text = |path: &str| std::fs::read_to_string(path).unwrap();
    let committed =
        text(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/notebook/accuracy-catalogue.md"));
    let made = String::from_utf8(scratch.read("a.md")).unwrap();
    let listed = |page: &str| -> BTreeSet<String> {
        let lines = page.lines().filter_map(|line| line.strip_prefix("- **"));
        lines.filter_map(|line| Some(line.split_once("**")?.0.to_string())).collect()
    };
    let expected: BTreeSet<String> = names(&report, "rows").into_iter().collect();
    assert_eq!(listed(&made), expected);
    assert_eq!(
        listed(&committed),
        expected,
        "docs/notebook/accuracy-catalogue.md: run `accuracy --markdown`"
    );

    // The columns of docs/notebook/accuracy-catalogue.md are existing backends. They need not
    // include this machine's instruction sets.
    let named = committed.lines().filter_map(|line| line.strip_prefix("| `")?.split_once('`'));
    let named: Vec<&str> = named.map(|(name, _)| name).collect();
    assert!(named.contains(&"embree") && named.contains(&"bvh:portable"), "{named:?}");
    for name in named {
        let known = ["embree-fast", "embree", "coursework", "brute"].contains(&name);
        assert!(known || name.starts_with("bvh:"), "docs/notebook/accuracy-catalogue.md: {name}");
    }

    // The HTML page is complete and refers to nothing outside it.
    let html = String::from_utf8(scratch.read("a.html")).unwrap();
    assert!(html.ends_with("</html>\n") && html.contains("every mark holds"));
    assert!(html.contains("src=\"data:image/png;base64,iVBOR"), "no picture");
    for outside in ["src=\"http", "href=", "@import"] {
        assert!(!html.contains(outside), "{outside}");
    }
}

#[test]
fn a_selection_has_the_same_rays_for_any_number_of_threads() {
    let scratch = Scratch::new();
    let counts = |threads: &str, seed: &str| {
        let flags = ["--case", "grazing", "--backend", "bvh,coursework", "--json", "a.json"];
        let more = ["--threads", threads, "--seed", seed, "--quiet"];
        let done = scratch.run(&[&["accuracy"], &flags[..], &more[..]].concat());
        assert_eq!((done.code(), done.stderr().as_str()), (0, ""));
        let report = json(&scratch, "a.json");
        assert!(report["rows"].as_array().unwrap().len() > 1);
        let last = names(&report, "columns").pop();
        assert_eq!(last.as_deref(), Some("coursework"));
        let mut counts = Vec::new();
        for row in report["rows"].as_array().unwrap() {
            for entry in row["entries"].as_array().unwrap() {
                let of = |key: &str| entry[key].to_string();
                counts.push(["rays", "measured", "within_bound", "worst_ulp", "failed"].map(of));
            }
        }
        counts
    };
    assert_eq!(counts("1", "7"), counts("2", "7"));
    assert_ne!(counts("2", "7"), counts("2", "8"));
}

/// Only `bvh` and `brute` promise the lowest of equally near primitives.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn ties_of_embree_are_counted_but_not_wrong() {
    let scratch = Scratch::new();
    let flags = ["--case", "duplicates", "--backend", "embree,bvh:portable", "--json", "a.json"];
    let files = ["--html", "a.html", "--markdown", "a.md"];
    let done = scratch.run(&[&["accuracy"], &flags[..], &files[..]].concat()).good();
    let report = json(&scratch, "a.json");
    let [embree, ours] = [0, 1].map(|i| &report["rows"][0]["entries"][i]);
    assert_eq!((&embree["failed"], &embree["failures"]), (&0.into(), &serde_json::json!({})));
    let ties = embree["ties"].as_u64().unwrap();
    assert!(ties > 0, "{embree}");
    assert_eq!((&ours["failed"], &ours["ties"]), (&0.into(), &0.into()));
    for part in
        ["ties, not wrong: embree ", "; ulp and relative are the worst of `bvh`", "1 case, "]
    {
        assert!(done.stdout().contains(part), "{part}: {}", done.stdout());
    }
    let page = |name: &str| String::from_utf8(scratch.read(name)).unwrap();
    assert!(page("a.html").contains("Ties: equally near"));
    assert!(page("a.md").contains(" ties |") && page("a.md").contains("- 1 case, "));
}

/// `coursework` traces a part of the rays: its rate is of its own answers.
#[test]
fn rates_are_of_the_backends_own_answers() {
    let scratch = Scratch::new();
    let flags = ["--case", "occluder in contact, scale 1e-6", "--json", "a.json"];
    let run = |backends: &str| {
        scratch.run(&[&["accuracy", "--backend", backends], &flags[..]].concat()).good().stdout()
    };
    let text = run("bvh:portable,coursework");
    let row = &json(&scratch, "a.json")["rows"][0];
    let number = |entry: &Value, key: &str| entry[key].as_f64().unwrap();
    let slow = &row["entries"][1];
    assert!(number(slow, "rays") < number(row, "rays") && number(slow, "failed") > 0.0, "{row}");
    let rate = (number(slow, "failed") * 1e6 / number(slow, "rays")).round().to_string();
    let shown = text.replace(',', "");
    assert!(shown.lines().any(|line| line.split(' ').any(|word| word == rate)), "{rate}: {text}");
    assert!(run("coursework").contains("are the worst of these backends"));
}

#[test]
fn bad_use_exits_2_before_the_work() {
    let scratch = Scratch::new();
    let cases: &[(&[&str], &str)] = &[
        (&["accuracy", "--quick", "--full"], "cannot be used with"),
        (&["accuracy", "--times", "0"], "--times"),
        (&["accuracy", "--times", "3", "--full"], "cannot be used with"),
        (&["accuracy", "--backend", "gpu"], "expected some of bvh"),
        (&["accuracy", "--backend", "bvh,bvh:portable"], "twice"),
        (&["accuracy", "--backend", "bvh:sse9"], "portable, neon, avx2 or avx512"),
        (&["accuracy", "--case", "no such case"], "groups: watertight"),
        (&["accuracy", "--json", "a", "--html", "a"], "or another output"),
        (&["accuracy", "--json", "missing/a.json"], "no such folder"),
        (&["accuracy", "--threads", "0"], "--threads"),
    ];
    for (args, expected) in cases {
        let done = scratch.run(args);
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        assert!(done.stderr().contains(expected), "{args:?}: {}", done.stderr());
        assert_eq!(done.stdout(), "", "{args:?}");
    }
    assert!(scratch.names().is_empty());
}

#[cfg(unix)]
#[test]
fn a_missing_folder_of_temporary_files_is_named() {
    let scratch = Scratch::new();
    let mut command = scratch.command(&["accuracy", "--quick", "--case", "map", "--quiet"]);
    let done = Done::of(command.env("TMPDIR", scratch.path("none")));
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("  help: set TMPDIR to a folder"), "{}", done.stderr());
}
