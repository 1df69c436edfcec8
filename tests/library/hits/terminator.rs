//! Smooth normals on coarse meshes: no stairs of shadow at the terminator, no mirrored ray into its
//! own surface, and normals that face the wrong way.

use std::collections::HashMap;
use std::fmt::Write as _;

use crate::support::backends::{build, on_both};
use crate::support::errors::worse;
use glam::{DVec3, Vec3};
use lightpath::accel::Accelerator;
use lightpath::geometry::{NONE, Surfaces, refine};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use lightpath::scene::{self, Backend, Source};
use lightpath::shading::{Falloff, LightWeights, Points, lane, light_rays, reflect, set_lane};
use lightpath::world::{LoadOptions, World};
use serde_json::json;

/// Direction of the file's normals.
#[derive(Clone, Copy, PartialEq)]
enum Normals {
    /// The file has no normals.
    None,
    Inward,
    /// Every other vertex has its normal reversed.
    Mixed,
}

/// A unit icosphere, with each face split into four `times` times.
fn icosphere(times: u32, normals: Normals) -> String {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut points: Vec<DVec3> = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        points.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    let near = |p: DVec3, q: DVec3| (p.distance(q) - 2.0).abs() < 1e-9;
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for i in 0..12 {
        for j in 0..12 {
            for k in 0..12 {
                let (p, q, r) = (points[i], points[j], points[k]);
                let outward = (q - p).cross(r - p).dot(p) > 0.0;
                if near(p, q) && near(q, r) && near(r, p) && outward && i < j && i < k {
                    faces.push([i as u32, j as u32, k as u32]);
                }
            }
        }
    }
    assert_eq!(faces.len(), 20);
    points.iter_mut().for_each(|p| *p = p.normalize());
    for _ in 0..times {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let split = faces.iter().flat_map(|&[a, b, c]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        });
        faces = split.collect();
    }
    let own = if normals == Normals::None {
        ""
    } else {
        "property float nx\nproperty float ny\nproperty float nz\n"
    };
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\n{own}element face {}\nproperty list uchar int vertex_indices\n\
         end_header\n",
        points.len(),
        faces.len()
    );
    for (i, p) in points.iter().enumerate() {
        let n = match normals {
            Normals::Mixed if i % 2 == 0 => *p,
            _ => -*p,
        };
        let n = match normals {
            Normals::None => String::new(),
            _ => format!(" {} {} {}", n.x as f32, n.y as f32, n.z as f32),
        };
        writeln!(text, "{} {} {}{n}", p.x as f32, p.y as f32, p.z as f32).unwrap();
    }
    for [a, b, c] in faces {
        writeln!(text, "3 {a} {b} {c}").unwrap();
    }
    text
}

/// Returns the world of the sphere, with all that shading needs.
fn world(ply: &str) -> World {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ball.ply"), ply).unwrap();
    let scene = json!({
        "camera": { "type": "pinhole", "width": 4, "height": 4, "fov": 40,
            "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "shapes": [
            { "type": "trimesh", "path": "ball.ply", "smooth": true, "material": { "kr": 1 } }] }
    });
    let text = scene.to_string();
    let source = Source::Text { name: "test", text: text.as_bytes(), folder: folder.path() };
    let scene = scene::load(source, &[]).unwrap().scene;
    World::load(&scene, LoadOptions::default(), &Monitor::default()).unwrap().0
}

/// Rays per row of [`packets`].
const SIDE: usize = 192;

