//! Area lights that lie in a surface: a panel in a ceiling, a window in a wall.
//!
//! Such a surface cannot shadow its light, but rounding may put it in front of the light's points.
//! So a shadow ray ends before the plane, by the distance between surface and light. If the angle
//! between ray and plane is small, this end is far from the light.

use glam::{DVec3, Vec3};

use super::light::{Area, Distant};
use super::points::{ShadowPoints, lane};
use crate::geometry::{Box3, Geometry, GeometryKind, RUN, TriangleMesh, doubles};
use crate::parallel;
use crate::ray::{LANES, Mask, Rays};

/// Unit roundoff u of f32: half an ulp of 1.
const UNIT: f64 = 0.5 * f32::EPSILON as f64;

/// Tolerance of coplanarity; see [`Area::coplanar_distance`].
const COPLANAR: f64 = 4.0 * UNIT;

/// Smallest end of a ray in front of the light's plane, as a ray parameter; the light is at 1. A
/// ray that would end earlier is grazing and keeps its own end.
const GRAZING: f64 = 1.0 - 1.0 / 256.0;

/// Largest N.L, for unit vectors, of a ray along a light's plane that brings no light to a point in
/// the plane.
const ALONG: f64 = 1e-4;

/// Runs of triangles that one task compares with a light.
const RUNS_OF_TASK: usize = (1 << 14) / RUN;

/// The box of a light.
struct LightBox {
    bounds: Box3,
    /// Largest magnitude of its coordinates.
    largest: f64,
}

impl LightBox {
    fn new(area: &Area) -> Self {
        let [a, b] = [area.corner, area.corner + area.edge + area.height].map(|v| v.as_dvec3());
        let [c, d] = [area.corner + area.edge, area.corner + area.height].map(|v| v.as_dvec3());
        let bounds = Box3::of(&[a, b, c, d]);
        let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
        Self { bounds, largest }
    }

    /// Whether it overlaps the box around `corners`, up to rounding.
    fn reaches(&self, corners: &[DVec3]) -> bool {
        let Box3 { min: low, max: high } = self.bounds;
        let Box3 { min: below, max: above } = Box3::of(corners);
        let far = below.abs().max(above.abs()).max_element().max(self.largest);
        let slack = DVec3::splat(2.0 * COPLANAR * far);
        below.cmple(high + slack).all() && above.cmpge(low - slack).all()
    }
}

impl Area {
    /// An area light of `samples` points with these sides, relative to the scene's origin.
    /// [`Area::plane_gap`] is not set yet.
    pub fn new(corner: Vec3, edge: DVec3, height: DVec3, lambertian: bool, samples: u32) -> Self {
        let plane = edge.cross(height).normalize();
        let normal = lambertian.then(|| plane.as_vec3());
        let (edge, height) = (edge.as_vec3(), height.as_vec3());
        Self { distant: None, corner, edge, height, normal, samples, plane, plane_gap: 0.0 }
    }

    /// Light from `samples` directions beyond the scene.
    pub fn from_distant(distant: Distant, samples: u32) -> Self {
        let (plane, none) = (DVec3::ZERO, Vec3::ZERO);
        let (corner, edge, height) = (none, none, none);
        Self {
            distant: Some(distant),
            corner,
            edge,
            height,
            normal: None,
            samples,
            plane,
            plane_gap: 0.0,
        }
    }

    /// Returns the largest distance of a primitive's corners from the light's plane, if the two are
    /// coplanar up to the rounding of f32. The primitive may then be the wall or ceiling that holds
    /// the light. Returns `None` for a sphere, and for a distance above 4u times the largest
    /// coordinate (u = 2^-24). Such a primitive lies in front of the light or behind it. Corners in
    /// the light's own plane are rounded by 1.8u.
    pub fn coplanar_distance(&self, geometry: &Geometry, primitive: u32) -> Option<f64> {
        let (geom, prim) = geometry.place(primitive);
        let corner = self.corner.as_dvec3();
        let gap = |corners: &[[f32; 3]]| {
            let corners = corners.iter().copied().map(doubles);
            let (gap, largest) = corners.fold((0.0f64, 0.0f64), |(gap, largest), v| {
                let off = (v - corner).dot(self.plane).abs();
                (gap.max(off), largest.max(v.abs().max_element()))
            });
            let largest = largest.max(corner.abs().max_element());
            (gap <= COPLANAR * largest).then_some(gap)
        };
        match geometry.kind(geom) {
            GeometryKind::Mesh(mesh) => gap(&geometry.meshes[mesh].corners(prim)),
            GeometryKind::Quads => gap(&geometry.quads[prim as usize]),
            GeometryKind::Instance(index) => gap(&geometry.instance_corners(index, prim)),
            GeometryKind::Spheres => None,
        }
    }

