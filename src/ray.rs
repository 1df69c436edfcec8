//! Packets of 16 rays and their hits, as structures of arrays. The layout is exactly
//! Embree's `RTCRay16` and `RTCRayHit16` (Embree >= 4.3), so that nothing is copied.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Index that stands for no primitive or no geometry (Embree's `RTC_INVALID_GEOMETRY_ID`).
pub const NONE: u32 = u32::MAX;

/// Number of rays per packet.
pub const LANES: usize = 16;

/// Kind of a ray, by its start and purpose. A shape may be visible to some kinds only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayKind {
    /// From the camera.
    Camera,
    /// From a surface to a light.
    Shadow,
    /// From a mirror.
    Reflection,
}

impl RayKind {
    /// All kinds, in the order of their discriminants.
    pub const ALL: [Self; 3] = [Self::Camera, Self::Shadow, Self::Reflection];
}

/// A set of lanes: -1 for a lane in the set, 0 for any other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C, align(64))]
pub struct Mask(pub [i32; LANES]);

impl Mask {
    /// The empty set.
    pub const NONE: Self = Self([0; LANES]);

    /// The set of all lanes.
    pub const ALL: Self = Self([-1; LANES]);

    /// Returns true if the set contains any lane.
    #[inline(always)]
    pub fn any(&self) -> bool {
        self.0.iter().fold(0, |all, &lane| all | lane) != 0
    }

    /// Difference: the lanes of this set that are not in `other`.
    #[inline(always)]
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        let mut rest = *self;
        for i in 0..LANES {
            rest.0[i] &= !other.0[i];
        }
        rest
    }

    /// Intersection: the lanes that are also in `other`.
    #[inline(always)]
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        let mut both = *self;
        for i in 0..LANES {
            both.0[i] &= other.0[i];
        }
        both
    }

    /// First lane of the set; 0 if it is empty.
    #[inline(always)]
    pub fn first(&self) -> usize {
        let mut bits = 0;
        for i in 0..LANES {
            bits |= self.0[i] & (1 << i);
        }
        bits.trailing_zeros() as usize % LANES
    }

    /// Number of lanes in the set.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        self.0.iter().fold(0_i32, |n, &lane| n.wrapping_add(lane)).unsigned_abs()
    }
}

/// Returns the vector of lane `i`.
#[inline(always)]
pub fn lane(v: &[[f32; LANES]; 3], i: usize) -> Vec3 {
    Vec3::new(v[0][i], v[1][i], v[2][i])
}

/// Sets the vector of lane `i`.
#[inline(always)]
pub fn set_lane(v: &mut [[f32; LANES]; 3], i: usize, value: Vec3) {
    (v[0][i], v[1][i], v[2][i]) = (value.x, value.y, value.z);
}

/// 16 rays `org + t dir`, t in (`tnear`, `tfar`), with coordinates relative to the scene's origin.
///
/// Directions need not have unit length. An occluded ray gets `tfar` = -inf.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Rays {
    /// Origins, by axis and lane.
    pub org: [[f32; LANES]; 3],
    /// Start of the segment; >= 0.
    pub tnear: [f32; LANES],
    /// Directions, by axis and lane.
    pub dir: [[f32; LANES]; 3],
    /// Scratch space for a backend (Embree's ray time).
    pub time: [f32; LANES],
    /// End of the segment; a hit stores its t here.
    pub tfar: [f32; LANES],
    /// Embree's ray mask: all bits set.
    pub mask: [u32; LANES],
    /// Index ([`crate::geometry::Geometry::primitive`]) of the primitive that the ray leaves, or
    /// [`NONE`]. The ray does not hit that primitive at its origin.
    pub leaving: [u32; LANES],
    /// Embree's ray flags: unused, 0.
    pub flags: [u32; LANES],
}

impl Rays {
    /// Rays without direction and without end.
    pub const EMPTY: Self = Self {
        org: [[0.0; LANES]; 3],
        tnear: [0.0; LANES],
        dir: [[0.0; LANES]; 3],
        time: [0.0; LANES],
        tfar: [f32::INFINITY; LANES],
        mask: [u32::MAX; LANES],
        leaving: [NONE; LANES],
        flags: [0; LANES],
    };

