//! Values that the files cannot hold: replaces and counts them.

use crate::film::{ChannelKind, Dropped, Film};
use crate::parallel;

/// Largest finite value of a half-float.
pub const HALF_MAX: f32 = 65504.0;

/// The pixel and the channel of a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ValueLocation {
    /// Pixel of the frame, `[x, y]` from the top left.
    pub pixel: [i32; 2],
    /// Name of the channel.
    pub channel: String,
}

impl std::fmt::Display for ValueLocation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.pixel;
        write!(f, "x {x}, y {y} in {}", self.channel)
    }
}

/// Counts of values that the files cannot hold.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ValueCounts {
    /// Number of pixels with a NaN or infinite channel. In the file, NaN becomes 0, and an infinity
    /// becomes the largest value of the same sign that the channel holds.
    pub non_finite: u64,
    /// Location of the first such value, row by row.
    pub first_non_finite: Option<ValueLocation>,
    /// Number of pixels with a finite value that is clamped to the range of its channel, whether or
    /// not another of their channels is NaN or infinite.
    pub clamped: u64,
    /// Location of the first such value, row by row.
    pub first_clamped: Option<ValueLocation>,
    /// Largest absolute value that the channel of the first such value holds; 0 without one.
    pub clamped_to: f32,
    /// Coverage that the mattes cannot hold, as recorded in the film.
    pub dropped: Dropped,
    /// True if the PNG has no room for the legend that it should have.
    pub legend_left_out: bool,
}

impl ValueCounts {
    /// Counts the pixels of a film with such values, on the threads of the caller's rayon pool.
    /// `largest` gives by name and kind the largest absolute value that the file holds in a channel
    /// ([`super::exr::Options::largest`]).
    pub fn count(film: &Film, largest: impl Fn(&str, ChannelKind) -> f32) -> Self {
        let width = film.window.width().max(1) as usize;
        let beauty = ["R", "G", "B", "A"].map(|name| largest(name, ChannelKind::Half));
        let kinds = film.planes.channels.iter().enumerate();
        let floats: Vec<(usize, f32)> = kinds
            .filter(|(_, channel)| channel.kind != ChannelKind::Uint)
            .map(|(i, channel)| (i, largest(&channel.name, channel.kind)))
            .collect();
        let found = parallel::map(film.pixels.chunks(width).enumerate(), |(row, pixels)| {
            let mut found = Self::default();
            for (column, pixel) in pixels.iter().enumerate() {
                let index = row * width + column;
                // NaN fails the comparison, so the common case is one test per channel.
                if pixel.iter().zip(beauty).all(|(c, limit)| c.abs() <= limit)
                    && floats.iter().all(|&(i, limit)| film.planes.float(i, index).abs() <= limit)
                {
                    continue;
                }
                let names = ["R", "G", "B", "A"].into_iter().zip(*pixel).zip(beauty);
                let planes = floats.iter().map(|&(i, limit)| {
                    let name = film.planes.channels[i].name.as_str();
                    ((name, film.planes.float(i, index)), limit)
                });
                let [left, top] = film.origin();
                let pixel = [left + column as i32, top + row as i32];
                found.add(pixel, names.chain(planes));
            }
            found
        });
        Self { dropped: film.dropped, ..found.into_iter().fold(Self::default(), Self::then) }
    }

    /// Counts one pixel. Each item is a channel's name, its value, and the largest absolute value
    /// that the file can hold.
    fn add<'a>(
        &mut self,
        pixel: [i32; 2],
        values: impl Iterator<Item = ((&'a str, f32), f32)> + Clone,
    ) {
        let spot = |name: &str| ValueLocation { pixel, channel: name.to_string() };
        let non_finite = values.clone().find(|((_, value), _)| !value.is_finite());
        if let Some(((name, _), _)) = non_finite {
            self.non_finite += 1;
            self.first_non_finite.get_or_insert_with(|| spot(name));
        }
        let is_clamped = |v: f32, max: f32| v.is_finite() && v.abs() > max;
        let clamped = values.clone().find(|((_, value), max)| is_clamped(*value, *max));
        if let Some(((name, _), limit)) = clamped {
            self.clamped += 1;
            if self.first_clamped.is_none() {
                (self.first_clamped, self.clamped_to) = (Some(spot(name)), limit);
            }
        }
    }

    /// Combines the counts of these pixels with those of later pixels.
    fn then(self, next: Self) -> Self {
        let first = if self.first_clamped.is_some() { &self } else { &next };
        Self {
            clamped_to: first.clamped_to,
            non_finite: self.non_finite + next.non_finite,
            first_non_finite: self.first_non_finite.or(next.first_non_finite),
            clamped: self.clamped + next.clamped,
            first_clamped: self.first_clamped.or(next.first_clamped),
            dropped: self.dropped.and(next.dropped),
            legend_left_out: self.legend_left_out | next.legend_left_out,
        }
    }
}

/// Replaces values that are not finite: NaN becomes 0, an infinity becomes the largest half of the
/// same sign. So does the largest float, which stands for infinity in files of floats. Other finite
/// values stay, even beyond the range of a half.
#[inline(always)]
pub fn finite(value: f32) -> f32 {
    if value.is_nan() {
        0.0
    } else if value.abs() >= f32::MAX {
        HALF_MAX.copysign(value)
    } else {
        value
    }
}
