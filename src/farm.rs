//! Work for a farm: how frames are shared out among the tasks of an array job, and the scripts that Slurm
//! gets. Everything that schedules, retries and waits is Slurm's.

use std::fmt::Write;

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

/// What Slurm is told.
#[derive(Debug, Clone)]
pub struct Slurm {
    /// What the queue calls it.
    pub name: String,
    /// The program.
    pub program: String,
    /// The job file.
    pub job: String,
    /// The folder of the frames, which all nodes share.
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
    /// More of `#SBATCH`, as they stand.
    pub options: Vec<String>,
}

/// How often a task that may succeed later is tried again.
const RETRIES: u32 = 3;

impl Slurm {
    /// The script of the array job: one range of frames a task.
    pub fn frames(&self) -> String {
        let last = self.chunks.tasks() - 1;
        let percent = self.at_a_time.map_or(String::new(), |n| format!("%{n}"));
        let mut text = self.head("", &[format!("--array=0-{last}{percent}"), "--requeue".into()]);
        let Chunks { frames, per_task } = self.chunks;
        let (program, job, folder) =
            (quoted(&self.program), quoted(&self.job), quoted(&self.folder));
        let _ = write!(
            text,
            "\n\
             # A task may run twice, also at the same time: every frame gets its name when it is complete, and\n\
             # --resume keeps those that are there.\n\
             first=$((SLURM_ARRAY_TASK_ID * {per_task}))\n\
             end=$((first + {per_task} < {frames} ? first + {per_task} : {frames}))\n\
             child=\n\
             trap 'if [ -n \"$child\" ]; then kill -TERM \"$child\"; fi' TERM USR1\n\
             {program} batch {job} -o {folder} --range \"$first..$end\" --resume --progress plain &\n\
             child=$!\n\
             status=0\n\
             wait \"$child\" || status=$?\n\
             # A signal ends the first wait; the program then finishes what it must.\n\
             while kill -0 \"$child\" 2>/dev/null; do wait \"$child\" || status=$?; done\n\
             case $status in\n\
             \x20   # Some inputs are bad: another try would not help. The last job lists them and fails.\n\
             \x20   1) exit 0 ;;\n\
             \x20   # Disk full, no memory, stopped by a signal: again, but not for ever.\n\
             \x20   3 | 130 | 143)\n\
             \x20       if [ \"${{SLURM_RESTART_COUNT:-0}}\" -lt {RETRIES} ]; then\n\
             \x20           scontrol requeue \"${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID\" && sleep 60\n\
             \x20       fi ;;\n\
             esac\n\
             exit \"$status\"\n"
        );
        text
    }

    /// The script of the job that follows: makes sure that all frames are there, writes the contact sheet.
    pub fn sheet(&self) -> String {
        let mut text = self.head("-sheet", &["--requeue".to_string()]);
        let (program, job, folder) =
            (quoted(&self.program), quoted(&self.job), quoted(&self.folder));
        let _ = write!(
            text,
            "\n# Renders what is still missing, if anything is.\n\
             exec {program} batch {job} -o {folder} --resume --progress plain\n"
        );
        text
    }

    fn head(&self, suffix: &str, more: &[String]) -> String {
        let mut options = vec![format!("--job-name={}{suffix}", self.name)];
        options.extend_from_slice(more);
        options.push(format!("--cpus-per-task={}", self.cpus));
        options.push(format!("--mem={}M", self.memory_mib));
        options.extend(self.time.as_ref().map(|time| format!("--time={time}")));
        // A minute before the time is up; the program then ends with what it has.
        options.push("--signal=B:USR1@60".to_string());
        options.push("--open-mode=append".to_string());
        let log = if suffix.is_empty() { "%A_%a" } else { "%j" };
        options.push(format!("--output={}/slurm/{log}.log", self.folder));
        options.extend_from_slice(&self.options);
        let lines: String =
            options.iter().map(|option| format!("#SBATCH {}\n", sbatch(option))).collect();
        format!("#!/bin/bash\n{lines}set -u\n")
    }
}

/// A word of the shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// An option in a line of `#SBATCH`, whose blanks end a word.
fn sbatch(option: &str) -> String {
    match option.contains([' ', '\t', '#']) {
        true => format!("\"{option}\""),
        false => option.to_string(),
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
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(sbatch("--output=a b/c"), "\"--output=a b/c\"");
    }
}