/// Returns a regular grid of rays along -z over [-1, 1]^2, packet by packet.
fn packets() -> impl Iterator<Item = RayPacket> {
    (0..SIDE * SIDE / LANES).map(|first| {
        let mut packet = RayPacket::EMPTY;
        for i in 0..LANES {
            let index = first * LANES + i;
            let at = |k: usize| (k as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0;
            let from = Vec3::new(at(index % SIDE), at(index / SIDE), 4.0);
            set_lane(&mut packet.rays.org, i, from);
            set_lane(&mut packet.rays.dir, i, Vec3::NEG_Z);
        }
        packet
    })
}

/// Traces a packet and shades its first hits.
fn look(
    world: &World,
    accelerator: &dyn Accelerator,
    packet: &mut RayPacket,
) -> (Surfaces, Points) {
    accelerator.closest(&Mask::ALL, packet, Coherence::Coherent);
    let (mut surfaces, mut points) = (Surfaces::EMPTY, Points::EMPTY);
    refine(&world.geometry, &packet.hit(&Mask::ALL), packet, &mut surfaces);
    world.shapes.look(&world.geometry, packet, &surfaces, None, &mut points);
    (surfaces, points)
}

/// Returns N.L at a packet's first hits, 0 where they are in shadow, `None` without a hit. `lifted`
/// starts shadow rays at the shifted origins.
fn lit(
    world: &World,
    accelerator: &dyn Accelerator,
    packet: &mut RayPacket,
    light: DVec3,
    lifted: bool,
) -> [Option<f64>; LANES] {
    let (surfaces, mut points) = look(world, accelerator, packet);
    if !lifted {
        points.at.origin = surfaces.outside;
        points.at.lifted = Mask::NONE;
    }
    let mut q = [[0.0; LANES]; 3];
    (0..LANES).for_each(|i| set_lane(&mut q, i, light.as_vec3()));
    let (mut rays, mut lit) = (Rays::EMPTY, LightWeights::EMPTY);
    let on = light_rays(&points.at, &q, None, Falloff::None, false, &mut rays, &mut lit);
    accelerator.occluded(&on, &mut rays, Coherence::Coherent);
    std::array::from_fn(|i| {
        let seen = on.0[i] != 0 && rays.tfar[i] != f32::NEG_INFINITY;
        let value = if seen { f64::from(lit.diffuse[i]) } else { 0.0 };
        (surfaces.hit.0[i] != 0).then_some(value)
    })
}

/// The picture of a lit ball compared with the sphere that it approximates.
#[derive(Debug, Default)]
struct Lighting {
    points: u64,
    /// Points that lie in shadow although the sphere's own normal says that they are lit, outside a
    /// band around the terminator.
    black: u64,
    /// Largest difference of N.L from the sphere's, shadows included.
    worst: f64,
}

/// Lights a ball of `times` splits from the side. `lifted` starts shadow rays at the shifted
/// origins. Points with N.L up to `band` belong to the terminator.
fn lighting(backend: Backend, times: u32, lifted: bool, band: f64) -> Lighting {
    let world = world(&icosphere(times, Normals::None));
    let to_light = DVec3::new(0.9, 0.3, 0.25).normalize();
    let light = to_light * 50.0;
    let accelerator = build(&world.geometry, backend);
    let mut found = Lighting::default();
    for mut packet in packets() {
        let lit = lit(&world, accelerator.as_ref(), &mut packet, light, lifted);
        for (i, value) in lit.into_iter().enumerate() {
            let Some(value) = value else { continue };
            let at = lane(&packet.rays.org, i).as_dvec3();
            // Skips the silhouette, where the coarse ball shows other parts of itself.
            let r2 = at.x * at.x + at.y * at.y;
            if r2 > 0.8 {
                continue;
            }
            let n = DVec3::new(at.x, at.y, (1.0 - r2).sqrt());
            let exact = n.dot((light - n).normalize());
            found.points += 1;
            found.black += u64::from(exact > band && value == 0.0);
            found.worst = worse(found.worst, (value - exact.max(0.0)).abs());
        }
    }
    println!("{backend:?}, {times} splits, lifted {lifted}: {found:?}");
    found
}

/// Hills and valleys over [-1, 1]^2, as `cells` x `cells` pairs of triangles.
fn landscape(cells: u32) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        (cells + 1) * (cells + 1),
        2 * cells * cells
    );
    let at = |k: u32| f64::from(k) / f64::from(cells) * 2.0 - 1.0;
    for (x, y) in (0..=cells).flat_map(|j| (0..=cells).map(move |i| (at(i), at(j)))) {
        let z = 0.12 * (5.0 * x + 1.0).sin() * (3.5 * y).cos() + 0.05 * (7.0 * y + 2.0 * x).sin();
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for a in (0..cells).flat_map(|j| (0..cells).map(move |i| j * (cells + 1) + i)) {
        let (b, c, d) = (a + 1, a + cells + 2, a + cells + 1);
        writeln!(text, "3 {a} {b} {c}\n3 {a} {c} {d}").unwrap();
    }
    text
}

