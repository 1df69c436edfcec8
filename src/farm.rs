//! Jobs for a farm: distributes frames over the tasks of an array job, and writes the arguments of
//! `sbatch`. Slurm does all scheduling, retrying and waiting.

/// Distribution of a batch's frames over tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunks {
    /// Number of all frames.
    pub frames: u64,
    /// Frames per task; the last task may have fewer.
    pub per_task: u64,
}

impl Chunks {
    /// Makes tasks that take about `seconds`, if a frame takes `frame_seconds`, and at most `most`
    /// tasks.
    ///
    /// A mesh has `per_mesh` frames. A task takes the frames of whole meshes, or an equal share of
    /// one mesh. So no task reads a mesh for a few leftover frames.
    pub fn new(frames: u64, per_mesh: u64, frame_seconds: f64, seconds: f64, most: u64) -> Self {
        let frames = frames.max(1);
        let per_mesh = per_mesh.clamp(1, frames);
        // The cast saturates: frames that take no time all go into one task.
        let wanted = ((seconds / frame_seconds).round() as u64).clamp(1, frames);
        let needed = frames.div_ceil(most.max(1));
        let divides = |n: &u64| per_mesh % n == 0;
        let per_task = match wanted.max(needed) {
            many if many >= per_mesh => {
                let up = many.div_ceil(per_mesh) * per_mesh;
                let down = many / per_mesh * per_mesh;
                if down >= needed && many - down <= up - many { down } else { up }
            }
            few => {
                let down = (1..=few).rev().find(divides).filter(|n| *n >= needed);
                down.or_else(|| (few..=per_mesh).find(divides)).unwrap_or(per_mesh)
            }
        };
        Self { frames, per_task: per_task.min(frames) }
    }

    /// Returns the number of tasks.
    pub fn tasks(&self) -> u64 {
        self.frames.div_ceil(self.per_task)
    }
}

/// Seconds between the signal that stops a task and its time limit.
pub const SECONDS_TO_END: f64 = 60.0;

/// Parses a time limit as `sbatch` does, in seconds; infinite without a limit. `None` for any other
/// text.
pub fn time_limit(text: &str) -> Option<f64> {
    if ["UNLIMITED", "INFINITE"].iter().any(|word| text.eq_ignore_ascii_case(word)) {
        return Some(f64::INFINITY);
    }
    let number = |text: &str| text.parse::<u32>().ok().map(f64::from);
    let (days, rest) = match text.split_once('-') {
        Some((days, rest)) => (number(days)?, rest),
        None => (0.0, text),
    };
    let parts = rest.split(':').map(number).collect::<Option<Vec<f64>>>()?;
    let [hours, minutes, seconds] = match (text.contains('-'), parts.as_slice()) {
        (true, &[hours]) => [hours, 0.0, 0.0],
        (true, &[hours, minutes]) => [hours, minutes, 0.0],
        (false, &[minutes]) => [0.0, minutes, 0.0],
        (false, &[minutes, seconds]) => [0.0, minutes, seconds],
        (_, &[hours, minutes, seconds]) => [hours, minutes, seconds],
        _ => return None,
    };
    let all = ((24.0 * days + hours) * 60.0 + minutes) * 60.0 + seconds;
    // To Slurm, 0 is no limit.
    Some(if all == 0.0 { f64::INFINITY } else { all })
}

/// Script of a task of the array job. Arguments: program, job, folder, frames, frames per task.
pub const FRAMES_SCRIPT: &str = include_str!("../farm/slurm-frames.sh");
/// Script of the job for the contact sheet. Arguments: program, job, folder.
pub const SHEET_SCRIPT: &str = include_str!("../farm/slurm-sheet.sh");

/// Settings of an array job. Names go to `sbatch` and its scripts as single arguments or quoted
/// words. So no name is read as an option, as an `#SBATCH` line or as a command.
#[derive(Debug, Clone)]
pub struct Slurm {
    /// Name of the job in the queue.
    pub name: String,
    /// Absolute path of the program.
    pub program: String,
    /// Absolute path of the job file.
    pub job: String,
    /// Absolute path of the folder of the frames, which all nodes share.
    pub folder: String,
    /// Distribution of the frames.
    pub chunks: Chunks,
    /// Maximum number of tasks that run at a time.
    pub at_a_time: Option<u32>,
    /// Number of processors per task.
    pub cpus: u16,
    /// Memory per task in MiB.
    pub memory_mib: u64,
    /// Time limit per task, in Slurm's format.
    pub time: Option<String>,
    /// Additional options of `sbatch`, passed on unchanged.
    pub options: Vec<String>,
}

/// A job for `sbatch`.
#[derive(Debug, Clone)]
pub struct Submission {
    /// Options of `sbatch`.
    pub options: Vec<String>,
    script: &'static str,
    arguments: Vec<String>,
}

impl Submission {
    /// Returns the command line that submits a copy of the script at `path`.
    pub fn command(&self, path: &str) -> String {
        let path = path.to_string();
        let words = self.options.iter().chain([&path]).chain(&self.arguments);
        command_line("sbatch", &words.cloned().collect::<Vec<_>>())
    }

    /// Returns the script, for the standard input of `sbatch`. Its arguments are the words of its
    /// second line.
    pub fn text(&self) -> String {
        let (interpreter, rest) = self.script.split_once('\n').unwrap_or((self.script, ""));
        let words: Vec<_> = ["--".to_string()].iter().chain(&self.arguments).cloned().collect();
        format!("{interpreter}\n{}\n{rest}", command_line("set", &words))
    }
}

