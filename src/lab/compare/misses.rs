//! Pixels of depth layers where the camera sees no surface: they hold [`MISS_DEPTH`].

use super::layer::{Meaning, PictureLayer};
use crate::layers::MISS_DEPTH;

/// Pixels of a layer of data that miss in one file or in both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Misses {
    /// Number of pixels that miss in both files.
    pub both: u64,
    /// Number of pixels that miss in the picture alone, and in the reference alone.
    pub alone: [u64; 2],
    /// Position in the frame of the first pixel that misses in one file alone, if any.
    pub first: Option<[i64; 2]>,
}

/// Which of two pixels at the same place miss.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Miss {
    /// None: their difference has a meaning.
    Neither,
    /// Both.
    Both,
    /// Only that of the picture.
    Test,
    /// Only that of the reference.
    Reference,
}

impl Miss {
    /// Returns which of two pixels of a layer misses. A pixel of several channels misses if all
    /// hold the depth of a miss.
    pub fn of(test: &[f32], reference: &[f32]) -> Self {
        let misses = |pixel: &[f32]| pixel.iter().all(|value| *value == MISS_DEPTH);
        match (misses(test), misses(reference)) {
            (false, false) => Self::Neither,
            (true, true) => Self::Both,
            (true, false) => Self::Test,
            (false, true) => Self::Reference,
        }
    }
}

impl Misses {
    /// Number of pixels that miss in one file alone.
    pub fn differing(&self) -> u64 {
        self.alone.iter().sum()
    }

    /// Counts the pixels of a layer that miss. `None` if there are none, or if it is no data.
    pub fn of(test: &PictureLayer, reference: &PictureLayer) -> Option<Self> {
        if test.meaning != Meaning::Data {
            return None;
        }
        let mut found = Self { both: 0, alone: [0; 2], first: None };
        for (index, (x, r)) in pixels(test, reference).enumerate() {
            let file = match Miss::of(x, r) {
                Miss::Neither => continue,
                Miss::Both => {
                    found.both += 1;
                    continue;
                }
                Miss::Test => 0,
                Miss::Reference => 1,
            };
            found.alone[file] += 1;
            found.first.get_or_insert_with(|| test.position(index));
        }
        (found.both + found.differing() > 0).then_some(found)
    }
}

/// The values of picture and reference at all pixels that miss in neither.
pub fn hits(test: &PictureLayer, reference: &PictureLayer) -> [Vec<f32>; 2] {
    let mut values = [Vec::new(), Vec::new()];
    for (x, r) in pixels(test, reference).filter(|(x, r)| Miss::of(x, r) == Miss::Neither) {
        values[0].extend_from_slice(x);
        values[1].extend_from_slice(r);
    }
    values
}

/// The pixels of two layers of the same size.
fn pixels<'a>(
    test: &'a PictureLayer,
    reference: &'a PictureLayer,
) -> impl Iterator<Item = (&'a [f32], &'a [f32])> {
    let channels = test.values_per_pixel();
    test.values.chunks_exact(channels).zip(reference.values.chunks_exact(channels))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depths(meaning: Meaning, values: &[f32]) -> PictureLayer {
        PictureLayer {
            name: "Z".into(),
            meaning,
            size: [2, values.len() / 2],
            origin: [5, 7],
            channels: vec!["Z".into()],
            values: values.to_vec(),
            half: false,
        }
    }

    #[test]
    fn misses_are_counted_and_left_out() {
        let miss = MISS_DEPTH;
        let (x, r) = ([miss, 1.0, 2.0, miss, miss, 3.0], [miss, 1.5, 2.0, 4.0, miss, miss]);
        let [test, reference] = [x, r].map(|values| depths(Meaning::Data, &values));
        let found = Misses::of(&test, &reference).unwrap();
        assert_eq!(found, Misses { both: 2, alone: [1, 1], first: Some([6, 8]) });
        assert_eq!(hits(&test, &reference), [vec![1.0, 2.0], vec![1.5, 2.0]]);
    }

    #[test]
    fn light_and_other_data_have_no_misses() {
        let light = depths(Meaning::Ids, &[MISS_DEPTH; 2]);
        assert_eq!(Misses::of(&light, &light), None);
        let far = depths(Meaning::Data, &[1e29, 2e30]);
        assert_eq!(Misses::of(&far, &far), None);
    }
}
