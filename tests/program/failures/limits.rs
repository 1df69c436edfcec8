//! With little memory and few threads, a run ends normally or with exit code 3 (2 if the user set
//! the limit or the file lies), never by an abort or a panic. One bad input of a batch fails alone.

use std::{fs, process::Command};

use crate::support::program::{Done, PYRAMID, SMALL, Scratch, names_in, sheet, skipped};
use exr::prelude::*;

/// Runs the program under a limit in the form of the shell's `ulimit`: `-v KIB`, `-u PROCESSES`.
fn limited(scratch: &Scratch, limit: &str, args: &[&str]) -> Done {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit {limit} && exec \"$0\" \"$@\"")]);
    command.arg(env!("CARGO_BIN_EXE_lightpath")).args(args).args(SMALL);
    command.current_dir(scratch.path("")).env_remove("SLURM_CPUS_PER_TASK");
    // A panic for lack of memory waited without end while it printed a backtrace.
    command.env("RUST_BACKTRACE", "1");
    Done::of(&mut command)
}

/// Checks that a run succeeded or gave a reason, and returns its exit code.
#[track_caller]
fn ended(done: &Done, allowed: &[i32], what: &str) -> i32 {
    let (code, said) = (done.code(), done.stderr());
    assert!(allowed.contains(&code), "{what}: exit {code}: {said}");
    assert!(!said.contains("panicked"), "{what}: {said}");
    assert!(code == 0 || !said.is_empty(), "{what}: nothing said");
    code
}

/// A PLY header of `vertices` vertices and one face.
fn header(vertices: u64, count: &str) -> String {
    format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\n\
         property float y\nproperty float z\nelement face 1\n\
         property list {count} uint vertex_indices\nend_header\n"
    )
}

/// A zstd frame with a PLY header and as many zeros as the header needs. Each block of some 4 bytes
/// expands to 128 KiB of zeros.
fn bomb(vertices: u64) -> Vec<u8> {
    zeros(header(vertices, "uchar").as_bytes(), 12 * vertices)
}

/// A zstd frame of `start`, followed by at least `zeros` zeros.
fn zeros(start: &[u8], zeros: u64) -> Vec<u8> {
    let block = |kind: u32, last: bool, size: usize| {
        ((size as u32) << 3 | kind << 1 | u32::from(last)).to_le_bytes()[..3].to_vec()
    };
    // Magic number, no checksum, a window of 1 MiB.
    let mut bytes = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 0x50];
    bytes.extend(block(0, false, start.len()));
    bytes.extend(start);
    for _ in 0..zeros.div_ceil(1 << 17) {
        bytes.extend(block(1, false, 1 << 17));
        bytes.push(0);
    }
    bytes.extend(block(1, true, 13));
    bytes.push(0);
    bytes
}

/// The threads of Embree's library spin without end if they lack memory, so they are not started.
/// A process that spins is killed.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn a_batch_with_embree_ends_at_any_limit() {
    let scratch = Scratch::new();
    let mut args = vec!["batch", "--backend", "embree", "-o", "out", "--no-sheet", "--jobs", "2"];
    let names = ["a.ply", "b.ply", "c.ply", "d.ply"];
    for name in names {
        scratch.write(name, PYRAMID);
        args.push(name);
    }
    for mib in (60..960).step_by(30) {
        let limits = format!("-t 60 && ulimit -v {}", mib << 10);
        let done = limited(&scratch, &limits, &args);
        ended(&done, &[0, 3], &format!("{mib} MiB"));
        let _ = fs::remove_dir_all(scratch.path("out"));
    }
}

/// Embree's cache of tessellated surfaces, 128 MiB of addresses, is not made. Where there was no
/// room for it, Embree kept a spin lock, and the next device waited without end.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn embree_needs_no_addresses_for_tessellation() {
    let scratch = Scratch::new();
    scratch.write("m.ply", PYRAMID);
    let run = "ulimit -v 450000 && exec \"$0\" render m.ply -o x --size 24x16 --backend embree \
        --threads 1";
    let mut command = Command::new("sh");
    command.args(["-c", run, env!("CARGO_BIN_EXE_lightpath")]).current_dir(scratch.path(""));
    ended(&Done::of(&mut command), &[0], "one thread");
}

