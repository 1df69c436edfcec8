//! Runs the program in a scratch folder.

use std::{
    collections::BTreeMap,
    fs,
    io::Cursor,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    time::Duration,
};

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read_all_flat_layers_from_file};

/// A pyramid on a square, apex at y = 2; one quad and four triangles.
pub const PYRAMID: &str = "ply
format ascii 1.0
element vertex 5
property float x
property float y
property float z
element face 5
property list uchar int vertex_indices
end_header
-1 0 -1
1 0 -1
1 0 1
-1 0 1
0 2 0
4 0 1 2 3
3 0 1 4
3 1 2 4
3 2 3 4
3 3 0 4
";

/// A cloud of one point.
pub const POINT: &str = "ply
format ascii 1.0
element vertex 1
property float x
property float y
property float z
end_header
0 0.5 0
";

/// Flags for small pictures and few threads.
pub const SMALL: [&str; 4] = ["--size", "24x16", "--threads", "2"];

/// A rippled sheet of `2 side^2` triangles, in binary PLY.
pub fn sheet(side: u32) -> Vec<u8> {
    sheet_in_order(side, |triangle| triangle)
}

/// Like [`sheet`], but no triangle lies near the one before it in the file. Trees over such a mesh
/// need the most memory. `side` must not be a multiple of 7919.
pub fn shuffled_sheet(side: u32) -> Vec<u8> {
    sheet_in_order(side, |triangle| {
        (u64::from(triangle) * 7919 % u64::from(2 * side * side)) as u32
    })
}

fn sheet_in_order(side: u32, order: impl Fn(u32) -> u32) -> Vec<u8> {
    let (vertices, triangles) = ((side + 1) * (side + 1), 2 * side * side);
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\n\
         property float y\nproperty float z\nelement face {triangles}\n\
         property list uchar uint vertex_indices\nend_header\n"
    )
    .into_bytes();
    for i in 0..vertices {
        let [x, z] = [i % (side + 1), i / (side + 1)].map(|k| k as f32 / side as f32 * 2.0 - 1.0);
        let y = 0.1 * (9.0 * x + 5.0 * z).sin() * (31.0 * z * x).cos();
        // Slices, because iterators over bytes are slow in a test, which is not optimised.
        [x, y, z].iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
    }
    for triangle in (0..triangles).map(order) {
        let cell = triangle / 2;
        let a = cell / side * (side + 1) + cell % side;
        let (b, c, d) = (a + 1, a + side + 1, a + side + 2);
        let corners = if triangle % 2 == 0 { [a, c, b] } else { [b, c, d] };
        bytes.push(3);
        corners.iter().for_each(|corner| bytes.extend_from_slice(&corner.to_le_bytes()));
    }
    bytes
}

/// Result of a run of the program.
pub struct Done(Output);

impl From<Output> for Done {
    fn from(output: Output) -> Self {
        Self(output)
    }
}

impl Done {
    /// Runs a command without input.
    pub fn of(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::null()).output().unwrap())
    }

    /// Returns the same result with another stderr.
    pub fn saying(&self, stderr: String) -> Self {
        Self(Output { stderr: stderr.into_bytes(), ..self.0.clone() })
    }

    pub fn code(&self) -> i32 {
        self.0.status.code().unwrap_or(-1)
    }

    pub fn stdout(&self) -> String {
        String::from_utf8(self.0.stdout.clone()).unwrap()
    }

    pub fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.0.stderr).into_owned()
    }

    /// Returns itself; panics unless the run succeeded.
    #[track_caller]
    pub fn good(self) -> Self {
        assert_eq!(self.code(), 0, "{}", self.stderr());
        self
    }
}

/// Runs the program in the working folder of the test.
pub fn lightpath(args: &[&str]) -> Done {
    Done(command(args).output().unwrap())
}

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightpath"));
    command.args(args).env_remove("SLURM_CPUS_PER_TASK");
    command
}

