//! Packets of 16 rays as structures of arrays, laid out exactly as Embree's `RTCRay16` and
//! `RTCRayHit16` (Embree >= 4.3), so that nothing is copied on the way in or out.

/// No primitive, no geometry (Embree's `RTC_INVALID_GEOMETRY_ID`).
pub const NONE: u32 = u32::MAX;

/// Rays per packet.
pub const LANES: usize = 16;

/// Which lanes of a packet count: -1 yes, 0 no.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C, align(64))]
pub struct Mask(pub [i32; LANES]);

impl Mask {
    /// No lane.
    pub const NONE: Self = Self([0; LANES]);

    /// Every lane.
    pub const ALL: Self = Self([-1; LANES]);

    /// Whether any lane counts.
    #[inline(always)]
    pub fn any(&self) -> bool {
        self.0.iter().fold(0, |all, &lane| all | lane) != 0
    }

    /// These lanes and those of `other`.
    #[inline(always)]
    #[must_use]
    pub fn with(&self, other: &Self) -> Self {
        let mut joined = *self;
        for i in 0..LANES {
            joined.0[i] |= other.0[i];
        }
        joined
    }

    /// These lanes, but not those of `other`.
    #[inline(always)]
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        let mut rest = *self;
        for i in 0..LANES {
            rest.0[i] &= !other.0[i];
        }
        rest
    }

    /// The first lane that counts; 0 if none does.
    #[inline(always)]
    pub fn first(&self) -> usize {
        let mut bits = 0;
        for i in 0..LANES {
            bits |= self.0[i] & (1 << i);
        }
        bits.trailing_zeros() as usize % LANES
    }

    /// Number of lanes that count.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        self.0.iter().fold(0_i32, |n, &lane| n.wrapping_add(lane)).unsigned_abs()
    }
}

/// 16 rays `org + t dir`, t in (`tnear`, `tfar`); coordinates relative to the scene's origin.
///
/// Directions need not be unit length. An occluded ray gets `tfar` = -inf.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Rays {
    /// Origins: x, y, z.
    pub org: [[f32; LANES]; 3],
    /// Start of the segment, >= 0.
    pub tnear: [f32; LANES],
    /// Directions: x, y, z.
    pub dir: [[f32; LANES]; 3],
    /// Room for a backend.
    pub time: [f32; LANES],
    /// End of the segment; a hit puts its t here.
    pub tfar: [f32; LANES],
    /// All ones.
    pub mask: [u32; LANES],
    /// The primitive number (of [`crate::geometry::Geometry::primitive`]) that the ray leaves and
    /// so cannot meet again, or [`NONE`].
    pub leaving: [u32; LANES],
    /// Unused (0).
    pub flags: [u32; LANES],
}

impl Rays {
    /// Rays of no direction that end at infinity.
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

    /// The active lanes whose rays can meet anything: finite origin and direction, a direction
    /// that is not zero (nor denormal), `tnear <= tfar`. A NaN in one lane can make a packet's
    /// bounds useless for all of them. The renderer's own rays are possible by construction; rays
    /// from anywhere else are masked with this first.
    #[inline(always)]
    pub fn possible(&self, active: &Mask) -> Mask {
        let ([ox, oy, oz], [dx, dy, dz]) = (&self.org, &self.dir);
        let mut possible = *active;
        for i in 0..LANES {
            let origin = ox[i].abs() + oy[i].abs() + oz[i].abs();
            let direction = dx[i].abs() + dy[i].abs() + dz[i].abs();
            // NaN fails every comparison.
            let sound = (origin <= f32::MAX)
                & (f32::MIN_POSITIVE..=f32::MAX).contains(&direction)
                & (self.tnear[i] <= self.tfar[i]);
            possible.0[i] &= -i32::from(sound);
        }
        possible
    }
}

/// What 16 rays hit.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Hits {
    /// Geometric normal of the backend, any length, not turned.
    pub ng: [[f32; LANES]; 3],
    /// Barycentric weight of the second corner.
    pub u: [f32; LANES],
    /// Barycentric weight of the third corner.
    pub v: [f32; LANES],
    /// Primitive within its geometry.
    pub prim: [u32; LANES],
    /// Geometry, or [`NONE`] for a miss.
    pub geom: [u32; LANES],
    /// Unused.
    pub instance: [u32; LANES],
    /// Unused.
    pub instance_prim: [u32; LANES],
}

impl Hits {
    /// No hits.
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

/// 16 rays and what they hit.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct RayPacket {
    /// The rays.
    pub rays: Rays,
    /// Their closest hits.
    pub hits: Hits,
}

impl RayPacket {
    /// No rays, no hits.
    pub const EMPTY: Self = Self { rays: Rays::EMPTY, hits: Hits::EMPTY };

    /// The active lanes that hit anything.
    #[inline(always)]
    pub fn hit(&self, active: &Mask) -> Mask {
        let mut hit = Mask::NONE;
        for i in 0..LANES {
            hit.0[i] = active.0[i] & -i32::from(self.hits.geom[i] != NONE);
        }
        hit
    }

    /// Forgets the hits.
    #[inline(always)]
    pub fn clear_hits(&mut self) {
        self.hits.geom = [NONE; LANES];
    }
}

/// What the caller knows of a packet's rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coherence {
    /// They take much the same path: camera rays, shadow rays of neighbours.
    Coherent,
    /// They do not.
    Incoherent,
    /// As [`Coherence::Incoherent`], and every lane is traced alone, with the backend's query for one
    /// ray: what a measurement of single rays asks for.
    Single,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_rays_are_told_apart() {
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
        let mut active = Mask([-1; LANES]);
        active.0[15] = 0;
        let expected = std::array::from_fn(|i| -i32::from(i == 0 || (10..15).contains(&i)));
        assert_eq!(rays.possible(&active), Mask(expected));
    }
}