/// Embree starts no more threads than there are processors: one here. Others need no room there.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn many_threads_on_one_processor_leave_room_for_embree() {
    let scratch = Scratch::new();
    scratch.write("m.ply", PYRAMID);
    let run = "ulimit -v 4096000 && exec taskset -c \"$1\" \"$0\" render m.ply -o x --size 16x16 \
        --backend embree --threads 256";
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux");
    let allowed = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
    let allowed = allowed.expect("a list such as 0-3,8").trim();
    let first = allowed.split(['-', ',']).next().expect("a processor");
    let mut command = Command::new("sh");
    command.args(["-c", run, env!("CARGO_BIN_EXE_lightpath"), first]);
    command.current_dir(scratch.path(""));
    let done = Done::of(&mut command);
    ended(&done, &[0], "256 threads");
}

/// A mesh that is too large at most of these limits, among others that are not. At the least of
/// them, threads hardly start.
#[test]
fn a_batch_at_any_limit_of_address_space() {
    let scratch = Scratch::new();
    fs::write(scratch.path("m.ply"), sheet(500)).unwrap();
    scratch.write("a.ply", PYRAMID);
    scratch.write("z.ply", PYRAMID);
    let mut alone = 0;
    for mib in (26..30).chain((30..=190).step_by(40)) {
        let args = ["batch", "a.ply", "m.ply", "z.ply", "-o", "out", "--no-sheet", "--jobs", "2"];
        let done = limited(&scratch, &format!("-v {}", mib << 10), &args);
        let code = ended(&done, &[0, 3], &format!("{mib} MiB"));
        let others = ["out/a.exr", "out/z.exr"].iter().all(|name| scratch.path(name).exists());
        let is_alone = done.stderr().contains("1 of 3 inputs failed");
        if code == 0 || is_alone {
            assert!(others, "{mib} MiB: {}", done.stderr());
        }
        alone += u32::from(is_alone);
        let _ = fs::remove_dir_all(scratch.path("out"));
    }
    assert!(alone > 0, "the large mesh never failed alone");
}

/// The allocator's arenas reserve 64 MiB for each thread: at some of these limits they left too
/// little, or every allocation tried to reserve one more.
#[test]
fn more_addresses_never_hurt() {
    let scratch = Scratch::new();
    let names: Vec<String> = (0..12).map(|i| format!("i{i:02}.ply")).collect();
    names.iter().for_each(|name| scratch.write(name, PYRAMID));
    let mut args = vec!["batch", "-o", "out", "--no-sheet", "--quiet", "--jobs", "2"];
    args.extend(names.iter().map(String::as_str));
    for mib in [120, 160, 180, 228, 244, 310] {
        let done = limited(&scratch, &format!("-v {}", mib << 10), &args);
        ended(&done, &[0], &format!("{mib} MiB"));
        fs::remove_dir_all(scratch.path("out")).unwrap();
    }
}

/// Limits from one at which nothing works to one at which everything works.
#[test]
fn a_mesh_at_any_limit_of_address_space() {
    let scratch = Scratch::new();
    fs::write(scratch.path("m.ply"), sheet(500)).unwrap();
    let mut codes = Vec::new();
    for mib in (24..=240).step_by(18) {
        let args = ["render", "m.ply", "-o", "x", "--quiet"];
        let done = limited(&scratch, &format!("-v {}", mib << 10), &args);
        codes.push(ended(&done, &[0, 3], &format!("{mib} MiB")));
        let left = scratch.names();
        assert!(!left.iter().any(|name| name.ends_with(".part")), "{mib} MiB: {left:?}");
    }
    assert_eq!((codes[0], codes[codes.len() - 1]), (3, 0), "{codes:?}");
}

#[test]
fn a_packed_file_larger_than_memory_is_refused() {
    let scratch = Scratch::new();
    fs::write(scratch.path("scans.ply.zst"), bomb(700_000_000)).unwrap();
    assert!(fs::metadata(scratch.path("scans.ply.zst")).unwrap().len() < 400_000);
    let render = ["render", "scans.ply.zst", "-o", "x"];
    let done = limited(&scratch, "-v 2000000", &render);
    ended(&done, &[3], "2 GB of address space");
    let done = limited(&scratch, "-v 8000000", &[&render[..], &["--max-memory", "200M"]].concat());
    ended(&done, &[2], "--max-memory");
    assert!(done.stderr().contains("--max-memory"), "{}", done.stderr());
    // The other inputs are rendered.
    scratch.write("a.ply", PYRAMID);
    scratch.write("z.ply", PYRAMID);
    for more in [&[][..], &["--max-memory", "400M"]] {
        let args = ["batch", "a.ply", "scans.ply.zst", "z.ply", "-o", "out", "--no-sheet"];
        let done = limited(&scratch, "-v 3000000", &[&args[..], more].concat());
        ended(&done, &[if more.is_empty() { 3 } else { 1 }], "batch");
        let names = names_in(&scratch.path("out"));
        assert_eq!(names, ["a.exr", "a.png", "batch.jsonl", "z.exr", "z.png"], "{}", done.stderr());
        fs::remove_dir_all(scratch.path("out")).unwrap();
    }
}