/// Returns a command that runs `command` with the default actions of signals. The shell that
/// started the tests may ignore some of them, as for a job in the background or of `nohup`.
pub fn interruptible(command: &Command) -> Command {
    let mut env = Command::new("env");
    env.arg("--default-signal=HUP,INT,QUIT").arg(command.get_program()).args(command.get_args());
    env.current_dir(command.get_current_dir().unwrap());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => env.env(name, value),
            None => env.env_remove(name),
        };
    }
    env
}

/// Sends a signal to a process.
#[track_caller]
pub fn send(signal: &str, process: u32) {
    // Uses the shell's `kill`, because a small system may have no such program.
    let kill = format!("kill -s {signal} {process}");
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

/// Tells that a test is skipped, past the test harness, which hides the output of passing tests.
pub fn skipped(why: &str) {
    let print = "printf '\\n*** SKIPPED: %s ***\\n' \"$0\" >&2";
    let _ = Command::new("sh").args(["-c", print, why.trim()]).status();
}

/// Like [`skipped`], for what is there in CI: with `LIGHTPATH_NO_SKIPS`, which CI sets, this is a
/// failure.
#[track_caller]
pub fn skipped_outside_ci(why: &str) {
    assert!(std::env::var_os("LIGHTPATH_NO_SKIPS").is_none(), "{why}");
    skipped(why);
}

/// A process that is killed when the test ends.
pub struct Running(pub Child);

impl Running {
    /// Waits until something holds; panics if the process ends before.
    #[track_caller]
    pub fn until(&mut self, holds: impl Fn() -> bool) {
        while !holds() {
            let ended = self.0.try_wait().unwrap();
            assert_eq!(ended, None, "it ended too soon");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A folder that is removed when dropped.
pub struct Scratch(tempfile::TempDir);

impl Scratch {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Makes a folder with `s.json` and [`PYRAMID`] as `p.ply`.
    pub fn with(scene: &str) -> Self {
        let scratch = Self::new();
        scratch.write("s.json", scene);
        scratch.write("p.ply", PYRAMID);
        scratch
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        fs::write(self.path(name), text).unwrap();
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Returns R, G, B, A of an EXR, row by row.
    pub fn rgba(&self, name: &str) -> Vec<Vec<[f32; 4]>> {
        exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .rgba_channels(
                |size, _| vec![vec![[0.0; 4]; size.width()]; size.height()],
                |pixels: &mut Vec<Vec<_>>, at, (r, g, b, a): (f32, f32, f32, f32)| {
                    pixels[at.y()][at.x()] = [r, g, b, a];
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(self.read(name)))
            .unwrap()
            .layer_data
            .channel_data
            .pixels
    }

    /// Returns every channel of every part of an EXR by name, as numbers.
    pub fn floats(&self, name: &str) -> BTreeMap<String, Vec<f32>> {
        let image = read_all_flat_layers_from_file(self.path(name)).unwrap();
        let channels = image.layer_data.into_iter().flat_map(|layer| layer.channel_data.list);
        channels.map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
    }

    /// Returns every channel of every part of an EXR by name, with the bits of its samples.
    pub fn channels(&self, name: &str) -> Vec<(String, Vec<u32>)> {
        let image = read_all_flat_layers_from_file(self.path(name)).unwrap();
        let bits = |samples: &FlatSamples| match samples {
            FlatSamples::F16(halves) => halves.iter().map(|x| x.to_bits().into()).collect(),
            FlatSamples::F32(floats) => floats.iter().map(|x| x.to_bits()).collect(),
            FlatSamples::U32(words) => words.clone(),
        };
        let channels = image.layer_data.iter().flat_map(|layer| &layer.channel_data.list);
        channels.map(|c| (c.name.to_string(), bits(&c.sample_data))).collect()
    }

    /// Makes a named pipe and returns its path.
    #[track_caller]
    pub fn pipe(&self, name: &str) -> PathBuf {
        let path = self.path(name);
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        path
    }

    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = command(args);
        command.current_dir(self.0.path());
        command
    }

    pub fn run(&self, args: &[&str]) -> Done {
        Done::of(&mut self.command(args))
    }

    pub fn run_with_stdin(&self, args: &[&str], text: &str) -> Done {
        use std::io::Write;
        let mut command = self.command(args);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        Done(child.wait_with_output().unwrap())
    }

    /// Returns the names in the folder, sorted.
    pub fn names(&self) -> Vec<String> {
        names_in(self.0.path())
    }
}

pub fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// A table of docs/notebook/bad-input.md, with the program's real messages.
pub struct Table {
    section: &'static str,
    found: Vec<String>,
}

impl Table {
    /// Selects the table under the heading `## section`.
    pub fn new(section: &'static str) -> Self {
        Self { section, found: Vec::new() }
    }

    /// Adds a refusal: requires an empty stdout and no panic, and keeps the first line for the
    /// table.
    #[track_caller]
    pub fn add(&mut self, what: &str, done: &Done) {
        let (stderr, stdout) = (done.stderr(), done.stdout());
        assert_eq!(stdout, "", "{what}");
        assert!(!stderr.contains("panicked") && !stderr.contains("RUST_BACKTRACE"), "{stderr}");
        let said = stderr.lines().find_map(|line| line.strip_prefix("error: "));
        let said = said.unwrap_or_else(|| panic!("{what}: exit {}: {stderr}", done.code()));
        // Escaped for a Markdown table.
        let said = said.replace('`', "'").replace('|', "\\|");
        self.found.push(format!("| {what} | `{said}` | {} |", done.code()));
    }

    /// Asserts that the documentation has the same table.
    #[track_caller]
    pub fn check(self) {
        let heading = format!("\n## {}\n", self.section);
        let docs = include_str!("../../docs/notebook/bad-input.md");
        let text = docs.split(&heading).nth(1).unwrap_or_default();
        let section = text.split("\n## ").next().unwrap_or_default();
        let rows: Vec<&str> = section.lines().filter(|line| line.starts_with("| ")).collect();
        let rows = rows.get(1..).unwrap_or_default();
        assert_eq!(rows, self.found, "expected:{heading}{}", self.found.join("\n"));
    }
}

/// A scratch folder with an output folder, for runs that must leave no file.
pub struct Refusals {
    pub scratch: Scratch,
}

impl Refusals {
    /// Address space of a run in KiB: far more than a refusal needs, far less than a lying file
    /// requests.
    const ADDRESS_SPACE: u64 = 2 << 20;

    pub fn new() -> Self {
        let scratch = Scratch::new();
        fs::create_dir(scratch.path("out")).unwrap();
        Self { scratch }
    }

    /// Returns a command for the program with little address space.
    pub fn command(&self, args: &[&str]) -> Command {
        let limited = format!("ulimit -v {}; exec \"$0\" \"$@\"", Self::ADDRESS_SPACE);
        let mut command = Command::new("sh");
        command.args(["-c", &limited, env!("CARGO_BIN_EXE_lightpath")]).args(args);
        command.current_dir(self.scratch.path("")).env_remove("SLURM_CPUS_PER_TASK");
        command
    }

    /// Runs the program and checks that the output folder is empty.
    #[track_caller]
    pub fn run(&self, args: &[&str]) -> Done {
        self.of(&mut self.command(args))
    }

    /// Runs a command and checks that the output folder is empty.
    #[track_caller]
    pub fn of(&self, command: &mut Command) -> Done {
        let done = Done::of(command);
        let left = names_in(&self.scratch.path("out"));
        assert!(left.is_empty(), "{command:?} left {left:?}: {}", done.stderr());
        done
    }

    /// Renders a file to `out/x`.
    #[track_caller]
    pub fn render(&self, file: &str, flags: &[&str]) -> Done {
        self.run(&[&["render", file, "-o", "out/x", "--threads", "2"], flags].concat())
    }

    /// Writes a file that neither `render` nor `info` accepts, and checks that both give the same
    /// message.
    #[track_caller]
    pub fn file(&self, name: &str, bytes: &[u8]) -> Done {
        fs::write(self.scratch.path(name), bytes).unwrap();
        let (render, info) = (self.render(name, &[]), self.run(&["info", name]));
        assert_eq!((render.stderr(), render.code()), (info.stderr(), info.code()));
        render
    }
}
