//! Work for a farm: how frames are shared out among the tasks of an array job, and what `sbatch` is given.
//! Everything that schedules, retries and waits is Slurm's.

/// Frames of a batch, shared out among tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunks {
    /// All frames.
    pub frames: u64,
    /// Frames of each task but the last.
    pub per_task: u64,
}

impl Chunks {
    /// Tasks of about `seconds`, of frames that take `frame_seconds` each, but at most `most` tasks. Tasks
    /// end where meshes (of `per_mesh` frames) end, or divide a mesh evenly, so that no task reads two
    /// meshes for the frames of one.
    pub fn new(frames: u64, per_mesh: u64, frame_seconds: f64, seconds: f64, most: u64) -> Self {
        let frames = frames.max(1);
        let per_mesh = per_mesh.clamp(1, frames);
        // Saturates; a frame that takes no time makes one task.
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

    /// How many tasks there are.
    pub fn tasks(&self) -> u64 {
        self.frames.div_ceil(self.per_task)
    }
}

/// The script of a task of the array job. Its arguments: program, job, folder, frames, frames per task.
pub const FRAMES_SCRIPT: &str = include_str!("../farm/slurm-frames.sh");
/// The script of the job that follows. Its arguments: program, job, folder.
pub const SHEET_SCRIPT: &str = include_str!("../farm/slurm-sheet.sh");

/// What Slurm is asked for. Names go to `sbatch` and to its scripts as arguments, so that nothing
/// reads them as options, as lines of `#SBATCH` or as commands.
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
    /// How frames are shared out.
    pub chunks: Chunks,
    /// Tasks that may run at a time.
    pub at_a_time: Option<u32>,
    /// Processors of a task.
    pub cpus: u16,
    /// Memory of a task.
    pub memory_mib: u64,
    /// The most that a task may take, as Slurm writes times.
    pub time: Option<String>,
    /// More options of `sbatch`, as they stand.
    pub options: Vec<String>,
}

impl Slurm {
    /// Arguments of `sbatch` for the array job, whose script is the file `script`.
    pub fn frames(&self, script: &str) -> Vec<String> {
        let last = self.chunks.tasks() - 1;
        let percent = self.at_a_time.map_or(String::new(), |n| format!("%{n}"));
        let mut words = self.options("", "%A_%a", &[format!("--array=0-{last}{percent}")]);
        let Chunks { frames, per_task } = self.chunks;
        words.extend([script, &self.program, &self.job, &self.folder].map(str::to_string));
        words.extend([frames, per_task].map(|count| count.to_string()));
        words
    }

    /// Arguments of `sbatch` for the job that follows the array job `after`, however that ends.
    pub fn sheet(&self, script: &str, after: &str) -> Vec<String> {
        let mut words = self.options("-sheet", "%j", &[format!("--dependency=afterany:{after}")]);
        words.extend([script, &self.program, &self.job, &self.folder].map(str::to_string));
        words
    }

    fn options(&self, suffix: &str, log: &str, more: &[String]) -> Vec<String> {
        let mut words = vec!["--parsable".to_string(), format!("--job-name={}{suffix}", self.name)];
        words.extend_from_slice(more);
        words.push("--requeue".to_string());
        words.push(format!("--cpus-per-task={}", self.cpus));
        words.push(format!("--mem={}M", self.memory_mib));
        words.extend(self.time.as_ref().map(|time| format!("--time={time}")));
        // A minute before the time is up; the program then ends with what it has.
        words.push("--signal=B:USR1@60".to_string());
        words.push("--open-mode=append".to_string());
        // Slurm replaces a percent sign and what follows it, but for two of them.
        words.push(format!("--output={}/slurm/{log}.log", self.folder.replace('%', "%%")));
        words.extend_from_slice(&self.options);
        words
    }
}

/// A command as a POSIX shell reads it: each word in quotes unless it needs none.
pub fn command_line(program: &str, words: &[String]) -> String {
    let words = words.iter().map(|word| quoted(word));
    std::iter::once(program.to_string()).chain(words).collect::<Vec<_>>().join(" ")
}

/// A word of the shell.
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
    fn tasks_last_minutes_and_end_where_meshes_end() {
        let per_task = |frames, per_mesh, frame_seconds| {
            Chunks::new(frames, per_mesh, frame_seconds, 300.0, 1000).per_task
        };
        // 30 frames in 300 s: of 72 a mesh, 24 divides evenly.
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
    fn names_are_words_of_the_shell() {
        assert_eq!(quoted("/a-b_c.1"), "/a-b_c.1");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
        assert_eq!(command_line("sbatch", &["%A".into(), "x".into()]), "sbatch '%A' x");
    }
}
