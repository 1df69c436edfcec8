//! Multipole expansion of the solid angle of distant triangles.
//!
//! Source: Barill, Dickson, Schmidt, Levin and Jacobson 2018, "Fast Winding Numbers for Soups and
//! Clouds", ACM TOG 37(4): the dipole with its first and second moments. Without the first, the two
//! sides of a thin wall would cancel out; without the second, a sphere's errors would add up in its
//! middle.

use glam::DVec3;

/// Sums over triangles. `n` is the normal of a triangle with the length of its area, and `d` the
/// way from `center`.
///
/// Only the symmetric part of a moment matters. So it is kept as a polynomial: the first moment is
/// the sum of `(n.r)(d.r)`, the second that of `(n.r)(d.r)^2`, for any vector `r` = (x, y, z).
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    /// Mean position, weighted by area.
    center: DVec3,
    /// Sum of `n`.
    normal: DVec3,
    /// Sum of the areas.
    area: f64,
    /// Largest distance of a vertex from `center`, or a bound of it.
    radius: f64,
    /// Factors of xx, yy, zz, xy, xz, yz.
    first: [f64; 6],
    /// Factors of xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz.
    second: [f64; 10],
}

impl Moments {
    /// The moments of triangles.
    pub fn of_triangles(all: &[[DVec3; 3]]) -> Self {
        let moments = Self::sum(&all.iter().map(Self::of_triangle).collect::<Vec<_>>());
        let far = all.iter().flatten().map(|&v| (v - moments.center).length());
        Self { radius: far.fold(0.0, f64::max), ..moments }
    }

    /// The moments of all parts together.
    pub fn of_parts(parts: &[Self]) -> Self {
        let moments = Self::sum(parts);
        let used = parts.iter().filter(|part| part.area > 0.0);
        let far = used.map(|part| (part.center - moments.center).length() + part.radius);
        Self { radius: far.fold(0.0, f64::max), ..moments }
    }

    /// All but the radius.
    fn of_triangle(corners: &[DVec3; 3]) -> Self {
        let [a, b, c] = *corners;
        let (normal, center) = ((b - a).cross(c - a) * 0.5, (a + b + c) / 3.0);
        let mut moments = Self { center, normal, area: normal.length(), ..Self::default() };
        // The mean of d d^T over a triangle is a twelfth of the sum over its corners.
        for corner in corners {
            moments.add_second(normal / 12.0, [0.0; 6], corner - center);
        }
        moments
    }

    /// All but the radius.
    fn sum(parts: &[Self]) -> Self {
        let mut sum = Self::default();
        for part in parts {
            sum.normal += part.normal;
            sum.area += part.area;
            sum.center += part.center * part.area;
        }
        sum.center = if sum.area > 0.0 { sum.center / sum.area } else { DVec3::ZERO };
        for part in parts.iter().filter(|part| part.area > 0.0) {
            let way = part.center - sum.center;
            add(&mut sum.first, part.first);
            add(&mut sum.first, product(part.normal, way));
            add(&mut sum.second, part.second);
            sum.add_second(part.normal, part.first, way);
        }
        sum
    }

    /// Adds to the second moment what moving triangles by `way` adds to theirs. `normal` and
    /// `first` are their sums before.
    fn add_second(&mut self, normal: DVec3, first: [f64; 6], way: DVec3) {
        // (n.r)(d.r + s.r)^2 - (n.r)(d.r)^2 = (2 (n.r)(d.r) + (n.r)(s.r)) (s.r)
        let mut form = product(normal, way);
        add(&mut form, first.map(|x| 2.0 * x));
        let ([xx, yy, zz, xy, xz, yz], [x, y, z]) = (form, way.to_array());
        let own = [
            xx * x,
            yy * y,
            zz * z,
            xx * y + xy * x,
            xx * z + xz * x,
            yy * x + xy * y,
            yy * z + yz * y,
            zz * x + xz * z,
            zz * y + yz * z,
            xy * z + xz * y + yz * x,
        ];
        add(&mut self.second, own);
    }
}