    /// Whether two lights are the same rectangle.
    pub fn has_place_of(&self, other: &Self) -> bool {
        let place = |area: &Self| (area.corner, area.edge, area.height, area.plane);
        self.distant.is_none() && other.distant.is_none() && place(self) == place(other)
    }

    /// Whether a triangle or quad lies in the light's plane, up to the rounding of f32.
    pub fn holds(&self, geometry: &Geometry, primitive: u32) -> bool {
        self.distant.is_none() && self.coplanar_distance(geometry, primitive).is_some()
    }

    /// Sets [`Area::plane_gap`] from the coplanar triangles and quads whose boxes overlap the
    /// light's box.
    pub fn set_plane_gap(&mut self, geometry: &Geometry) {
        let near = LightBox::new(self);
        let gap = self.largest_distance(geometry, &near);
        // Points of the light are sums of three products in f32.
        let sides = f64::from(self.edge.length() + self.height.length());
        let own = 8.0 * UNIT * (near.largest + sides);
        self.plane_gap = if gap >= 0.0 { (gap + own) as f32 } else { 0.0 };
    }

    /// Returns the largest [`Area::coplanar_distance`] of the triangles and quads in the light's
    /// box; negative if there are none.
    fn largest_distance(&self, geometry: &Geometry, near: &LightBox) -> f64 {
        let most = |a: f64, b: f64| a.max(b);
        let mut gap = f64::NEG_INFINITY;
        let meshes = (0..).zip(geometry.meshes.iter().map(TriangleMesh::bounds));
        let instances = geometry.instances.iter().map(|instance| instance.bounds);
        let instances = (geometry.instance_id(0)..).zip(instances);
        for (geom, bounds) in meshes.chain(instances) {
            let Some((mesh, placement)) =
                geometry.mesh(geom).filter(|_| near.reaches(&bounds.map(doubles)))
            else {
                continue;
            };
            let gap_of = |prim: u32| {
                let corners = mesh.corners(prim);
                let corners = placement.map_or(corners, |placement| placement.corners(corners));
                let gap = near
                    .reaches(&corners.map(doubles))
                    .then(|| self.coplanar_distance(geometry, geometry.primitive(geom, prim)));
                gap.flatten().unwrap_or(f64::NEG_INFINITY)
            };
            let gap_of_run = |run: &usize| {
                let end = mesh.triangles().len().min((run + 1) * RUN);
                (run * RUN..end).map(|prim| gap_of(prim as u32)).fold(f64::NEG_INFINITY, most)
            };
            let is_near = |bounds: &[[f32; 3]; 2]| {
                let bounds = bounds.map(doubles);
                near.reaches(&placement.map_or(bounds, |placement| placement.bounds(bounds)))
            };
            let runs = mesh.runs().iter().enumerate();
            let found: Vec<usize> = runs.filter(|(_, b)| is_near(b)).map(|(i, _)| i).collect();
            let of_runs = |found: &[usize]| found.iter().map(gap_of_run).fold(gap, most);
            // Frames of a batch are prepared outside of any pool. Parallel code would start rayon's
            // global pool there.
            gap = match rayon::current_thread_index().filter(|_| found.len() > RUNS_OF_TASK) {
                Some(_) => {
                    let gaps = parallel::map(found.chunks(RUNS_OF_TASK), of_runs);
                    gaps.into_iter().fold(gap, most)
                }
                None => of_runs(&found),
            };
        }
        let quads = (0..geometry.quads.len() as u32)
            .filter(|&prim| near.reaches(&geometry.quads[prim as usize].map(doubles)))
            .filter_map(|prim| {
                self.coplanar_distance(geometry, geometry.primitive(geometry.quads_id(), prim))
            });
        quads.fold(gap, most)
    }

    /// Ends the shadow rays to a light that lies in a surface before that surface. Returns the
    /// active grazing rays, which would end far from the light. They keep their end, and their hits
    /// must be checked against the light's plane ([`Area::holds`]). Rays along the plane from
    /// surfaces in the plane carry no light; they become inactive.
    #[inline(always)]
    pub fn end_before_plane(
        &self,
        points: &ShadowPoints,
        rays: &mut Rays,
        active: &mut Mask,
    ) -> Mask {
        let ([x, y, z], plane_gap) = (self.plane.to_array(), f64::from(self.plane_gap));
        let mut grazing = Mask::NONE;
        for i in 0..LANES {
            let [dx, dy, dz] = [rays.dir[0][i], rays.dir[1][i], rays.dir[2][i]].map(f64::from);
            // Distance of the ray's origin from the plane.
            let height = (dx * x + dy * y + dz * z).abs();
            let end = 1.0 - plane_gap / height;
            let near = end >= GRAZING;
            let tfar = rays.tfar[i];
            let end = if near { end as f32 } else { tfar };
            rays.tfar[i] = if end < tfar { end } else { tfar };
            grazing.0[i] = active.0[i] & -i32::from(!near);
        }
        if grazing.any() {
            self.drop_in_plane(points, rays, active, &mut grazing);
        }
        grazing
    }

