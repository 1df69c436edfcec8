//! Output on a terminal, which `script` of util-linux provides.

use std::fs::File;
use std::process::{Command, Stdio};

use crate::support::program::{Scratch, sheet, skipped_outside_ci};

const SCENE: &str = r#"{
  "spp": 16,
  "camera": { "type": "pinhole", "width": 600, "height": 400, "fov": 40,
              "position": [0, 1, 4], "target": [0, 0, 0], "up": [0, 1, 0] },
  "scene": {
    "accelerator": "bvh",
    "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
    "shapes": [{ "type": "trimesh", "path": "sheet.ply", "material": {} }]
  }
}"#;

/// Whether a terminal can be opened. A simple `chroot` has none.
fn has_terminals() -> bool {
    let opened = File::open("/dev/ptmx");
    if let Err(error) = &opened {
        skipped_outside_ci(&format!("the tests of terminals: /dev/ptmx: {error}"));
    }
    opened.is_ok()
}

/// Returns everything that a command writes to a terminal, and its exit code.
fn on_terminal(scratch: &Scratch, args: &str, environment: &[(&str, &str)]) -> (String, i32) {
    let line = format!("stty cols 100 rows 40; '{}' {args}", env!("CARGO_BIN_EXE_lightpath"));
    let mut command = Command::new("script");
    command.args(["-qefc", &line, "/dev/null"]).current_dir(scratch.path(""));
    command.env("TERM", "xterm-256color");
    // If CI is set, even a dumb terminal gets colours.
    for name in ["CI", "NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE"] {
        command.env_remove(name);
    }
    command.envs(environment.iter().copied());
    let output = command.stdin(Stdio::null()).output().expect("script is a part of util-linux");
    // `-e`: the exit code is that of the command.
    (String::from_utf8(output.stdout).unwrap(), output.status.code().unwrap())
}

/// Returns the lines that remain on the screen, without colours.
fn screen(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    let (mut row, mut column) = (0usize, 0usize);
    let mut rest = text.chars();
    while let Some(c) = rest.next() {
        match c {
            '\r' => column = 0,
            '\n' => {
                row += 1;
                lines.resize(lines.len().max(row + 1), String::new());
            }
            '\u{1b}' => {
                assert_eq!(rest.next(), Some('['), "{text:?}");
                let mut number = String::new();
                let command = rest.by_ref().find(|c| {
                    number.push(*c);
                    c.is_ascii_alphabetic()
                });
                number.pop();
                match command {
                    Some('K') if number == "2" => lines[row].clear(),
                    Some('K') => lines[row] = lines[row].chars().take(column).collect(),
                    Some('A') => row = row.saturating_sub(number.parse().unwrap_or(1)),
                    Some('B') => row += number.parse().unwrap_or(1),
                    Some('m' | 'h' | 'l') => {}
                    other => panic!("{other:?} in {text:?}"),
                }
            }
            c => {
                let line = &mut lines[row];
                let mut characters: Vec<char> = line.chars().collect();
                characters.resize(characters.len().max(column + 1), ' ');
                characters[column] = c;
                *line = characters.into_iter().collect();
                column += 1;
            }
        }
    }
    lines.into_iter().map(|line| line.trim_end().to_string()).collect()
}

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("sheet.ply"), sheet(300)).unwrap();
    scratch.write("s.json", SCENE);
    scratch
}

/// The bar leaves nothing behind: neither its own lines nor text in front of the next message.
#[test]
fn the_bar_is_gone_before_anything_else_is_printed() {
    if !has_terminals() {
        return;
    }
    let scratch = scratch();
    std::fs::create_dir(scratch.path("scans")).unwrap();
    std::fs::copy(scratch.path("sheet.ply"), scratch.path("scans/sheet.ply")).unwrap();
    let part = "render s.json --quiet --samples";
    for (name, samples) in [("p", "0..8"), ("q", "8..16")] {
        let (text, code) =
            on_terminal(&scratch, &format!("{part} {samples} --of 16 -o {name}"), &[]);
        assert_eq!(code, 0, "{text}");
    }
    let commands = [
        ("render s.json -o out --size 1200x800 --spp 8 --threads 2", "out.exr", "render"),
        ("merge p.exr q.exr -o merged", "merged.exr", ""),
        ("crosscheck s.json --backend bvh,brute --size 60x40", "the tree of bvh is valid", "check"),
        ("batch scans -o many --turntable 2 --backend bvh --spp 4", "many/index.html", "frames"),
    ];
    for (command, last, bar) in commands {
        let (text, code) = on_terminal(&scratch, command, &[]);
        assert_eq!(code, 0, "{command}: {text}");
        let lines = screen(&text);
        for phase in ["load", "build", "render", "write", "check", "frames"] {
            let left = lines.iter().find(|line| line.starts_with(phase) && line.contains('%'));
            assert_eq!(left, None, "{command}: {lines:#?}\n{text:?}");
        }
        assert!(lines.iter().any(|line| line.starts_with(last)), "{command}: {lines:#?}");
        // A merge is too short for a bar.
        assert!(bar.is_empty() || (text.contains(bar) && text.contains('%')), "{text:?}");
    }
}

/// Our errors and warnings start like clap's and follow the same rules for colours.
#[test]
fn errors_are_coloured_like_usage_errors() {
    if !has_terminals() {
        return;
    }
    let scratch = scratch();
    let first = |args: &str, environment: &[(&str, &str)]| {
        let (text, _) = on_terminal(&scratch, args, environment);
        let (start, _) = text.split_once(" ").expect(&text);
        start.to_string()
    };
    let environments: [&[(&str, &str)]; 5] = [
        &[],
        &[("NO_COLOR", "1")],
        &[("TERM", "dumb")],
        &[("CLICOLOR", "0")],
        &[("NO_COLOR", "1"), ("CLICOLOR_FORCE", "1")],
    ];
    let starts = environments.map(|environment| {
        let usage = first("render --no-such-flag", environment);
        assert_eq!(first("render missing.json", environment), usage, "{environment:?}");
        usage
    });
    assert!(starts[0].contains('\u{1b}') && starts[0].contains("error:"), "{starts:?}");
    assert_eq!(starts[1..4], ["error:"; 3]);
    // No colours in files and pipes.
    assert!(scratch.run(&["render", "missing.json"]).stderr().starts_with("error: "));
    // A name cannot add colours.
    let (text, _) = on_terminal(&scratch, "render $'\\e[31mx.json'", &[("NO_COLOR", "1")]);
    assert!(!text.contains('\u{1b}'), "{text:?}");
}