impl Slurm {
    /// Returns the array job.
    pub fn frames(&self) -> Submission {
        let last = self.chunks.tasks() - 1;
        let percent = self.at_a_time.map_or(String::new(), |n| format!("%{n}"));
        let options = self.options("", "%A_%a", &[format!("--array=0-{last}{percent}")]);
        let mut arguments = self.arguments();
        let Chunks { frames, per_task } = self.chunks;
        arguments.extend([frames, per_task].map(|count| count.to_string()));
        Submission { options, script: FRAMES_SCRIPT, arguments }
    }

    /// Returns the job for the contact sheet. It runs after the array job of id `after` has ended,
    /// whether that succeeded or failed.
    pub fn sheet(&self, after: &str) -> Submission {
        let options = self.options("-sheet", "%j", &[format!("--dependency=afterany:{after}")]);
        Submission { options, script: SHEET_SCRIPT, arguments: self.arguments() }
    }

    fn arguments(&self) -> Vec<String> {
        [&self.program, &self.job, &self.folder].map(String::clone).into()
    }

    fn options(&self, suffix: &str, log: &str, more: &[String]) -> Vec<String> {
        let mut words = vec!["--parsable".to_string(), format!("--job-name={}{suffix}", self.name)];
        words.push("--requeue".to_string());
        words.push(format!("--cpus-per-task={}", self.cpus));
        words.push(format!("--mem={}M", self.memory_mib));
        words.extend(self.time.as_ref().map(|time| format!("--time={time}")));
        // The script gets SIGUSR1 one minute before the time limit. So the program can stop and
        // remove unfinished files.
        words.push("--signal=B:USR1@60".to_string());
        words.push("--open-mode=append".to_string());
        // Slurm replaces a percent sign and the character after it. Two percent signs stand for
        // one percent sign.
        words.push(format!("--output={}/slurm/{log}.log", self.folder.replace('%', "%%")));
        words.extend_from_slice(&self.options);
        // Of two equal options sbatch takes the last. The sheet waits for the frames, whatever
        // these wait for.
        words.extend_from_slice(more);
        words
    }
}

/// Formats a command for a POSIX shell and quotes words that need it.
pub fn command_line(program: &str, words: &[String]) -> String {
    let words = words.iter().map(|word| quoted(word));
    std::iter::once(program.to_string()).chain(words).collect::<Vec<_>>().join(" ")
}

/// Quotes a word for the shell if necessary.
fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@".contains(c);
    match !text.is_empty() && text.chars().all(plain) {
        true => text.to_string(),
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_end_where_meshes_end_or_divide_them_evenly() {
        let per_task = |frames, per_mesh, frame_seconds| {
            Chunks::new(frames, per_mesh, frame_seconds, 300.0, 1000).per_task
        };
        // A task of 300 s has 30 frames of 10 s. Of the divisors of 72, 24 is the next smaller one.
        assert_eq!(per_task(7200, 72, 10.0), 24);
        assert_eq!(per_task(7200, 72, 1.0), 288);
        assert_eq!(per_task(7200, 72, 1e6), 8);
        assert_eq!(per_task(60, 1, 1e6), 1);
        assert_eq!(per_task(60, 72, 1e-9), 60);
        assert_eq!(per_task(5, 1, 0.0), 5);
    }

    #[test]
    fn there_are_never_more_tasks_than_allowed_and_they_cover_all_frames() {
        for frames in [1, 59, 60, 1001, 2_880_000] {
            for per_mesh in [1, 7, 60, 72] {
                for seconds in [1e-3, 1.0, 20.0, 1e4, f64::NAN] {
                    let chunks = Chunks::new(frames, per_mesh, seconds, 300.0, 1000);
                    assert!(chunks.tasks() <= 1000, "{frames} {per_mesh} {seconds}: {chunks:?}");
                    assert!(chunks.tasks() * chunks.per_task >= frames);
                    assert!((chunks.tasks() - 1) * chunks.per_task < frames);
                }
            }
        }
    }

    #[test]
    fn time_limits_are_those_of_slurm() {
        let known = [
            ("30", 1800.0),
            ("2:30", 150.0),
            ("4:00:00", 14_400.0),
            ("1-2", 93_600.0),
            ("1-2:30", 95_400.0),
            ("1-2:30:15", 95_415.0),
            ("0", f64::INFINITY),
            ("unlimited", f64::INFINITY),
        ];
        for (text, seconds) in known {
            assert_eq!(time_limit(text), Some(seconds), "{text}");
        }
        for text in ["", "blah", "1h", "-1", "1:2:3:4", "1-", "1-2:3:4:5", "1.5"] {
            assert_eq!(time_limit(text), None, "{text}");
        }
    }

    #[test]
    fn shell_words_are_quoted_if_necessary() {
        assert_eq!(quoted("/a-b_c.1"), "/a-b_c.1");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
        assert_eq!(command_line("sbatch", &["%A".into(), "x".into()]), "sbatch '%A' x");
    }

    #[test]
    fn a_script_has_its_arguments_in_its_second_line() {
        let arguments = ["$(touch a)", "it's", "-o x ", "#SBATCH --x", ""].map(str::to_string);
        let script = "#!/bin/bash\n# A comment.\nprintf '%s\\n' \"$@\"\n";
        let job = Submission { options: Vec::new(), script, arguments: arguments.to_vec() };
        let text = job.text();
        let second = r"set -- '$(touch a)' 'it'\''s' '-o x ' '#SBATCH --x' ''";
        assert_eq!(text.lines().nth(1), Some(second));
        assert_eq!(text.replacen(&format!("{second}\n"), "", 1), script);
        let said = std::process::Command::new("bash").args(["-c", &text]).output().unwrap();
        assert_eq!(String::from_utf8(said.stdout).unwrap(), arguments.join("\n") + "\n");
    }
}
