//! Nearest and bilinear lookups in a grid of texels. The grid covers [0, 1]^2; row 0 is the top.
//!
//! Any u, v are safe: NaN gives texel 0 of its axis, huge values give some texel of the grid.

use glam::{DVec2, Vec3};

use crate::scene::Wrap;

/// Column and row of the texel at `uv`.
#[inline(always)]
pub(super) fn nearest(
    (width, height): (u32, u32),
    uv: DVec2,
    [wrap_u, wrap_v]: [Wrap; 2],
) -> (usize, usize) {
    // The products are exact for u, v that are f32 values, so floor is right at every border.
    let (x, y) = (uv.x * f64::from(width), uv.y * f64::from(height));
    (index(floor(x), 0, width, wrap_u), index(floor(y), 0, height, wrap_v))
}

/// Interpolates between the four texels around `uv`.
#[inline(always)]
pub(super) fn bilinear(
    (width, height): (u32, u32),
    uv: DVec2,
    [wrap_u, wrap_v]: [Wrap; 2],
    mut texel: impl FnMut(usize, usize) -> Vec3,
) -> Vec3 {
    let (x, y) = (uv.x * f64::from(width) - 0.5, uv.y * f64::from(height) - 0.5);
    let (column, row) = (floor(x), floor(y));
    let columns = [index(column, 0, width, wrap_u), index(column, 1, width, wrap_u)];
    let rows = [index(row, 0, height, wrap_v), index(row, 1, height, wrap_v)];
    let (s, t) = (fraction(x - column as f64), fraction(y - row as f64));
    // A loop, so that the compiler inlines the closure: it is called in one place.
    let mut texels = [Vec3::ZERO; 4];
    for k in 0..4 {
        texels[k] = texel(columns[k % 2], rows[k / 2]);
    }
    let [a, b, c, d] = texels;
    mix(mix(a, b, s), mix(c, d, s), t)
}

/// The largest integer <= x. Saturates; 0 for NaN. `f64::floor` would be a call.
#[inline(always)]
fn floor(x: f64) -> i64 {
    let towards_zero = x as i64;
    towards_zero.saturating_sub(i64::from(x < towards_zero as f64))
}

/// Texel index `floor + offset` on an axis of `size` texels, for any `floor`.
#[inline(always)]
fn index(floor: i64, offset: i64, size: u32, wrap: Wrap) -> usize {
    let i = floor.saturating_add(offset);
    let size = i64::from(size);
    let inside = if (0..size).contains(&i) {
        i
    } else {
        match wrap {
            Wrap::Repeat => i.rem_euclid(size),
            Wrap::Clamp => i.clamp(0, size - 1),
        }
    };
    inside as usize
}

/// A filter weight; 0 if the coordinate was not finite or huge. It is 1 where a coordinate just
/// below an integer rounds to it.
#[inline(always)]
fn fraction(value: f64) -> f32 {
    if (0.0..=1.0).contains(&value) { value as f32 } else { 0.0 }
}

/// Linear interpolation from `a` at t = 0 to `b` at t = 1. Exactly `a` for any t if the two are
/// equal.
#[inline(always)]
fn mix(a: Vec3, b: Vec3, t: f32) -> Vec3 {
    a + (b - a) * t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coordinate_just_below_a_centre_gives_its_texel() {
        for size in 2..400 {
            let mut u = 0.5 / f64::from(size);
            for _ in 0..4 {
                for uv in [DVec2::new(u, 0.5), DVec2::new(0.5, u)] {
                    let of = |column: usize, row: usize| Vec3::splat((column + row) as f32);
                    let (wide, high) = if uv.x == u { (size, 1) } else { (1, size) };
                    let found = bilinear((wide, high), uv, [Wrap::Repeat; 2], of);
                    assert!(found.x.abs() < 1e-6, "{size}: {found}");
                }
                u = f64::from_bits(u.to_bits() - 1);
            }
        }
    }
}