    /// Deactivates the rays that run along the plane from a surface in the plane.
    #[cold]
    #[inline(never)]
    fn drop_in_plane(
        &self,
        points: &ShadowPoints,
        rays: &Rays,
        active: &mut Mask,
        grazing: &mut Mask,
    ) {
        for i in 0..LANES {
            let direction = lane(&rays.dir, i).as_dvec3();
            let within = direction.dot(self.plane).abs() <= f64::from(self.plane_gap);
            let along = lane(&points.n, i).as_dvec3().dot(direction) <= ALONG * direction.length();
            if within && along {
                (active.0[i], grazing.0[i]) = (0, 0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Instance, Placement};
    use glam::DMat3;

    /// A ceiling of 32 x 32 squares. Rounding moves its corners off the plane by different amounts.
    fn ceiling(turn: DMat3) -> TriangleMesh {
        let at = |i: u32| DVec3::new(f64::from(i % 33) - 16.0, f64::from(i / 33) - 16.0, 3.3);
        let vertices = (0..33 * 33).map(|i| (turn * at(i)).as_vec3().to_array()).collect();
        let squares = (0..32 * 32).map(|i| i / 32 * 33 + i % 32);
        let triangles = squares.flat_map(|a| [[a, a + 1, a + 33], [a + 1, a + 34, a + 33]]);
        TriangleMesh::new(vertices, triangles.collect(), false)
    }

    /// What a search among all triangles finds.
    fn among_all(area: &Area, geometry: &Geometry) -> f64 {
        let near = LightBox::new(area);
        let found = (0..geometry.count() as u32).filter_map(|primitive| {
            let (geom, prim) = geometry.place(primitive);
            let (mesh, placement) = geometry.mesh(geom)?;
            let corners = mesh.corners(prim);
            let corners = placement.map_or(corners, |placement| placement.corners(corners));
            area.coplanar_distance(geometry, primitive)
                .filter(|_| near.reaches(&corners.map(doubles)))
        });
        found.fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn the_search_by_runs_finds_what_a_search_of_all_triangles_finds() {
        let turn = DMat3::from_rotation_x(0.3) * DMat3::from_rotation_y(0.2);
        let mesh = |turn| Geometry::new(DVec3::ZERO, vec![ceiling(turn)], vec![], vec![]).unwrap();
        let own = mesh(turn);
        let shared = mesh(DMat3::IDENTITY);
        let bounds = shared.meshes[0].bounds().map(doubles);
        let instance = Instance::new(0, Placement::new(turn, DVec3::ZERO), bounds);
        let none = Geometry::new(DVec3::ZERO, vec![], vec![], vec![]).unwrap();
        let placed = none.with_instances(vec![shared], vec![instance]).unwrap();
        for geometry in [own, placed] {
            let mut found = [0; 2];
            for i in 0..400 {
                let (x, y) = (f64::from(i % 20) * 2.0 - 19.7, f64::from(i / 20) * 2.0 - 19.7);
                let corner = (turn * DVec3::new(x, y, 3.3)).as_vec3();
                let [edge, height] = [DVec3::X * 0.7, DVec3::Y].map(|side| turn * side);
                let area = Area::new(corner, edge, height, false, 1);
                let gap = area.largest_distance(&geometry, &LightBox::new(&area));
                assert_eq!(gap, among_all(&area, &geometry));
                found[usize::from(gap > 0.0)] += 1;
            }
            // Some lights are beside the ceiling.
            assert!(found.iter().all(|&count| count > 40), "{found:?}");
        }
    }

    #[test]
    fn another_light_has_the_place_only_of_the_same_rectangle() {
        let area = |corner, edge| Area::new(corner, edge, DVec3::Y, true, 4);
        let here = area(Vec3::Z, DVec3::X);
        assert!(area(Vec3::Z, DVec3::X).has_place_of(&here));
        assert!(!area(Vec3::ZERO, DVec3::X).has_place_of(&here));
        assert!(!area(Vec3::Z, 2.0 * DVec3::X).has_place_of(&here));
        assert!(!area(Vec3::Z, DVec3::X + DVec3::Z * 1e-30).has_place_of(&here));
    }
}
