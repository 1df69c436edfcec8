//! Inverses that are in use, so that the pictures of one sensor share a table.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use super::distortion::Distortion;
use super::intrinsics::Calibration;
use super::inverse::{Fold, Inverse};

/// Number of tables that are remembered: more than the sensors of most lists.
const MAX_TABLES: usize = 64;

static RECENT: Mutex<VecDeque<Weak<Inverse>>> = Mutex::new(VecDeque::new());

/// Returns the inverse of a distortion over a frame of `size` pixels, width and height. If one of
/// the last tables is the same and still in use, it is returned.
///
/// # Errors
/// As [`Inverse::new`].
pub fn shared_inverse(
    calibration: Calibration,
    distortion: Distortion,
    size: [u32; 2],
) -> Result<Arc<Inverse>, Fold> {
    let recent = || RECENT.lock().unwrap_or_else(PoisonError::into_inner);
    let is_same = |known: &Arc<Inverse>| known.is_of(calibration, distortion, size);
    if let Some(known) = recent().iter().filter_map(Weak::upgrade).find(is_same) {
        return Ok(known);
    }
    let made = Arc::new(Inverse::new(calibration, distortion, size)?);
    let mut recent = recent();
    recent.push_back(Arc::downgrade(&made));
    if recent.len() > MAX_TABLES {
        recent.pop_front();
    }
    Ok(made)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Model;

    #[test]
    fn pictures_of_one_sensor_share_a_table() {
        let calibration =
            Calibration { focal: [900.0, 850.0], principal: [320.5, 175.5], skew: 1.5 };
        let lens = |k1: f64| Distortion {
            model: Model::BrownConrady,
            numerator: [k1, 0.0, 0.0, 0.0],
            denominator: [0.0; 3],
            tangential: [0.0; 2],
        };
        let table = |k1: f64, size| shared_inverse(calibration, lens(k1), size).unwrap();
        let first = table(-0.1, [640, 360]);
        assert!(Arc::ptr_eq(&first, &table(-0.1, [640, 360])));
        for other in [table(-0.2, [640, 360]), table(-0.1, [640, 361])] {
            assert!(!Arc::ptr_eq(&first, &other) && *first != *other);
        }
        assert_eq!(*first, Inverse::new(calibration, lens(-0.1), [640, 360]).unwrap());
    }
}
