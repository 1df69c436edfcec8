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
    (index(x.floor(), 0, width, wrap_u), index(y.floor(), 0, height, wrap_v))
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
    let (column, row) = (x.floor(), y.floor());
    let (x0, x1) = (index(column, 0, width, wrap_u), index(column, 1, width, wrap_u));
    let (y0, y1) = (index(row, 0, height, wrap_v), index(row, 1, height, wrap_v));
    let (s, t) = (fraction(x - column), fraction(y - row));
    let upper = mix(texel(x0, y0), texel(x1, y0), s);
    let lower = mix(texel(x0, y1), texel(x1, y1), s);
    mix(upper, lower, t)
}

/// Texel index `floor + offset` on an axis of `size` texels. Any `floor` is safe: `as` saturates
/// and turns NaN into 0.
fn index(floor: f64, offset: i64, size: u32, wrap: Wrap) -> usize {
    let i = (floor as i64).saturating_add(offset);
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

/// A filter weight; 0 if the coordinate was not finite.
fn fraction(value: f64) -> f32 {
    if value.is_finite() { value as f32 } else { 0.0 }
}

/// Linear interpolation from `a` at t = 0 to `b` at t = 1. Exactly `a` for any t if the two are
/// equal.
fn mix(a: Vec3, b: Vec3, t: f32) -> Vec3 {
    a + (b - a) * t
}
