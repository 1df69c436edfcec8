//! The curve between stored values and linear light, as a PNG's `gAMA` chunk defines it.

use super::srgb;

/// Encoding of stored values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StoredCurve {
    /// The sRGB curve.
    Srgb,
    /// A stored value raised to this power is linear.
    Power(f64),
}

/// Returns the value of a PNG's `gAMA` chunk, `None` with an `sRGB` chunk.
pub fn gamma(info: &png::Info) -> Option<f64> {
    let gamma = info.gama_chunk.filter(|_| info.srgb.is_none())?;
    Some(f64::from(gamma.into_scaled()) / 1e5)
}

impl StoredCurve {
    /// Stored values are linear light.
    pub const LINEAR: Self = Self::Power(1.0);

    /// Returns the curve of a PNG whose [`gamma`] is this. A gamma of 1 / 2.2 is a common
    /// approximation of sRGB, and 0 is none.
    pub fn of_gamma(gamma: f64) -> Self {
        let is_srgb = gamma <= 0.0 || (gamma - 1.0 / 2.2).abs() < 1e-3;
        if is_srgb { Self::Srgb } else { Self::Power(1.0 / gamma) }
    }

    /// Returns the linear value of a stored value.
    pub fn to_linear(self, value: f64) -> f64 {
        match self {
            Self::Srgb => srgb::to_linear(value),
            Self::LINEAR => value,
            Self::Power(power) => value.powf(power),
        }
    }
}
