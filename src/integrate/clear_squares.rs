//! Finds squares of pixels from whose first hits nothing occludes a light, once for all packets of
//! the square. Such squares show a part of one large primitive, such as a floor.

use glam::Vec3;

use super::camera_packet::CameraPacket;
use super::skips::Skips;
use super::tile_grid::{LEVELS, TILE};
use crate::accel::{Accelerator, Shaft};
use crate::ray::{LANES, Mask, NONE};
use crate::shading::{Emitter, ShadowPoints, lane, set_lane};
use crate::world::World;

/// Fewest camera rays in a square for which a query pays off.
const MIN_RAYS: u64 = 256;

/// Most lights for which squares are kept.
const MAX_LIGHTS: usize = 16;

/// How far the box of a square is widened, relative to its largest side.
const WIDENED: f32 = 1.0 / 64.0;

/// For each light and each size of squares, the last square.
#[derive(Debug, Default)]
pub struct ClearSquares {
    by_light: Vec<[Square; LEVELS]>,
    /// Number of square sizes, from the largest, that are worth a query.
    levels: usize,
}

/// The last square of one size.
#[derive(Debug, Clone, Copy)]
struct Square {
    corner: [u32; 2],
    /// The primitive from which nothing occludes the light, inside the box from `low` to `high`.
    /// [`NONE`] if there is none.
    primitive: u32,
    low: [f32; 3],
    high: [f32; 3],
    skips: Skips,
}

impl ClearSquares {
    /// Creates the state for the lights of a world.
    pub fn new(world: &World) -> Self {
        let camera = &world.camera;
        // The box of a square is made from the pinhole rays through its corners.
        let pinhole = !camera.has_lens() && camera.general_projection().is_none();
        if world.lights.len() > MAX_LIGHTS || !pinhole {
            return Self::default();
        }
        let worth = |level: &usize| {
            let side = u64::from(TILE >> level);
            side * side * u64::from(world.spp) >= MIN_RAYS
        };
        let empty = Square {
            corner: [NONE; 2],
            primitive: NONE,
            low: [0.0; 3],
            high: [0.0; 3],
            skips: Skips::default(),
        };
        let levels = (0..LEVELS).filter(worth).count();
        Self { by_light: vec![[empty; LEVELS]; world.lights.len()], levels }
    }

    /// Returns true only if nothing occludes the rays from the first hits in `active` to light
    /// `index`, because a clear square holds all of them.
    #[inline(always)]
    pub fn hold(
        &mut self,
        scene: (&World, &dyn Accelerator),
        (camera_packet, points, active): (&CameraPacket, &ShadowPoints, &Mask),
        (index, emitter): (u32, &Emitter),
    ) -> bool {
        let Some(squares) = self.by_light.get_mut(index as usize) else { return false };
        for (level, square) in squares.iter_mut().enumerate().take(self.levels) {
            let side = TILE >> level;
            let corner = camera_packet.corner.map(|x| x / side * side);
            if square.corner != corner {
                square.corner = corner;
                square.primitive = NONE;
                if square.skips.next() {
                    continue;
                }
                if square.query(side, scene, (points, active), emitter).is_none() {
                    self.levels = 0;
                    return false;
                }
            }
            if square.primitive != NONE && square.holds(points, active) {
                return true;
            }
        }
        false
    }
}

impl Square {
    /// Whether all shadow rays leave the primitive, inside the box. A ray with a lifted origin may
    /// hit its own primitive.
    #[inline(always)]
    fn holds(&self, points: &ShadowPoints, active: &Mask) -> bool {
        let mut outside = 0;
        for i in 0..LANES {
            let other = points.primitive[i] != self.primitive;
            outside |= active.0[i] & (points.lifted.0[i] | -i32::from(other));
        }
        for axis in 0..3 {
            let (low, high) = (self.low[axis], self.high[axis]);
            for i in 0..LANES {
                let x = points.origin[axis][i];
                let within = (x >= low) & (x <= high);
                outside |= active.0[i] & -i32::from(!within);
            }
        }
        outside == 0
    }

    /// Sets `primitive` to the primitive of the first hit, if nothing occludes the light from the
    /// part that the square shows. Returns `None` if the backend has no such query.
    #[cold]
    #[inline(never)]
    fn query(
        &mut self,
        side: u32,
        (world, accelerator): (&World, &dyn Accelerator),
        (points, active): (&ShadowPoints, &Mask),
        emitter: &Emitter,
    ) -> Option<()> {
        let bounds = self.bounds(side, world, points, active.first());
        if let (Some([low, high]), Some(corners)) = (bounds, emitter.corners()) {
            let mut origins = [[0.0; LANES]; 3];
            let mut ends = Mask::NONE;
            for i in 0..8 {
                let pick = |axis: usize| if (i >> axis) & 1 == 0 { low[axis] } else { high[axis] };
                set_lane(&mut origins, i, Vec3::new(pick(0), pick(1), pick(2)));
                ends.0[i] = -1;
            }
            let primitive = points.primitive[active.first()];
            let shaft = Shaft {
                active: ends,
                origins: &origins,
                leaving: [primitive; LANES],
                between: true,
                corners: &corners.map(|corner| corner.to_array()),
            };
            if accelerator.is_shaft_empty(&shaft)? {
                (self.low, self.high, self.primitive) =
                    (low.to_array(), high.to_array(), primitive);
            }
        }
        self.skips.record(self.primitive != NONE);
        Some(())
    }

    /// A box around the part that the square shows of the plane of hit `i`. [`Square::holds`] tests
    /// whether it holds other hits. `None` if the square shows the plane's horizon.
    fn bounds(
        &self,
        side: u32,
        world: &World,
        points: &ShadowPoints,
        i: usize,
    ) -> Option<[Vec3; 2]> {
        let (p, ng) = (lane(&points.position, i), lane(&points.ng, i));
        let origin = lane(&points.origin, i);
        let (mut low, mut high) = (origin.min(p), origin.max(p));
        let at = |pixel: u32| pixel.wrapping_sub(world.overscan) as i32 as f32;
        for [dx, dy] in [[0, 0], [side, 0], [0, side], [side, side]] {
            let [x, y] = [at(self.corner[0] + dx), at(self.corner[1] + dy)];
            let (eye, direction) = world.camera.pinhole_ray(x, y);
            let t = ng.dot(p - eye) / ng.dot(direction);
            if !(t > 0.0) {
                return None;
            }
            let hit = eye + direction * t;
            (low, high) = (low.min(hit), high.max(hit));
        }
        let size = low.abs().max(high.abs()).max_element();
        let margin = (high - low).max_element() * WIDENED + size * 4.0 * f32::EPSILON;
        let (low, high) = (low - margin, high + margin);
        (low.is_finite() && high.is_finite()).then_some([low, high])
    }
}
