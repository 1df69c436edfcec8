//! Secondary rays from points near an edge. Walls, the triangles at the edge that rise above the
//! point's own, are tested in f64 before any ray is traced.

use glam::DVec3;

use crate::accel::Accelerator;
use crate::geometry::{
    Crevice, Geometry, Nearby, Surfaces, TrianglePoint, hides, hit_triangle, is_near, refine,
};
use crate::ray::{Coherence, LANES, Mask, NONE, RayKind, RayPacket, Rays, lane, set_lane};

/// Largest number of rejected hits along one ray; after that, the ray counts as a miss.
const MAX_PASSED: usize = 64;

/// Most times that a hit is replaced by one that hides it.
const MAX_HIDING: usize = 8;

/// The crevices of a packet: points near an edge of their primitive with a wall beside it.
#[derive(Debug, Default)]
pub struct Crevices {
    /// Lane and crevice; empty for most packets.
    by_lane: Vec<(usize, Crevice)>,
}

impl Crevices {
    /// Removes the crevices of the last packet.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.by_lane.clear();
    }

    /// Whether the packet has no crevices.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.by_lane.is_empty()
    }

    /// Finds the crevices of the lanes `at_edge` of a traced packet, and moves the origins of their
    /// secondary rays. First replaces each hit that another hit at the same t hides from the
    /// viewer. `kind` is the kind of the packet's rays. `accelerator` is for all kinds.
    #[cold]
    #[inline(never)]
    pub fn find(
        &mut self,
        (geometry, accelerator): (&Geometry, &dyn Accelerator),
        kind: RayKind,
        packet: &mut RayPacket,
        surfaces: &mut Surfaces,
        at_edge: &Mask,
    ) {
        let scene = (geometry, accelerator);
        let at = |i: &usize| at_edge.0[*i] != 0;
        let mut neighbours = Vec::new();
        let hidden = (0..LANES)
            .filter(at)
            .filter(|&i| replace_hidden_hit(scene, kind, packet, i, &mut neighbours));
        if hidden.count() > 0 {
            let hit = surfaces.hit;
            refine(geometry, &hit, packet, surfaces);
        }
        for i in (0..LANES).filter(at) {
            let Some((corners, point)) = near(scene, packet, i, &mut neighbours) else { continue };
            let origin = lane(&surfaces.outside, i).to_array();
            let ng = lane(&surfaces.ng, i).as_dvec3();
            // Turned to the viewer, like the rounded normal.
            let normal = if point.normal.dot(ng) < 0.0 { -point.normal } else { point.normal };
            let own = (corners, normal, surfaces.primitive[i]);
            let crevice = Crevice::new(geometry, (point.position, origin), own, &neighbours);
            if let Some(crevice) = crevice {
                set_lane(&mut surfaces.outside, i, crevice.origin.into());
                self.by_lane.push((i, crevice));
            }
        }
    }

    /// Crevice of a lane, if it has one.
    fn get(&self, lane: usize) -> Option<&Crevice> {
        self.by_lane.iter().find(|(i, _)| *i == lane).map(|(_, crevice)| crevice)
    }

    /// [`Accelerator::occluded`] for shadow rays; ray `i` starts at the point of lane `from[i]`.
    /// Primitives for which `passes` returns true do not occlude the `grazing` rays.
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
            let (crevice, is_grazing) = (self.get(from[i] % LANES), grazing.0[i] != 0);
            let way = direction(rays, i);
            let unseen = geometry.unseen(RayKind::Shadow);
            let occludes = |wall: u32| !(unseen.has(wall) || is_grazing && passes(wall));
            let hits_wall = crevice
                .is_some_and(|crevice| crevice.meet(way, rays.tfar[i].into(), occludes).is_some());
            let is_clear = crevice.is_none_or(|crevice| crevice.is_clear) && !is_grazing;
            if is_clear && !hits_wall {
                continue;
            }
            rest.0[i] = 0;
            let passed = |primitive: u32| {
                let wall = crevice.is_some_and(|crevice| crevice.leaves(primitive, way));
                wall || !occludes(primitive)
            };
            let is_stopped = hits_wall || {
                let mut packet = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
                closest_not_passed(geometry, accelerator, &mut packet, i, passed)
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

    /// Traces the mirrored rays of the lanes that have a crevice. Returns these lanes, and the
    /// subset whose hits are certain even if a test in f32 rejects them.
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
        for (i, crevice) in self.by_lane.iter().filter(|(i, _)| active.0[*i] != 0) {
            done.0[*i] = -1;
            let way = direction(&packet.rays, *i);
            let unseen = geometry.unseen(RayKind::Reflection);
            let hit = crevice.meet(way, f64::INFINITY, |wall| !unseen.has(wall));
            // Something else may lie in front of the wall.
            packet.rays.tfar[*i] = hit.map_or(f32::INFINITY, |hit| hit.t as f32);
            let passed = |primitive| crevice.leaves(primitive, way);
            if closest_not_passed(geometry, accelerator, packet, *i, passed) {
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

/// Returns the triangle that lane `i` hit and the point on it; `None` for a sphere. `neighbours`
/// receives the primitives around the point.
fn near(
    (geometry, accelerator): (&Geometry, &dyn Accelerator),
    packet: &RayPacket,
    i: usize,
    neighbours: &mut Vec<u32>,
) -> Option<([DVec3; 3], TrianglePoint)> {
    let (corners, point) = hit_triangle(geometry, packet, i)?;
    neighbours.clear();
    let nearby = Nearby::new(point.position, corners);
    accelerator.near(geometry, &nearby, &mut |primitive| {
        if is_near(geometry, primitive, &nearby) {
            neighbours.push(primitive);
        }
    });
    Some((corners, point))
}

/// Replaces a hit by a hit that hides it from the viewer. Returns true if there was one.
fn replace_hidden_hit(
    scene: (&Geometry, &dyn Accelerator),
    kind: RayKind,
    packet: &mut RayPacket,
    i: usize,
    neighbours: &mut Vec<u32>,
) -> bool {
    let mut was_hidden = false;
    for _ in 0..MAX_HIDING {
        let Some((corners, point)) = near(scene, packet, i, neighbours) else { break };
        let hit = scene.0.primitive(packet.hits.geom[i], packet.hits.prim[i]);
        // The primitive that the ray leaves lies behind the hit.
        let (leaving, unseen) = (packet.rays.leaving[i], scene.0.unseen(kind));
        neighbours.retain(|&primitive| primitive != leaving && !unseen.has(primitive));
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

/// Traces ray `i` alone for the closest hit that is not `passed`. Returns true if there is one.
/// Else the lane becomes a miss and keeps its `tfar`.
fn closest_not_passed(
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
        // Other primitives may be hit at the same t. So only this primitive is excluded. If it is
        // hit again, the ray continues after it.
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
    lane(&rays.dir, i).as_dvec3()
}
