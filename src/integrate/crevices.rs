//! Rays that leave points near an edge: what stands there is tested in f64 before anything is traced.

use glam::DVec3;

use crate::accel::Accelerator;
use crate::geometry::{Crevice, Geometry, Surfaces, TrianglePoint, hides, hit_triangle, refine};
use crate::ray::{Coherence, LANES, Mask, NONE, RayPacket, Rays};

/// How many hits of a ray are passed by at most before the next one counts.
const MAX_PASSED: usize = 64;

/// How many times a hit gives way to one that hides it.
const MAX_HIDING: usize = 8;

/// The points of a packet that lie near an edge of their primitive with something rising beside it.
#[derive(Debug, Default)]
pub struct Crevices {
    /// By lane; most packets have none.
    of: Vec<(usize, Crevice)>,
}

impl Crevices {
    /// Forgets the last packet's.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.of.clear();
    }

    /// Whether there are none.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.of.is_empty()
    }

    /// Finds those of the lanes `at_edge` of a traced packet, and moves the origins of their rays. A hit that another
    /// one of the same t hides from the viewer gives way to it.
    #[cold]
    #[inline(never)]
    pub fn find(
        &mut self,
        geometry: &Geometry,
        accelerator: &dyn Accelerator,
        packet: &mut RayPacket,
        surfaces: &mut Surfaces,
        at_edge: &Mask,
    ) {
        let scene = (geometry, accelerator);
        let at = |i: &usize| at_edge.0[*i] != 0;
        let mut neighbours = Vec::new();
        let hidden = (0..LANES).filter(at).filter(|&i| unhide(scene, packet, i, &mut neighbours));
        if hidden.count() > 0 {
            let hit = surfaces.hit;
            refine(geometry, &hit, packet, surfaces);
        }
        for i in (0..LANES).filter(at) {
            let Some((corners, point)) = near(scene, packet, i, &mut neighbours) else { continue };
            let lane = |v: &[[f32; LANES]; 3]| DVec3::from([0, 1, 2].map(|k| f64::from(v[k][i])));
            let (origin, ng) = ([0, 1, 2].map(|k| surfaces.outside[k][i]), lane(&surfaces.ng));
            // Turned to the viewer as the rounded one is.
            let normal = if point.normal.dot(ng) < 0.0 { -point.normal } else { point.normal };
            let own = (corners, normal, surfaces.primitive[i]);
            let crevice = Crevice::new(geometry, (point.position, origin), own, &neighbours);
            if let Some(crevice) = crevice {
                (0..3).for_each(|k| surfaces.outside[k][i] = crevice.origin[k]);
                self.of.push((i, crevice));
            }
        }
    }

    /// That of a lane.
    fn of(&self, lane: usize) -> Option<&Crevice> {
        self.of.iter().find(|(of, _)| *of == lane).map(|(_, crevice)| crevice)
    }

    /// [`Accelerator::occluded`] of shadow rays, of which ray `i` leaves the point of lane `from[i]`. What
    /// `passes` names does not stop the rays `grazing`.
    #[cold]
    #[inline(never)]
    pub fn occluded(
        &self,
        (geometry, accelerator): (&Geometry, &dyn Accelerator),
        active: &Mask,
        rays: &mut Rays,
        from: &[usize; LANES],
        (grazing, passes): (&Mask, &dyn Fn(u32) -> bool),
        coherence: Coherence,
    ) {
        let (mut rest, mut stopped) = (*active, Mask::NONE);
        for i in (0..LANES).filter(|&i| active.0[i] != 0) {
            let (crevice, is_grazing) = (self.of(from[i] % LANES), grazing.0[i] != 0);
            let way = direction(rays, i);
            let met =
                crevice.is_some_and(|crevice| crevice.meet(way, rays.tfar[i].into()).is_some());
            let is_clear = crevice.is_none_or(|crevice| crevice.is_clear) && !is_grazing;
            if is_clear && !met {
                continue;
            }
            rest.0[i] = 0;
            let passed = |primitive: u32| {
                let wall = crevice.is_some_and(|crevice| crevice.leaves(primitive, way));
                wall || (is_grazing && passes(primitive))
            };
            let is_stopped = met || {
                let mut packet = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
                pass(geometry, accelerator, &mut packet, i, passed)
            };
            stopped.0[i] = -i32::from(is_stopped);
        }
        if rest.any() {
            accelerator.occluded(&rest, rays, coherence);
        }
        for i in (0..LANES).filter(|&i| stopped.0[i] != 0) {
            rays.tfar[i] = f32::NEG_INFINITY;
        }
    }

    /// Traces the mirrored rays of the lanes that have a crevice. Returns these lanes, which are done, and those of
    /// them whose hits are certain, whatever a test in f32 makes of them.
    #[cold]
    #[inline(never)]
    pub fn closest(
        &self,
        geometry: &Geometry,
        accelerator: &dyn Accelerator,
        active: &Mask,
        packet: &mut RayPacket,
    ) -> (Mask, Mask) {
        let (mut done, mut certain) = (Mask::NONE, Mask::NONE);
        for (i, crevice) in self.of.iter().filter(|(i, _)| active.0[*i] != 0) {
            done.0[*i] = -1;
            let way = direction(&packet.rays, *i);
            let hit = crevice.meet(way, f64::INFINITY);
            // Something else may stand before the wall.
            packet.rays.tfar[*i] = hit.map_or(f32::INFINITY, |hit| hit.t as f32);
            let passed = |primitive| crevice.leaves(primitive, way);
            if pass(geometry, accelerator, packet, *i, passed) {
                continue;
            }
            if let Some(hit) = hit {
                let (geom, prim) = geometry.place(hit.primitive);
                (packet.hits.geom[*i], packet.hits.prim[*i]) = (geom, prim);
                (packet.hits.u[*i], packet.hits.v[*i]) = (hit.u, hit.v);
                certain.0[*i] = -1;
            }
        }
        (done, certain)
    }
}

