//! Rotations from the axes of a mesh file to the axes of a scene.

use glam::DVec3;

use super::subject::Axis;

/// Returns the index (0, 1 or 2) of the axis nearest to `up` or to its opposite. Of equally near
/// axes, the lowest index wins.
pub fn main_axis(up: DVec3) -> usize {
    let size = up.abs();
    let wins = |a: usize| (0..3).all(|b| size[a] >= size[b]);
    (0..3).find(|a| wins(*a)).unwrap_or(1)
}

/// Returns the `rotate` angles that turn an axis of the mesh to an axis of the scene.
pub fn turn(from: Axis, to: usize) -> [f64; 3] {
    match (from, to) {
        (Axis::X, 1) => [0.0, 0.0, 90.0],
        (Axis::Z, 1) => [-90.0, 0.0, 0.0],
        (Axis::X, 2) => [0.0, -90.0, 0.0],
        (Axis::Y, 2) => [90.0, 0.0, 0.0],
        (Axis::Y, 0) => [0.0, 0.0, -90.0],
        (Axis::Z, 0) => [0.0, 90.0, 0.0],
        _ => [0.0; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    #[test]
    fn turn_maps_each_axis_of_the_mesh_to_each_axis_of_the_scene() {
        for (i, from) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
            for to in 0..3 {
                let [x, y, z] = turn(from, to).map(f64::to_radians);
                let turned = DMat3::from_rotation_z(z)
                    * DMat3::from_rotation_y(y)
                    * DMat3::from_rotation_x(x)
                    * DVec3::AXES[i];
                assert!((turned - DVec3::AXES[to]).length() < 1e-12, "{from:?} {to}");
            }
        }
    }

    #[test]
    fn main_axis_is_the_largest_component() {
        assert_eq!(main_axis(DVec3::new(0.1, -3.0, 2.0)), 1);
        assert_eq!(main_axis(DVec3::Z), 2);
    }
}
