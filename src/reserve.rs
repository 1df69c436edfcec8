//! Reserves memory whose size comes from a file or a scene, before the memory is used. So a lack of
//! memory is an error and does not end the process.

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::units;

/// A limit of memory, and whether the user set it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryLimit {
    /// The limit in bytes.
    pub bytes: u64,
    /// True if the user set the limit (`--max-memory`). False if it is the memory of the machine.
    pub set_by_user: bool,
}

impl MemoryLimit {
    /// Checks that `bytes` do not exceed the limit. `what` names the object that needs them.
    ///
    /// # Errors
    /// `Limit` if the user set the limit, else `Retry`.
    pub fn check(self, bytes: u64, what: &str) -> Result<()> {
        if bytes <= self.bytes {
            return Ok(());
        }
        let (bytes, room) = (units::bytes_rounded_up(bytes), units::bytes(self.bytes));
        Err(match self.set_by_user {
            true => {
                let message = format!("needs {bytes}; --max-memory leaves {room}");
                Error::new(ErrorKind::Limit, Problem::new(what, message))
            }
            false => Error::no_memory(what, format!("needs {bytes}; the machine has {room}")),
        })
    }

    /// Returns the limit minus `bytes`.
    pub fn less(self, bytes: u64) -> Self {
        Self { bytes: self.bytes.saturating_sub(bytes), ..self }
    }
}

/// Makes the error for a lack of `bytes` that `what` needs.
pub fn lack(bytes: u64, what: &str) -> Error {
    let message = format!("no memory for {}", units::bytes_rounded_up(bytes));
    let help = "free some memory, or raise the limit of this process";
    Error::no_memory(what, message).help(help)
}

/// Reserves capacity for exactly `more` elements.
///
/// # Errors
/// `Retry` if the system refuses the memory.
pub fn exact<T>(all: &mut Vec<T>, more: usize, what: &str) -> Result<()> {
    all.try_reserve_exact(more).map_err(|_| lack(bytes_of::<T>(more), what))
}

/// Reserves capacity for `more` elements, and for further growth if there is memory.
///
/// # Errors
/// `Retry` if the system refuses the memory.
pub fn growing<T>(all: &mut Vec<T>, more: usize, what: &str) -> Result<()> {
    // `try_reserve` may double the array. That can fail where the exact size succeeds.
    all.try_reserve(more)
        .or_else(|_| all.try_reserve_exact(more))
        .map_err(|_| lack(bytes_of::<T>(all.len().saturating_add(more)), what))
}

/// Makes an array of `count` copies of `value`. If `value` is zero, the system provides the memory
/// only when it is touched.
///
/// # Errors
/// `Retry` if the system refuses the memory.
pub fn filled<T: Clone>(value: T, count: usize, what: &str) -> Result<Vec<T>> {
    probe(bytes_of::<T>(count), what)?;
    Ok(vec![value; count])
}

/// Checks that `bytes` of memory can be reserved, and releases them. Call it before work whose own
/// allocations cannot return an error.
///
/// # Errors
/// `Retry` if the system refuses the memory.
pub fn probe(bytes: u64, what: &str) -> Result<()> {
    let count = usize::try_from(bytes).map_err(|_| lack(bytes, what))?;
    exact(&mut Vec::<u8>::new(), count, what)
}

fn bytes_of<T>(count: usize) -> u64 {
    (count as u64).saturating_mul(size_of::<T>() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_large_reservations_are_errors() {
        let huge = usize::MAX / 16;
        let kinds = [
            exact(&mut Vec::<u64>::new(), huge, "x").unwrap_err().kind,
            growing(&mut vec![1u8], huge * 8, "x").unwrap_err().kind,
            filled([0u8; 8], huge, "x").unwrap_err().kind,
            probe(u64::MAX, "x").unwrap_err().kind,
        ];
        assert_eq!(kinds, [ErrorKind::Retry; 4]);
        assert_eq!(filled(7, 3, "x"), Ok(vec![7; 3]));
        assert!(probe(1 << 20, "x").is_ok());
    }

    #[test]
    fn the_error_of_a_limit_depends_on_who_set_it() {
        let limit = MemoryLimit { bytes: 100, set_by_user: true };
        assert_eq!(limit.check(100, "x"), Ok(()));
        let error = limit.less(40).check(61, "m.ply").unwrap_err();
        assert_eq!(error.kind, ErrorKind::Limit);
        assert!(error.to_string().contains("--max-memory leaves 60 B"), "{error}");
        let machine = MemoryLimit { set_by_user: false, ..limit };
        assert_eq!(machine.check(101, "x").unwrap_err().kind, ErrorKind::Retry);
    }
}
