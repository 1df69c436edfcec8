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

    /// Whether any lane counts.
    #[inline(always)]
    pub fn any(&self) -> bool {
        self.0.iter().fold(0, |all, &lane| all | lane) != 0
    }

    /// Number of lanes that count.
    #[inline(always)]
    pub fn count(&self) -> u32 {
        self.0.iter().fold(0, |n, &lane| n - lane) as u32
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
    /// Unused (0).
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
}