/// A small file with one polygon of so many corners that its triangles do not fit.
#[test]
fn a_polygon_larger_than_memory_costs_only_itself() {
    let scratch = Scratch::new();
    let corners = 60_000_000u32;
    let start = [header(3, "uint").as_bytes(), &[0; 36], &corners.to_le_bytes()].concat();
    let bytes = zeros(&start, 4 * u64::from(corners));
    assert!(bytes.len() < 10_000);
    fs::write(scratch.path("p.ply.zst"), bytes).unwrap();
    scratch.write("a.ply", PYRAMID);
    scratch.write("z.ply", PYRAMID);
    for (limit, more, code) in
        [("-v 1200000", &[][..], 3), ("-v unlimited", &["--max-memory", "900M"], 1)]
    {
        let args = ["batch", "a.ply", "p.ply.zst", "z.ply", "-o", "out", "--no-sheet"];
        let done = limited(&scratch, limit, &[&args[..], more].concat());
        ended(&done, &[code], limit);
        let said = done.stderr();
        assert!(said.contains("1 of 3 inputs failed") && said.contains("p.ply.zst: "), "{said}");
        assert!(!said.contains("memory allocation of"), "{said}");
        let names = names_in(&scratch.path("out"));
        assert_eq!(names, ["a.exr", "a.png", "batch.jsonl", "z.exr", "z.png"], "{said}");
        fs::remove_dir_all(scratch.path("out")).unwrap();
    }
}

/// Files that cannot be mapped, compressed or not, keep to the limit as mapped files do.
#[test]
fn streams_keep_to_the_limit() {
    let scratch = Scratch::new();
    let mesh = sheet(600);
    fs::write(scratch.path("m.ply"), &mesh).unwrap();
    fs::write(scratch.path("m.ply.zst"), zstd::encode_all(&mesh[..], 1).unwrap()).unwrap();
    for (name, flag) in [("m.ply", "--quiet"), ("m.ply", "--no-mmap"), ("m.ply.zst", "--quiet")] {
        let render = |memory: &str| {
            let args = ["render", name, flag, "-o", "x", "--json", "--max-memory", memory];
            limited(&scratch, "-v unlimited", &args)
        };
        ended(&render("38M"), &[2], name);
        let done = render("180M");
        ended(&done, &[0], name);
        let stats: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
        let peak = stats["memory"]["peak_bytes"].as_u64().unwrap();
        assert!(peak < 180 << 20, "{name} {flag}: {peak}");
    }
}

/// An EXR of 2 x 2 pixels within a frame of any size.
fn small_in(scratch: &Scratch, name: &str, size: (usize, usize)) {
    let pixels = SpecificChannels::rgb(|at: Vec2<usize>| (at.x() as f32, at.y() as f32, 0.5));
    let attributes = LayerAttributes { layer_position: Vec2(1, 2), ..LayerAttributes::default() };
    let layer = Layer::new((2, 2), attributes, Encoding::SMALL_LOSSLESS, pixels);
    let window = IntegerBounds::new((0, 0), size);
    let image = Image::from_layer(layer);
    let image = Image { attributes: ImageAttributes::new(window), ..image };
    image.write().to_file(scratch.path(name)).unwrap();
}

#[test]
fn textures_are_sized_by_their_pixels() {
    let scratch = Scratch::new();
    let spheres = (0..6).map(|i| {
        small_in(&scratch, &format!("t{i}.exr"), (11_000, 11_000));
        assert!(fs::metadata(scratch.path(&format!("t{i}.exr"))).unwrap().len() < 1000);
        format!(
            r#"{{ "type": "sphere", "center": [{i}, 0, 0], "radius": 0.4,
                  "material": {{ "tPath": "t{i}.exr", "filter": "{}" }} }}"#,
            if i % 2 == 0 { "bilinear" } else { "trilinear" }
        )
    });
    let spheres = spheres.collect::<Vec<_>>().join(",");
    let scene = format!(
        r#"{{ "camera": {{ "type": "pinhole", "width": 24, "height": 16, "fov": 40,
                          "position": [0, 1, 9], "lookat": [0, 0, -1], "up": [0, 1, 0] }},
             "scene": {{ "lightsources": [], "shapes": [{spheres}] }} }}"#
    );
    scratch.write("s.json", &scene);
    for more in [&[][..], &["--max-memory", "100M"]] {
        let args = [&["render", "s.json", "-o", "x"], more].concat();
        let done = limited(&scratch, "-v 600000", &args);
        ended(&done, &[0], "six small textures");
    }
}

