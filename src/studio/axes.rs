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

/// Returns the `rotate` angles that turn an axis of the mesh to the axis of the scene nearest to
/// `up`, or to its opposite if `up` points there. The opposite shows the same side of the mesh
/// upside down, to a camera that looks along y (if z is up) or along z.
pub fn turn(from: Axis, up: DVec3) -> [f64; 3] {
    let to = main_axis(up);
    let mut angles = quarter_turns(from, to);
    if up[to] < 0.0 {
        let angle = &mut angles[if to == 2 { 1 } else { 2 }];
        *angle = if *angle > 0.0 { *angle - 180.0 } else { *angle + 180.0 };
    }
    angles
}

fn quarter_turns(from: Axis, to: usize) -> [f64; 3] {
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
                for up in [DVec3::AXES[to], -DVec3::AXES[to]] {
                    let turned = rotation(from, up) * DVec3::AXES[i];
                    assert!((turned - up).length() < 1e-12, "{from:?} {up}");
                }
            }
        }
    }

    fn rotation(from: Axis, up: DVec3) -> DMat3 {
        let [x, y, z] = turn(from, up).map(f64::to_radians);
        DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x)
    }

    #[test]
    fn a_camera_upside_down_sees_the_same_side() {
        for from in [Axis::X, Axis::Y, Axis::Z] {
            for (up, forward) in [(DVec3::Y, DVec3::Z), (DVec3::Z, DVec3::Y), (DVec3::X, DVec3::Z)]
            {
                let [front, same] = [up, -up].map(|up| rotation(from, up).transpose() * forward);
                assert!((front - same).length() < 1e-12, "{from:?} {up}");
            }
        }
    }

    #[test]
    fn main_axis_is_the_largest_component() {
        assert_eq!(main_axis(DVec3::new(0.1, -3.0, 2.0)), 1);
        assert_eq!(main_axis(DVec3::Z), 2);
    }
}
