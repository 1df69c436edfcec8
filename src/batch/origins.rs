//! Groups the frames of an input by their origin of coordinates.
//!
//! A frame has the origin that a render of its own camera alone would have, whatever other frames
//! the batch has. Usually this is the middle of the scene for all frames, and they share one world.
//! In a scene that is huge compared with a camera's distance it is the camera, and the frame has a
//! world of its own.
//!
//! The frames of a turntable share the origin of the turntable's scene, unless rounding would then
//! be visible. Otherwise a large ground would cost a world for each frame.

use crate::error::Problem;
use crate::world::{Origin, View};

/// Frames with the same origin.
#[derive(Debug, Default)]
pub struct Group {
    /// Indices of the frames, ascending.
    pub frames: Vec<usize>,
    /// The origin as the frame sees it that suffers most from rounding.
    worst: Option<Origin>,
}

impl Group {
    fn add(&mut self, frame: usize, origin: Origin) {
        self.frames.push(frame);
        self.worst = self.worst.filter(|worst| worst.pixels > origin.pixels).or(Some(origin));
    }

    /// Returns a warning if the rounding is visible in a frame.
    pub fn warning(&self) -> Option<Problem> {
        self.worst.and_then(|worst| worst.warning())
    }
}

/// Returns the frames that the loaded world serves, and the groups that need another world.
/// `views` has the frames' views of the loaded world. `turntable` says that the frames are those of
/// a turntable, whose scene was loaded. The first group may be empty.
pub fn groups(views: &[View], turntable: bool) -> (Group, Vec<Group>) {
    let (mut here, mut others) = (Group::default(), Vec::<Group>::new());
    for (frame, view) in views.iter().enumerate() {
        if view.is_own() || turntable && view.here.warning().is_none() {
            here.add(frame, view.here);
            continue;
        }
        let same = |group: &&mut Group| {
            group.worst.is_some_and(|worst| worst.position == view.own.position)
        };
        match others.iter_mut().find(same) {
            Some(group) => group.add(frame, view.own),
            None => {
                let mut group = Group::default();
                group.add(frame, view.own);
                others.push(group);
            }
        }
    }
    (here, others)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn origin(x: f64, pixels: f64) -> Origin {
        let position = DVec3::X * x;
        let (at_camera, parallel) = (true, false);
        let (extent, nearest, rounding) = (1e9, 1.0, 1.0);
        Origin { position, at_camera, extent, nearest, rounding, pixels, parallel }
    }

    fn views(all: &[(f64, f64)]) -> Vec<View> {
        let view =
            |&(own, pixels): &(f64, f64)| View { own: origin(own, 0.0), here: origin(0.0, pixels) };
        all.iter().map(view).collect()
    }

    fn frames(groups: (Group, Vec<Group>)) -> (Vec<usize>, Vec<Vec<usize>>) {
        (groups.0.frames, groups.1.into_iter().map(|group| group.frames).collect())
    }

    #[test]
    fn frames_of_a_list_have_their_own_origin() {
        let all = views(&[(0.0, 0.0), (1.0, 0.0), (2.0, 9.0), (1.0, 9.0), (0.0, 0.0)]);
        assert_eq!(frames(groups(&all, false)), (vec![0, 4], vec![vec![1, 3], vec![2]]));
        let (_, others) = groups(&all, false);
        assert!(others.iter().all(|group| group.warning().is_none()));
    }

    #[test]
    fn frames_of_a_turntable_share_an_origin_where_rounding_is_invisible() {
        let all = views(&[(0.0, 0.0), (1.0, 0.0), (2.0, 9.0), (1.0, 9.0), (0.0, 9.0)]);
        let (here, others) = groups(&all, true);
        assert!(here.warning().is_some(), "no other origin is better for the last frame");
        assert_eq!(frames((here, others)), (vec![0, 1, 4], vec![vec![2], vec![3]]));
    }
}