    /// Sets origin and direction of ray `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, origin: Vec3, direction: Vec3) {
        set_lane(&mut self.org, i, origin);
        set_lane(&mut self.dir, i, direction);
    }

    /// Returns the active lanes whose rays can hit anything: finite origin and direction, direction
    /// neither zero nor denormal, `tnear <= tfar`. A NaN in one lane can make a packet's bounds
    /// useless for all lanes. The renderer's own rays are valid by construction. Mask rays of a
    /// caller with this function first.
    #[inline(always)]
    pub fn possible(&self, active: &Mask) -> Mask {
        let ([ox, oy, oz], [dx, dy, dz]) = (&self.org, &self.dir);
        let mut possible = *active;
        for i in 0..LANES {
            let origin = ox[i].abs() + oy[i].abs() + oz[i].abs();
            let direction = dx[i].abs() + dy[i].abs() + dz[i].abs();
            // A NaN fails every comparison.
            let sound = (origin <= f32::MAX)
                & (f32::MIN_POSITIVE..=f32::MAX).contains(&direction)
                & (self.tnear[i] <= self.tfar[i]);
            possible.0[i] &= -i32::from(sound);
        }
        possible
    }
}

/// Hits of 16 rays.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Hits {
    /// Geometric normal from the backend: any length, on either side.
    pub ng: [[f32; LANES]; 3],
    /// Barycentric weight of the second corner.
    pub u: [f32; LANES],
    /// Barycentric weight of the third corner.
    pub v: [f32; LANES],
    /// Index of the primitive within its geometry.
    pub prim: [u32; LANES],
    /// Index of the geometry, or [`NONE`] for a miss.
    pub geom: [u32; LANES],
    /// Unused; part of Embree's layout.
    pub instance: [u32; LANES],
    /// Unused; part of Embree's layout.
    pub instance_prim: [u32; LANES],
}

impl Hits {
    /// Misses in all lanes.
    pub const EMPTY: Self = Self {
        ng: [[0.0; LANES]; 3],
        u: [0.0; LANES],
        v: [0.0; LANES],
        prim: [NONE; LANES],
        geom: [NONE; LANES],
        instance: [NONE; LANES],
        instance_prim: [NONE; LANES],
    };
}

/// 16 rays and their hits.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct RayPacket {
    /// The rays to trace.
    pub rays: Rays,
    /// Closest hits of the rays.
    pub hits: Hits,
}

impl RayPacket {
    /// A packet without rays or hits.
    pub const EMPTY: Self = Self { rays: Rays::EMPTY, hits: Hits::EMPTY };

    /// Returns the active lanes that have a hit.
    #[inline(always)]
    pub fn hit(&self, active: &Mask) -> Mask {
        let mut hit = Mask::NONE;
        for i in 0..LANES {
            hit.0[i] = active.0[i] & -i32::from(self.hits.geom[i] != NONE);
        }
        hit
    }

    /// Turns all lanes into misses. `tfar` and the other fields keep their values.
    #[inline(always)]
    pub fn clear_hits(&mut self) {
        self.hits.geom = [NONE; LANES];
    }
}

/// How similar the rays of a packet are. It selects how a backend traverses its tree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coherence {
    /// Similar paths: camera rays, or shadow rays of neighbouring points.
    Coherent,
    /// Different paths that start near each other, as mirrored rays do: what one ray visits, the
    /// next finds in the cache. `bvh` traces one ray after the other.
    Incoherent,
    /// Rays that may have nothing in common, so that most visits wait for memory. In `bvh` several
    /// rays take turns for occlusion, and in large trees for closest hits. Embree treats them as
    /// [`Coherence::Incoherent`].
    Unordered,
    /// One ray after the other, with the backend's query for single rays. For measurements of
    /// single rays.
    Single,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn possible_rejects_invalid_rays() {
        let mut rays = Rays::EMPTY;
        rays.dir[2] = [1.0; LANES];
        rays.dir[2][1] = 0.0;
        rays.dir[0][2] = f32::NAN;
        rays.dir[1][3] = f32::NEG_INFINITY;
        rays.org[1][4] = f32::NAN;
        rays.org[2][5] = f32::INFINITY;
        rays.tfar[6] = f32::NAN;
        rays.tnear[7] = f32::NAN;
        (rays.tnear[8], rays.tfar[8]) = (2.0, 1.0);
        rays.dir[2][9] = 1e-40;
        let mut active = Mask::ALL;
        active.0[15] = 0;
        let expected = std::array::from_fn(|i| -i32::from(i == 0 || (10..15).contains(&i)));
        assert_eq!(rays.possible(&active), Mask(expected));
    }
}