/// Returns whether the neighbouring grid points are all lit or all dark; `None` if mixed.
fn all_around(lit: &[f64], index: usize, distance: usize) -> Option<bool> {
    let (x, y) = (index % SIDE, index / SIDE);
    let low = |k: usize| k.saturating_sub(distance);
    let high = |k: usize| (k + distance).min(SIDE - 1);
    let around = [(x, y), (low(x), y), (high(x), y), (x, low(y)), (x, high(y))];
    let lit = around.map(|(x, y)| lit[y * SIDE + x] > 0.0);
    lit.iter().all(|&each| each == lit[0]).then_some(lit[0])
}

on_both! {
fn a_coarse_sphere_has_no_stairs_of_shadow(backend: Backend) {
    // 80, 320 and 20480 faces. Interpolated normals are off by as much as `near`.
    for (times, near) in [(1, 0.04), (2, 0.02), (5, 0.003)] {
        let found = lighting(backend, times, true, 2.0 * near);
        assert!(found.points > 10_000);
        assert_eq!(found.black, 0, "{times}: {found:?}");
        assert!(found.worst < near, "{times}: {found:?}");
    }
    // Without the shifted origins there are many black points, so the test can fail.
    for (times, near) in [(1, 0.04), (2, 0.02)] {
        let found = lighting(backend, times, false, 2.0 * near);
        assert!(found.black > 100, "{times}: {found:?}");
    }
}

/// Compares a coarse landscape with one of 512 x 512 cells, where that is lit or dark all around.
/// No lit point may be black, and no N.L may be off by more than the interpolated normals are, in
/// the dark, too.
fn a_coarse_landscape_is_lit_as_the_subdivided_one(backend: Backend) {
    let light = DVec3::new(0.9, 0.35, 0.3).normalize() * 50.0;
    let values = |cells: usize, lifted: bool| -> Vec<f64> {
        let world = world(&landscape(cells as u32));
        let accelerator = build(&world.geometry, backend);
        let lit = |mut packet| lit(&world, accelerator.as_ref(), &mut packet, light, lifted);
        packets().flat_map(lit).map(|value| value.unwrap()).collect()
    };
    let fine = values(512, true);
    // The error of interpolated normals falls with the size of cells.
    for (cells, near) in [(24, 0.08), (48, 0.045)] {
        // Shadows of the coarse landscape end at most half a cell elsewhere.
        let band = SIDE / (2 * cells);
        for lifted in [true, false] {
            let coarse = values(cells, lifted);
            let (mut lit, mut dark, mut black, mut worst) = (0, 0, 0, 0.0f64);
            for (index, &value) in coarse.iter().enumerate() {
                let Some(is_lit) = all_around(&fine, index, band) else { continue };
                let is_black = is_lit && value == 0.0;
                (lit, dark) = (lit + u32::from(is_lit), dark + u32::from(!is_lit));
                black += u32::from(is_black);
                worst = worse(worst, (value - fine[index]).abs());
            }
            println!("{cells}, lifted {lifted}: {black} of {lit} black, {dark} dark, {worst}");
            assert!(lit > 10_000 && dark > 2_000, "{lit} lit, {dark} dark");
            if lifted {
                assert!(black == 0 && worst < near, "{black} black, {worst}");
            } else {
                assert!(black > 0 && worst > near, "no stairs without the shifted origins");
            }
        }
    }
}

fn no_mirrored_ray_runs_into_its_own_surface(backend: Backend) {
    for normals in [Normals::None, Normals::Inward, Normals::Mixed] {
        let world = world(&icosphere(1, normals));
        let accelerator = build(&world.geometry, backend);
        let accelerator = accelerator.as_ref();
            let (mut mirrored, mut turned) = (0, 0);
            for mut packet in packets() {
                let (surfaces, points) = look(&world, accelerator, &mut packet);
                let mut next = RayPacket::EMPTY;
                let on = reflect(&points, &surfaces.outside, &mut next.rays);
                accelerator.closest(&on, &mut next, Coherence::Incoherent);
                for i in (0..LANES).filter(|&i| on.0[i] != 0) {
                    let ng = lane(&points.at.ng, i).as_dvec3();
                    let (n, d) = (lane(&points.at.n, i).as_dvec3(), -DVec3::Z);
                    let plain = d - n * (2.0 * d.dot(n));
                    turned += u64::from(plain.dot(ng) <= 0.0);
                    mirrored += 1;
                    let r = lane(&next.rays.dir, i).as_dvec3();
                    assert!(r.dot(ng) > 0.0, "{backend:?}: {r} under {ng}");
                    assert!((r.length() - 1.0).abs() < 1e-6);
                    assert_eq!(next.hits.geom[i], NONE, "{backend:?}: a convex body meets itself");
                }
            }
            assert!(mirrored > 20_000 && turned > 50, "{mirrored}, {turned} turned");
    }
}

fn normals_that_point_inward_are_turned_to_the_viewer(backend: Backend) {
    let pictures = [Normals::None, Normals::Inward].map(|normals| {
        let world = world(&icosphere(2, normals));
        let mut seen = Vec::new();
        let accelerator = build(&world.geometry, backend);
        let accelerator = accelerator.as_ref();
            for mut packet in packets() {
                let (surfaces, points) = look(&world, accelerator, &mut packet);
                for i in (0..LANES).filter(|&i| surfaces.hit.0[i] != 0) {
                    let (n, ng) = (lane(&points.at.n, i), lane(&points.at.ng, i));
                    assert!(n.dot(ng) >= 0.0 && ng.z >= 0.0);
                    seen.push((n, lane(&points.at.origin, i)));
                }
            }
        seen
    });
    let [own, inward] = pictures;
    assert_eq!(own.len(), inward.len());
    for ((n, origin), (turned, same)) in own.iter().zip(&inward) {
        // The computed normals and those of the mesh differ by the rounding of the angle weights
        // and by the icosphere's small asymmetry.
        assert!(n.distance(*turned) < 0.05, "{n} and {turned}");
        assert!(origin.distance(*same) < 0.01);
    }
}

/// With mixed normals the lifted origin never goes below the facet.
fn mixed_normals_never_start_shadow_rays_under_the_facet(backend: Backend) {
    let world = world(&icosphere(1, Normals::Mixed));
    let accelerator = build(&world.geometry, backend);
    let accelerator = accelerator.as_ref();
        let mut lifted = 0;
        for mut packet in packets() {
            let (surfaces, points) = look(&world, accelerator, &mut packet);
            for i in (0..LANES).filter(|&i| surfaces.hit.0[i] != 0) {
                let (geom, prim) = world.geometry.place(surfaces.primitive[i]);
                let corners = world.geometry.meshes[geom as usize].corners(prim);
                let corner = DVec3::from(corners[0].map(f64::from));
                let ng = lane(&surfaces.ng, i).as_dvec3();
                let height = (lane(&points.at.origin, i).as_dvec3() - corner).dot(ng);
                assert!(height > -1e-7, "{height:e} under the facet");
                lifted += u64::from(height > 1e-3);
            }
        }
        assert!(lifted > 1000, "{lifted} lifted");
}
}
