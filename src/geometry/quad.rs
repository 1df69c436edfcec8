//! A quad as two triangles, and which of them a hit is on.

/// Splits a quad into its two triangles.
#[inline(always)]
pub fn quad_halves<T: Copy>([v0, v1, v2, v3]: [T; 4]) -> [[T; 3]; 2] {
    [[v0, v1, v3], [v2, v3, v1]]
}

/// Returns the weights of a hit on a quad so that [`quad_half`](super::Geometry::quad_half) finds
/// the half that was hit: `second` or not. Near the diagonal, rounding may have taken u + v to the
/// other half.
#[inline(always)]
pub fn on_quad_half(u: f32, v: f32, second: bool) -> (f32, f32) {
    if (u + v > 1.0) == second {
        return (u, v);
    }
    // The smaller weight is at most about 1/2, so it stays below 1.
    let beyond = if second { 2.0 * f32::EPSILON } else { 0.0 };
    if u > v { (u, 1.0 - u + beyond) } else { (1.0 - v + beyond, v) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights of the second corner, and of the third near the diagonal on either side.
    #[test]
    fn weights_tell_the_half_that_was_hit() {
        for u in (0..=1000).map(|i| i as f32 / 1000.0) {
            for steps in -3..=3 {
                let v = (1.0 - u + steps as f32 * 6e-8).clamp(0.0, 1.0);
                for second in [false, true] {
                    let (on_u, on_v) = on_quad_half(u, v, second);
                    assert_eq!(on_u + on_v > 1.0, second, "{u} {v}");
                    assert!((on_u - u).abs() < 6e-7 && (on_v - v).abs() < 6e-7, "{u} {v}");
                    assert!(on_u.max(on_v) <= 1.0 && on_u.min(on_v) >= 0.0, "{u} {v}");
                }
            }
        }
    }
}
