//! Every page that the program writes, in a browser: narrow and wide, light and dark.

use crate::support::browser::{browse, look};
use crate::support::program::{PYRAMID, Scratch};

const SCENE: &str = r#"{
  "spp": 4, "nbounces": 1,
  "camera": { "type": "pinhole", "width": 32, "height": 24, "fov": 40,
              "position": [0, 1, 5], "target": [0, 0.5, 0], "up": [0, 1, 0] },
  "scene": {
    "accelerator": "bvh",
    "lightsources": [{ "type": "pointlight", "position": [3, 5, 4], "id": [40, 40, 40], "group": "key" }],
    "shapes": [
      { "type": "trimesh", "path": "pyramid.ply", "name": "a <pyramid>", "material": {} },
      { "type": "sphere", "center": [1, 0.5, 1], "radius": 0.5, "name": "ball", "material": {} }]
  }
}"#;

/// Makes a folder with two pictures and a page that compares them.
fn comparison() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("pyramid.ply", PYRAMID);
    scratch.write("s.json", SCENE);
    let ball = "/scene/shapes/1/center=[0.8,0.5,1]";
    scratch.run(&["render", "s.json", "--aov", "all", "-o", "a"]).good();
    scratch.run(&["render", "s.json", "--aov", "all", "-o", "b", "--set", ball]).good();
    scratch.run(&["compare", "a.exr", "b.exr", "--html", "compare.html"]).good();
    scratch
}

/// Makes a folder with one page of each kind.
fn pages() -> Scratch {
    let scratch = comparison();
    scratch.write("scans/tall.ply", &PYRAMID.replace("0 2 0", "0 5 0"));
    scratch
        .write("scans/a long name that does not fit into a line of a narrow window.ply", "ply\n");
    let runs: [(&[&str], i32); 4] = [
        (&["bench", "s.json", "--quick", "--backend", "bvh,coursework", "--html", "bench.html"], 0),
        (&["accuracy", "--backend", "bvh", "--case", "icosphere", "--html", "accuracy.html"], 0),
        (&["converge", "s.json", "--budget", "3", "--html", "converge.html"], 0),
        (
            &[
                "batch",
                "scans",
                "-o",
                "out",
                "--turntable",
                "3",
                "--size",
                "48x32",
                "--backend",
                "bvh",
            ],
            1,
        ),
    ];
    for (args, code) in runs {
        let done = scratch.run(args);
        assert_eq!(done.code(), code, "{args:?}: {}", done.stderr());
    }
    scratch
}

const PAGES: [&str; 5] =
    ["compare.html", "bench.html", "accuracy.html", "converge.html", "out/index.html"];

#[test]
fn every_page_is_readable_on_a_telephone_and_in_the_dark() {
    let scratch = pages();
    // What depends on the width does not depend on the colours.
    for (width, dark) in [(400, true), (1280, false)] {
        // The narrow pages have all details open.
        let Some(all) = look(&scratch.path(""), &PAGES, width, dark, width == 400) else { return };
        for (page, seen) in PAGES.into_iter().zip(all) {
            let case = format!("{page}, {width} pixels, dark: {dark}: {seen:?}");
            assert!(seen.errors.is_empty(), "{case}");
            assert!(seen.width <= width, "{case}");
            assert!(seen.sections > 0, "{case}");
            assert!(seen.chart_text >= 11.0 || page == "out/index.html", "{case}");
            assert!(if dark { seen.background < 0.1 } else { seen.background > 0.8 }, "{case}");
            // WCAG 2.2 requires 4.5.
            assert!(seen.contrast >= 4.5, "{case}");
        }
    }
    if let Some(folder) = std::env::var_os("LIGHTPATH_KEEP_PAGES") {
        for page in PAGES {
            let name = page.replace('/', "-");
            std::fs::copy(scratch.path(page), std::path::Path::new(&folder).join(name)).unwrap();
        }
    }
}

/// Compares two pictures with all 24 layers. Mattes are listed by name instead of by rank.
#[test]
fn a_comparison_is_short_and_names_mattes() {
    let scratch = comparison();
    let html = String::from_utf8(scratch.read("compare.html")).unwrap();
    assert_eq!(html.matches("<h2>Crypto").count(), 2);
    assert!(
        html.contains("<td>a &lt;pyramid&gt;</td>") && html.contains("<td>ball</td>"),
        "{html}"
    );
    let Some(seen) = look(&scratch.path(""), &["compare.html"], 1280, false, false) else { return };
    let seen = &seen[0];
    assert!(seen.sections > 20 && seen.height < 300 * seen.sections, "{seen:?}");
}

/// The links of a card lead to the displayed frame.
#[test]
fn cards_lead_to_their_frames() {
    let scratch = Scratch::new();
    scratch.write("scans/a #1%.ply", PYRAMID);
    let args = ["batch", "scans", "-o", "out", "--turntable", "3", "--size", "48x32", "--quiet"];
    let done = scratch.run(&[&args[..], &["--backend", "bvh"]].concat());
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let html = String::from_utf8(scratch.read("out/index.html")).unwrap();
    let acts = "<script>
      const links = () => [...document.querySelectorAll('article a')].map((a) => decodeURI(a.getAttribute('href')));
      const said = [links().join(',')];
      const slider = document.querySelector('input[type=range]');
      slider.value = 2; slider.dispatchEvent(new Event('input'));
      said.push(links().join(','));
      document.body.dataset.said = said.join(' | ');
    </script></body>";
    scratch.write("out/acted.html", &html.replace("</body>", acts));
    let first = html.split("href=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    assert_eq!(first, "a%20%231%25/a%20%231%25.0000.png");
    let Some(dom) = browse(&["--dump-dom"], &scratch.path("out/acted.html")) else { return };
    let said = dom.split("data-said=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    let [before, after] = ["0000", "0002"].map(|frame| {
        // decodeURI keeps `#` encoded.
        let name = format!("a %231%/a %231%.{frame}");
        format!("{name}.png,{name}.png,{name}.exr")
    });
    assert_eq!(said, format!("{before} | {after}"));
}
