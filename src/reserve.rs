//! Memory whose size comes from a file or a scene: asked for before it is used, so that its lack is an
//! error and not the end of the process.

use crate::{
    error::{Error, Kind, Problem, Result},
    units,
};

/// The most that something may take, and who says so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// Bytes.
    pub bytes: u64,
    /// The user set it (`--max-memory`); otherwise it is what the machine has.
    pub asked: bool,
}

impl Room {
    /// Refuses more bytes than there is room for. `what` needs them.
    ///
    /// # Errors
    /// `Limit` where the user set the limit, else `Retry`.
    pub fn check(self, bytes: u64, what: &str) -> Result<()> {
        if bytes <= self.bytes {
            return Ok(());
        }
        let (bytes, room) = (units::bytes_rounded_up(bytes), units::bytes(self.bytes));
        let (kind, message) = match self.asked {
            true => (Kind::Limit, format!("needs {bytes}; --max-memory leaves {room}")),
            false => (Kind::Retry, format!("needs {bytes}; the machine has {room}")),
        };
        Err(Error::new(kind, Problem::new(what, message)))
    }

    /// What is left once so much of it is taken.
    pub fn less(self, bytes: u64) -> Self {
        Self { bytes: self.bytes.saturating_sub(bytes), ..self }
    }
}

/// The error for a lack of `bytes` that `what` needs.
pub fn lack(bytes: u64, what: &str) -> Error {
    let message = format!("no memory for {}", units::bytes_rounded_up(bytes));
    let help = "free some memory, or raise the limit of this process";
    Error::new(Kind::Retry, Problem::new(what, message).help(help))
}

/// Makes room for exactly `more` elements.
///
/// # Errors
/// `Retry` where the system does not give it.
pub fn exact<T>(all: &mut Vec<T>, more: usize, what: &str) -> Result<()> {
    all.try_reserve_exact(more).map_err(|_| lack(bytes_of::<T>(more), what))
}

/// Makes room for `more` elements, and for some to come.
///
/// # Errors
/// `Retry` where the system does not give it.
pub fn growing<T>(all: &mut Vec<T>, more: usize, what: &str) -> Result<()> {
    // Twice of much may be too much where enough is not.
    all.try_reserve(more)
        .or_else(|_| all.try_reserve_exact(more))
        .map_err(|_| lack(bytes_of::<T>(all.len().saturating_add(more)), what))
}

/// An array of `count` times `value`. Zeros are pages that the system makes when they are touched.
///
/// # Errors
/// `Retry` where the system does not give the memory.
pub fn filled<T: Clone>(value: T, count: usize, what: &str) -> Result<Vec<T>> {
    probe(bytes_of::<T>(count), what)?;
    Ok(vec![value; count])
}

/// Asks whether there is memory for `bytes`, and gives it back: for work whose many small allocations
/// cannot fail one by one.
///
/// # Errors
/// `Retry` where the system does not give it.
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
    fn too_much_is_an_error() {
        let most = usize::MAX / 16;
        let kinds = [
            exact(&mut Vec::<u64>::new(), most, "x").unwrap_err().kind,
            growing(&mut vec![1u8], most * 8, "x").unwrap_err().kind,
            filled([0u8; 8], most, "x").unwrap_err().kind,
            probe(u64::MAX, "x").unwrap_err().kind,
        ];
        assert_eq!(kinds, [Kind::Retry; 4]);
        assert_eq!(filled(7, 3, "x"), Ok(vec![7; 3]));
        assert!(probe(1 << 20, "x").is_ok());
    }

    #[test]
    fn a_room_says_who_set_it() {
        let room = Room { bytes: 100, asked: true };
        assert_eq!(room.check(100, "x"), Ok(()));
        let error = room.less(40).check(61, "m.ply").unwrap_err();
        assert_eq!(error.kind, Kind::Limit);
        assert!(error.to_string().contains("--max-memory leaves 60 B"), "{error}");
        let machine = Room { asked: false, ..room };
        assert_eq!(machine.check(101, "x").unwrap_err().kind, Kind::Retry);
    }
}