/// Runs as a user other than root, whose processes are counted.
fn with_processes(scratch: &Scratch, count: u32, args: &[&str]) -> Option<Done> {
    let mut command = Command::new("setpriv");
    command.args(["--reuid", "64321", "--clear-groups", "--inh-caps=-all", "prlimit"]);
    command.arg(format!("--nproc={count}"));
    command.arg(env!("CARGO_BIN_EXE_lightpath")).args(args);
    command.current_dir(scratch.path("")).env_remove("SLURM_CPUS_PER_TASK");
    let done = command.stdin(std::process::Stdio::null()).output().ok().map(Done::from)?;
    let said = done.stderr();
    if ["setpriv", "prlimit"].iter().any(|name| said.contains(name)) {
        skipped(&said);
        return None;
    }
    Some(done)
}

#[test]
fn few_threads_cause_no_panic() {
    use std::os::unix::fs::PermissionsExt;
    let scratch = Scratch::new();
    fs::set_permissions(scratch.path(""), fs::Permissions::from_mode(0o777)).unwrap();
    scratch.write("a.ply", PYRAMID);
    scratch.write("b.ply", PYRAMID);
    fs::write(scratch.path("c.ply.zst"), zstd::encode_all(PYRAMID.as_bytes(), 1).unwrap()).unwrap();
    small_in(&scratch, "t.exr", (2, 2));
    let sized = |args: &[&'static str]| [args, &SMALL].concat();
    let mut commands = vec![
        sized(&["render", "a.ply", "-o", "x"]),
        sized(&["batch", "a.ply", "b.ply", "c.ply.zst", "-o", "out", "--turntable", "3"]),
        sized(&["batch", "a.ply", "-o", "dry", "--turntable", "3", "--dry-run"]),
        vec!["compare", "x.png", "x.png", "--threads", "2"],
        vec!["compare", "t.exr", "t.exr", "--threads", "2"],
        vec!["info", "a.ply", "c.ply.zst", "--backend", "bvh"],
        vec!["crosscheck", "a.ply", "--size", "24x16", "--rays", "1000", "--backends", "bvh,brute"],
        vec!["bench", "a.ply", "--quick", "--backends", "bvh", "--classes", "primary"],
    ];
    // A worker that TBB could not start ended the process.
    if cfg!(lightpath_embree) {
        commands.push(sized(&["render", "a.ply", "-o", "x", "--backend", "embree"]));
    }
    for args in commands {
        let mut codes = Vec::new();
        for count in (1..=8).chain([60]) {
            let Some(done) = with_processes(&scratch, count, &args) else { return };
            codes.push(ended(&done, &[0, 3], &format!("{args:?}, {count} processes")));
        }
        assert_eq!(codes.last(), Some(&0), "{args:?}: {codes:?}");
    }
}

/// `info` reads meshes within the memory of the machine, and tells how much there is.
#[test]
fn info_of_a_scene_larger_than_memory_is_refused() {
    let scratch = Scratch::new();
    scratch.write("m.ply", &header(200_000_000, "uchar"));
    // The vertices are a hole of the file.
    let mesh = fs::File::options().append(true).open(scratch.path("m.ply")).unwrap();
    mesh.set_len(2_500_000_000).unwrap();
    let scene = r#"{ "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 40,
        "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] }, "scene": { "shapes": [
        { "type": "trimesh", "path": "m.ply", "material": {} }] } }"#;
    scratch.write("s.json", scene);
    let limited = "ulimit -v 2000000 && exec \"$0\" info s.json";
    let mut command = Command::new("sh");
    command.args(["-c", limited, env!("CARGO_BIN_EXE_lightpath")]).current_dir(scratch.path(""));
    let done = Done::of(&mut command);
    ended(&done, &[3], "2 GB of address space");
    assert!(done.stderr().contains("needs 2.3 GiB; the machine has"), "{}", done.stderr());
}