/// The triangle that lane `i` hit and the point on it; into `neighbours` go the primitives around it. `None` for a
/// sphere.
fn near(
    (geometry, accelerator): (&Geometry, &dyn Accelerator),
    packet: &RayPacket,
    i: usize,
    neighbours: &mut Vec<u32>,
) -> Option<([DVec3; 3], TrianglePoint)> {
    let (corners, point) = hit_triangle(geometry, packet, i)?;
    neighbours.clear();
    let nearby = Crevice::nearby(point.position, corners);
    accelerator.near(geometry, &nearby, &mut |primitive| neighbours.push(primitive));
    Some((corners, point))
}

/// Replaces a hit by the one that hides it; returns whether there was one.
fn unhide(
    scene: (&Geometry, &dyn Accelerator),
    packet: &mut RayPacket,
    i: usize,
    neighbours: &mut Vec<u32>,
) -> bool {
    let mut was_hidden = false;
    for _ in 0..MAX_HIDING {
        let Some((corners, point)) = near(scene, packet, i, neighbours) else { break };
        let hit = scene.0.primitive(packet.hits.geom[i], packet.hits.prim[i]);
        // What the ray leaves is behind it.
        neighbours.retain(|&primitive| primitive != packet.rays.leaving[i]);
        let way = direction(&packet.rays, i);
        let Some(before) = hides(scene.0, point.position, (corners, hit), way, neighbours) else {
            break;
        };
        (packet.hits.geom[i], packet.hits.prim[i]) = scene.0.place(before.primitive);
        (packet.hits.u[i], packet.hits.v[i]) = (before.u, before.v);
        was_hidden = true;
    }
    was_hidden
}

/// Finds the closest hit of ray `i` alone that is not `passed` by; returns whether there is one.
fn pass(
    geometry: &Geometry,
    accelerator: &dyn Accelerator,
    packet: &mut RayPacket,
    i: usize,
    passed: impl Fn(u32) -> bool,
) -> bool {
    let mut only = Mask::NONE;
    only.0[i] = -1;
    let (tfar, mut seen) = (packet.rays.tfar[i], Vec::new());
    let (tnear, leaving) = (packet.rays.tnear[i], packet.rays.leaving[i]);
    let mut found = false;
    for _ in 0..MAX_PASSED {
        packet.rays.tfar[i] = tfar;
        packet.hits.geom[i] = NONE;
        accelerator.closest(&only, packet, Coherence::Single);
        if packet.hits.geom[i] == NONE {
            break;
        }
        let primitive = geometry.primitive(packet.hits.geom[i], packet.hits.prim[i]);
        if !passed(primitive) {
            found = true;
            break;
        }
        // Others may be met at the same t, so it alone is left out, until it comes again.
        if seen.contains(&primitive) {
            packet.rays.tnear[i] = packet.rays.tfar[i].max(packet.rays.tnear[i]);
        }
        seen.push(primitive);
        packet.rays.leaving[i] = primitive;
    }
    (packet.rays.tnear[i], packet.rays.leaving[i]) = (tnear, leaving);
    if !found {
        (packet.hits.geom[i], packet.rays.tfar[i]) = (NONE, tfar);
    }
    found
}

fn direction(rays: &Rays, i: usize) -> DVec3 {
    DVec3::from([0, 1, 2].map(|k| f64::from(rays.dir[k][i])))
}
