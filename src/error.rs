//! The error type: what is wrong, where, and what to do about it.
//!
//! An error carries every problem that was found, not only the first, so that a user can fix all of
//! them at once. `main` prints the error of a command and sets the exit code. A batch also prints
//! the failure of an input when it happens.

mod printable;

pub use printable::{is_hidden, printable, printable_lines};

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// A `Result` whose error is [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// The class of an error: it decides the exit code and whether a retry can help.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// Invalid use or input: flags, scene, mesh, texture. Exit code 2.
    Invalid,
    /// The input may be valid, but this program or this machine does not support it. Exit code 2.
    Unsupported,
    /// A limit that the user set (`--max-memory`, `ulimit -f`), or a size that no machine can hold.
    /// Exit code 2.
    Limit,
    /// A check or threshold failed. Exit code 1.
    Check,
    /// Disk full, out of memory, a file that changed while it was read: a retry may help. Exit code
    /// 3.
    Retry,
    /// Stopped by the signal of this number. Exit code 128 + signal.
    Interrupted(i32),
}

/// A single problem, or a warning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// The place: `scene.json:3:14 (/camera/fov)`, `bunny.ply: vertex 12`, `--crop`. May be empty.
    pub place: String,
    /// What was found, and what was expected.
    pub message: String,
    /// The nearest valid choice or the next step, if there is one.
    pub help: Option<String>,
    /// What the operating system said, if that is the problem: a missing file, a lack of memory.
    pub cause: Option<io::ErrorKind>,
    /// The file or folder that `cause` is about.
    pub file: Option<PathBuf>,
    /// The operating system's number of `cause`, if that came from it.
    pub errno: Option<i32>,
}

impl Problem {
    /// Makes a problem at `place` without help.
    #[doc(hidden)]
    pub fn new(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            place: place.into(),
            message: message.into(),
            help: None,
            cause: None,
            file: None,
            errno: None,
        }
    }

    /// Adds a next step to the problem.
    #[doc(hidden)]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Adds what the operating system said.
    #[doc(hidden)]
    pub fn cause(mut self, cause: io::ErrorKind) -> Self {
        self.cause = Some(cause);
        self
    }

    /// Adds what the operating system said, or would say, about a file.
    #[doc(hidden)]
    pub fn cause_of(self, file: &Path, cause: io::ErrorKind) -> Self {
        Self { file: Some(file.to_owned()), ..self.cause(cause) }
    }

    /// Adds an error of the operating system about a file.
    #[doc(hidden)]
    pub fn failed_file(self, file: &Path, error: &io::Error) -> Self {
        Self { errno: error.raw_os_error(), ..self.cause_of(file, error.kind()) }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.place.is_empty() {
            write!(f, "{}: ", printable(&self.place))?;
        }
        f.write_str(&printable(&self.message))?;
        match &self.help {
            Some(help) => write!(f, "\n  help: {}", printable(help)),
            None => Ok(()),
        }
    }
}

/// Most problems of one input that are shown.
const MAX_PROBLEMS: usize = 200;

/// One or more problems, and one class for all of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Error {
    /// The class, which decides the exit code.
    pub kind: ErrorKind,
    /// All problems, in the order in which they were found. Never empty.
    pub problems: Vec<Problem>,
}

impl Error {
    /// Makes an error with one problem.
    #[doc(hidden)]
    pub fn new(kind: ErrorKind, problem: Problem) -> Self {
        Self { kind, problems: vec![problem] }
    }

    /// Returns `Ok` if there are no problems.
    ///
    /// # Errors
    /// An error of class `kind` with all `problems`.
    pub fn check(kind: ErrorKind, problems: Vec<Problem>) -> Result<()> {
        if problems.is_empty() { Ok(()) } else { Err(Self { kind, problems }) }
    }

    /// Returns `Ok` if there are no failures. `check` is the place of the problems.
    ///
    /// # Errors
    /// [`ErrorKind::Check`] (exit code 1), with one problem per failure.
    pub fn failed(check: &str, failures: impl IntoIterator<Item = String>) -> Result<()> {
        let problems = failures.into_iter().map(|failure| Problem::new(check, failure));
        Self::check(ErrorKind::Check, problems.collect())
    }