fn add<const N: usize>(sum: &mut [f64; N], terms: [f64; N]) {
    for (sum, term) in sum.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// The polynomial (a.r)(b.r).
fn product(a: DVec3, b: DVec3) -> [f64; 6] {
    let ([a, b, c], [x, y, z]) = (a.to_array(), b.to_array());
    [a * x, b * y, c * z, a * y + b * x, a * z + c * x, b * z + c * y]
}

/// [`Moments`] for the solid angle from afar.
#[derive(Debug, Clone, Copy, Default)]
pub struct Multipole {
    center: DVec3,
    area: f64,
    radius: f64,
    /// In units of `area`.
    normal: [f32; 3],
    /// In units of `area` times `radius`.
    first: [f32; 6],
    /// In units of `area` times the square of `radius`.
    second: [f32; 10],
}

impl From<Moments> for Multipole {
    fn from(moments: Moments) -> Self {
        let Moments { center, normal, area, radius, first, second } = moments;
        let unit = |size: f64| {
            let unit = 1.0 / size;
            if unit.is_finite() { unit } else { 0.0 }
        };
        let [a, b, c] = [area, area * radius, area * radius * radius].map(unit);
        Self {
            center,
            area,
            radius,
            normal: (normal * a).as_vec3().to_array(),
            first: first.map(|x| (x * b) as f32),
            second: second.map(|x| (x * c) as f32),
        }
    }
}

impl Multipole {
    /// The solid angle from a point, in steradians. 0 without triangles; `None` if the distance is
    /// not above `far` times the radius.
    #[inline(always)]
    pub fn solid_angle(&self, point: DVec3, far: f64) -> Option<f64> {
        if self.area == 0.0 {
            return Some(0.0);
        }
        let to = self.center - point;
        let squared = to.length_squared();
        let near = far * self.radius;
        if squared <= near * near {
            return None;
        }
        let shrink = 1.0 / squared.sqrt();
        let [x, y, z] = (to * shrink).as_vec3().to_array();
        let size = (self.radius * shrink) as f32;
        // Derivatives of 1 / |r|, for a unit vector r.
        let [nx, ny, nz] = self.normal;
        let [xx, yy, zz, xy, xz, yz] = self.first;
        let form = x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + zz * z * z;
        let first = xx + yy + zz - 3.0 * form;
        let [xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz] = self.second;
        let form = x * x * (xxx * x + xxy * y + xxz * z)
            + y * y * (yyy * y + yyz * z + xyy * x)
            + z * z * (zzz * z + xzz * x + yzz * y)
            + xyz * x * y * z;
        let trace =
            x * (3.0 * xxx + xyy + xzz) + y * (3.0 * yyy + xxy + yzz) + z * (3.0 * zzz + xxz + yyz);
        let second = 7.5 * form - 1.5 * trace;
        let sum = nx * x + ny * y + nz * z + size * (first + size * second);
        Some(f64::from(sum) * self.area / squared)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Triangles of a patch of the unit sphere: the projection of a square at a distance of 1.
    fn patch(size: f64) -> Vec<[DVec3; 3]> {
        let at = |i: usize, j: usize| {
            let way = |k: usize| size * (k as f64 / 16.0 - 0.5);
            DVec3::new(way(i), way(j), 1.0).normalize()
        };
        let squares = (0..16).flat_map(|i| (0..16).map(move |j| (i, j)));
        squares
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect()
    }

    /// The solid angle of a square of this side, seen from a distance of 1 in front of its middle.
    fn exact(size: f64) -> f64 {
        let half = 0.5 * size;
        4.0 * (half * half / (1.0 + 2.0 * half * half).sqrt()).atan()
    }

    #[test]
    fn moments_of_parts_are_those_of_the_whole() {
        let all = patch(0.7);
        let whole = Moments::of_triangles(&all);
        let parts: Vec<_> = all.chunks(37).map(Moments::of_triangles).collect();
        let joined = Moments::of_parts(&parts);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{whole:?} {joined:?}");
        whole.first.into_iter().zip(joined.first).for_each(|(a, b)| near(a, b));
        whole.second.into_iter().zip(joined.second).for_each(|(a, b)| near(a, b));
        assert!(joined.radius >= whole.radius && whole.second.iter().any(|x| x.abs() > 1e-3));
    }

    #[test]
    fn errors_fall_with_the_fourth_power_of_the_size() {
        // The error in units of the solid angle: fourth derivatives are what is left.
        let error = |size: f64| {
            let pole = Multipole::from(Moments::of_triangles(&patch(size)));
            let found = pole.solid_angle(DVec3::ZERO, 2.0).expect("a distant patch");
            assert_eq!(pole.solid_angle(DVec3::ZERO, 20.0), None);
            (found / exact(size) - 1.0).abs()
        };
        let [large, small] = [0.4, 0.2].map(error);
        assert!(large < 5e-4 && small < large / 14.0, "{large} {small}");
        // A side of a cube.
        assert!((exact(2.0) - 4.0 * PI / 6.0).abs() < 1e-12);
    }

    #[test]
    fn sizes_do_not_matter() {
        let pole = |scale: f64| {
            let all: Vec<_> = patch(0.3).iter().map(|t| t.map(|v| v * scale)).collect();
            let pole = Multipole::from(Moments::of_triangles(&all));
            pole.solid_angle(DVec3::new(0.0, 0.1, 0.2) * scale, 2.0).expect("a distant patch")
        };
        for scale in [1e-60, 1e-30, 1e18] {
            assert!((pole(scale) / pole(1.0) - 1.0).abs() < 1e-6, "{scale}");
        }
        let point = Multipole::from(Moments::of_triangles(&[[DVec3::ONE; 3]]));
        assert_eq!(point.solid_angle(DVec3::ONE, 2.0), Some(0.0));
    }
}