    /// Makes an error about invalid input at `place`.
    #[doc(hidden)]
    pub fn invalid(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Invalid, Problem::new(place, message))
    }

    /// Makes an error about a lack of memory for `what`.
    #[doc(hidden)]
    pub fn no_memory(what: &str, message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Retry, Problem::new(what, message).cause(io::ErrorKind::OutOfMemory))
    }

    /// Makes an error about `path` from an I/O error. `what` is the failed action ("read",
    /// "create").
    ///
    /// Errors that the user must fix first (missing file, a folder, no permission) are
    /// [`ErrorKind::Invalid`]. A file beyond a size limit is [`ErrorKind::Limit`]. All other errors
    /// (disk full, device error) are [`ErrorKind::Retry`].
    #[doc(hidden)]
    pub fn io(path: &Path, what: &str, error: &io::Error) -> Self {
        use io::ErrorKind as E;
        let kind = match error.kind() {
            E::NotFound
            | E::PermissionDenied
            | E::IsADirectory
            | E::NotADirectory
            | E::ReadOnlyFilesystem
            | E::AlreadyExists
            | E::InvalidData
            | E::InvalidInput => ErrorKind::Invalid,
            // The limit of the file system or of `ulimit -f`.
            E::FileTooLarge => ErrorKind::Limit,
            // ENAMETOOLONG and ELOOP by their numbers on Linux: the oldest supported compiler has
            // no stable names for them.
            _ if matches!(error.raw_os_error(), Some(36 | 40)) => ErrorKind::Invalid,
            _ => ErrorKind::Retry,
        };
        let place = path.display().to_string();
        let problem = Problem::new(place, format!("cannot {what}: {error}"));
        Self::new(kind, problem.failed_file(path, error))
    }

    /// Makes an error about a file or folder that is not of the kind that is needed. `cause` is
    /// what the operating system would say.
    #[doc(hidden)]
    pub fn of_file(path: &Path, cause: io::ErrorKind, message: impl Into<String>) -> Self {
        let problem = Problem::new(path.display().to_string(), message);
        Self::new(ErrorKind::Invalid, problem.cause_of(path, cause))
    }

    /// Returns the error with its first 200 problems and one that says how many more there are:
    /// "and" with the text of `counted`.
    #[doc(hidden)]
    pub fn shortened(mut self, counted: impl FnOnce(usize) -> String) -> Self {
        let more = self.problems.len().saturating_sub(MAX_PROBLEMS);
        if more > 0 {
            self.problems.truncate(MAX_PROBLEMS);
            self.problems.push(Problem::new("", format!("and {}", counted(more))));
        }
        self
    }

    /// Sets the next step of the last problem.
    #[doc(hidden)]
    pub fn help(self, help: impl Into<String>) -> Self {
        self.maybe_help(Some(help))
    }

    /// Sets the next step of the last problem, if there is one.
    #[doc(hidden)]
    pub fn maybe_help(mut self, help: Option<impl Into<String>>) -> Self {
        if let (Some(problem), Some(help)) = (self.problems.last_mut(), help) {
            problem.help = Some(help.into());
        }
        self
    }

    /// Returns the exit code of the program: 1 check, 2 input, 3 retry, 128 + signal.
    pub fn exit_code(&self) -> u8 {
        match self.kind {
            ErrorKind::Check => 1,
            ErrorKind::Invalid | ErrorKind::Unsupported | ErrorKind::Limit => 2,
            ErrorKind::Retry => 3,
            ErrorKind::Interrupted(signal) => 128i32.wrapping_add(signal) as u8,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().enumerate() {
            if i > 0 {
                f.write_str("\n")?;
            }
            write!(f, "error: {problem}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {}

/// Collects the errors of independent steps into one error, so that all problems are reported.
#[derive(Debug, Default)]
pub struct Failures(Option<Error>);

impl Failures {
    /// Returns the value, or stores the error and returns `None`.
    pub fn keep<T>(&mut self, result: Result<T>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(error) => {
                match &mut self.0 {
                    None => self.0 = Some(error),
                    Some(all) => {
                        // If one step needs a fix, a retry alone does not help. Otherwise the
                        // first error decides the class.
                        if all.kind == ErrorKind::Retry {
                            all.kind = error.kind;
                        }
                        // A key that many objects share has one problem.
                        let new = |problem: &Problem| !all.problems.contains(problem);
                        let new: Vec<_> = error.problems.into_iter().filter(new).collect();
                        all.problems.extend(new);
                    }
                }
                None
            }
        }
    }

    /// Returns `Ok` if no error was stored, else one error with all their problems.
    pub fn check(self) -> Result<()> {
        self.0.map_or(Ok(()), Err)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_keep_every_problem_and_a_kind_that_excludes_a_retry() {
        let mut failures = Failures::default();
        assert_eq!(failures.keep(Ok(1)), Some(1));
        let retry = Error::new(ErrorKind::Retry, Problem::new("a", "full"));
        assert_eq!(failures.keep::<()>(Err(retry)), None);
        for _ in 0..2 {
            assert_eq!(failures.keep::<()>(Err(Error::invalid("b", "bad"))), None);
        }
        let error = failures.check().unwrap_err();
        assert_eq!((error.kind, error.problems.len()), (ErrorKind::Invalid, 2));
        assert_eq!(Failures::default().check(), Ok(()));
    }

    #[test]
    fn a_shortened_error_says_how_many_more_problems_there_are() {
        let lines = |count: usize| {
            let problems = (0..count).map(|i| Problem::new("a", i.to_string())).collect();
            let error = Error { kind: ErrorKind::Invalid, problems };
            let text = error.shortened(|more| format!("{more} more")).to_string();
            (text.lines().count(), text.lines().last().unwrap_or_default().to_string())
        };
        assert_eq!(lines(200), (200, "error: a: 199".into()));
        assert_eq!(lines(201), (201, "error: and 1 more".into()));
        assert_eq!(lines(1200).1, "error: and 1000 more");
    }
}
