#![allow(missing_docs)]
use glam::Vec3;
use lightpath::accel::{self, Accelerator, BuildOptions};
use lightpath::geometry::{Surfaces, refine};
use lightpath::monitor::Monitor;
use lightpath::ray::*;
use lightpath::scene;
use lightpath::simd::Isa;
use lightpath::world::{LoadOptions, World};
use std::path::Path;
use std::time::Instant;
type P = (Mask, RayPacket);
fn rng(s: &mut u64) -> f32 {
    *s = s.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    ((*s >> 40) as f32) / (1u64 << 24) as f32
}
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let mesh = &args[1];
    let only = args.get(2).cloned().unwrap_or("all".into());
    let rounds: usize = args.get(3).and_then(|s| s.parse().ok()).unwrap_or(7);
    let isa = match std::env::var("ISA").as_deref() {
        Ok("avx2") => Isa::Avx2,
        Ok("portable") => Isa::Portable,
        _ => Isa::detect(),
    };
    let shapes = if mesh.contains("room") {
        serde_json::json!([{"type":"trimesh","path":mesh,"fit":4,"center":[0,1,0],"material":{"kd":0.8}}])
    } else {
        serde_json::json!([
   {"type":"trimesh","path":mesh,"fit":2,"center":[0,1,0],"material":{"kd":0.8}},
   {"type":"plane","v0":[-10,0,-10],"v1":[10,0,-10],"v2":[10,0,10],"v3":[-10,0,10],"material":{"kd":0.8}}])
    };
    let (pos, lp) = if mesh.contains("room") {
        ([0.0, 1.2, 1.5], [0.3, 1.85, 0.3])
    } else {
        ([0.0, 1.5, 4.0], [3.0, 6.0, 5.0])
    };
    let text=serde_json::json!({"nbounces":0,"camera":{"type":"pinhole","width":1024,"height":1024,"fov":40,"position":pos,"target":[0,0.9,0],"up":[0,1,0]},
   "scene":{"lightsources":[{"type":"pointlight","position":lp,"id":[5,5,5]}],"shapes":shapes}}).to_string();
    let m = Monitor::default();
    let sc = scene::load(
        scene::Source::Text { name: "q", text: text.as_bytes(), folder: Path::new(".") },
        &[],
    )
    .unwrap()
    .scene;
    let (world, _) = World::load(&sc, LoadOptions::default(), &m).unwrap();
    let threads = 2;
    let o = BuildOptions { threads, fast: false, isa, max_bytes: None };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let tri = world.triangles() as f64;
    let t = Instant::now();
    let e = accel::build(&world.geometry, scene::Backend::Embree, &o, &m).unwrap();
    let te = t.elapsed().as_secs_f64();
    let mut tbs = vec![];
    let mut b = None;
    for _ in 0..3 {
        drop(b.take());
        let t = Instant::now();
        b = Some(
            pool.install(|| accel::build(&world.geometry, scene::Backend::Bvh, &o, &m).unwrap()),
        );
        tbs.push(t.elapsed().as_secs_f64());
    }
    let b = b.unwrap();
    let (ei, bi) = (e.info(), b.info());
    println!(
        "{} tri; build embree {:.3}s bvh {:?} ratio {:.2}; bytes/tri {:.1} (peak {:.1}) vs {:.1} (peak {:.1}) ratio {:.2}",
        tri,
        te,
        tbs,
        tbs.iter().cloned().fold(9., f64::min) / te,
        ei.bytes as f64 / tri,
        ei.peak_bytes as f64 / tri,
        bi.bytes as f64 / tri,
        bi.peak_bytes as f64 / tri,
        bi.bytes as f64 / ei.bytes as f64
    );
    // rays
    let mut prim: Vec<P> = vec![];
    let (mut sp, mut sa, mut di) = (vec![], vec![], vec![]);
    let mut s = 1u64;
    let q = match world.lights[0].emitter {
        lightpath::shading::Emitter::Point(q) => q,
        _ => unreachable!(),
    };
    let n: usize = if only == "all" { 16384 * 4 } else { 16384 * 4 };
    let _ = n;
    for by in (0..1024).step_by(4) {
        for bx in (0..1024).step_by(4) {
            let mut p = RayPacket::EMPTY;
            for i in 0..16 {
                let (oo, d) =
                    world.camera.pinhole_ray((bx + i % 4) as f32 + 0.5, (by + i / 4) as f32 + 0.5);
                for a in 0..3 {
                    p.rays.org[a][i] = oo[a];
                    p.rays.dir[a][i] = d[a];
                }
            }
            let all = Mask([-1; 16]);
            prim.push((all, p.clone()));
            let mut h = p.clone();
            e.closest(&all, &mut h, Coherence::Coherent);
            let hit = h.hit(&all);
            if !hit.any() {
                continue;
            }
            let mut su = Surfaces::EMPTY;
            refine(&world.geometry, &hit, &h, &mut su);
            let (mut a, mut bb, mut c) = (RayPacket::EMPTY, RayPacket::EMPTY, RayPacket::EMPTY);
            for i in 0..16 {
                let pt = Vec3::new(su.outside[0][i], su.outside[1][i], su.outside[2][i]);
                let ng = Vec3::new(su.ng[0][i], su.ng[1][i], su.ng[2][i]);
                let d = q - pt;
                let la = q + Vec3::new(rng(&mut s) - 0.5, 0.0, rng(&mut s) - 0.5) * 1.0;
                let d2 = la - pt;
                let r = loop {
                    let v = Vec3::new(
                        rng(&mut s) * 2. - 1.,
                        rng(&mut s) * 2. - 1.,
                        rng(&mut s) * 2. - 1.,
                    );
                    let l = v.length_squared();
                    if l < 1.0 && l > 1e-4 {
                        break v / l.sqrt();
                    }
                };
                let d3 = (ng + r).normalize_or(ng);
                for ax in 0..3 {
                    a.rays.org[ax][i] = pt[ax];
                    a.rays.dir[ax][i] = d[ax];
                    bb.rays.org[ax][i] = pt[ax];
                    bb.rays.dir[ax][i] = d2[ax];
                    c.rays.org[ax][i] = pt[ax];
                    c.rays.dir[ax][i] = d3[ax];
                }
                a.rays.tfar[i] = 1.0;
                bb.rays.tfar[i] = 1.0;
                for p in [&mut a, &mut bb, &mut c] {
                    p.rays.leaving[i] = su.primitive[i];
                }
            }
            sp.push((hit, a));
            sa.push((hit, bb));
            di.push((hit, c));
        }
    }
    if std::env::var("DBGR").is_ok() {
        let mut n = 0;
        for (m, p) in &sp {
            let mut x = p.clone();
            x.clear_hits();
            let mut y = x.clone();
            e.closest(m, &mut x, Coherence::Single);
            b.closest(m, &mut y, Coherence::Single);
            for i in 0..16 {
                if m.0[i] != 0 && (x.hits.geom[i] != NONE) != (y.hits.geom[i] != NONE) && n < 8 {
                    n += 1;
                    println!(
                        "o {:?} d {:?} leaving {} e: {} {} t {} b: {} {} t {}",
                        [p.rays.org[0][i], p.rays.org[1][i], p.rays.org[2][i]],
                        [p.rays.dir[0][i], p.rays.dir[1][i], p.rays.dir[2][i]],
                        p.rays.leaving[i],
                        x.hits.geom[i],
                        x.hits.prim[i],
                        x.rays.tfar[i],
                        y.hits.geom[i],
                        y.hits.prim[i],
                        y.rays.tfar[i]
                    );
                    let pr = x.hits.prim[i];
                    if pr != NONE {
                        println!("  tri {:?}", world.geometry.meshes[0].corners(pr));
                    }
                }
            }
        }
    }
    let classes: [(&str, &Vec<P>, bool, Coherence); 7] = [
        ("P1", &prim, true, Coherence::Single),
        ("D1", &di, true, Coherence::Single),
        ("Sp1", &sp, false, Coherence::Single),
        ("Sa1", &sa, false, Coherence::Single),
        ("P16", &prim, true, Coherence::Coherent),
        ("Sp16", &sp, false, Coherence::Coherent),
        ("Sa16", &sa, false, Coherence::Coherent),
    ];
    for (name, ps, closest, coh) in classes {
        if only != "all" && !only.split(',').any(|o| o == name) {
            continue;
        }
        let run = |acc: &dyn Accelerator| -> (f64, u64, f64) {
            let t = Instant::now();
            let (mut hits, mut ts) = (0u64, 0f64);
            let mut scratch = RayPacket::EMPTY;
            let step = if only == "all" && coh == Coherence::Single { 4 } else { 1 };
            for (m, p) in ps.iter().step_by(step) {
                scratch.rays.clone_from(&p.rays);
                scratch.clear_hits();
                if closest {
                    acc.closest(m, &mut scratch, coh);
                    for i in 0..16 {
                        if m.0[i] != 0 && scratch.hits.geom[i] != NONE {
                            hits += 1;
                            ts += f64::from(scratch.rays.tfar[i]);
                        }
                    }
                } else {
                    acc.occluded(m, &mut scratch.rays, coh);
                    for i in 0..16 {
                        if m.0[i] != 0 && scratch.rays.tfar[i] < 0.0 {
                            hits += 1;
                        }
                    }
                }
            }
            (t.elapsed().as_secs_f64(), hits, ts)
        };
        let rays: u32 = ps
            .iter()
            .step_by(if only == "all" && coh == Coherence::Single { 4 } else { 1 })
            .map(|p| p.0.count())
            .sum();
        if std::env::var("PROF").is_ok() {
            for _ in 0..rounds {
                run(&*b);
            }
            continue;
        }
        let (_, he, tse) = run(&*e);
        let (_, hb, tsb) = run(&*b);
        let mut r = vec![];
        let (mut me, mut mb) = (vec![], vec![]);
        for _ in 0..rounds {
            let x = run(&*e).0;
            let y = run(&*b).0;
            let y2 = run(&*b).0;
            let x2 = run(&*e).0;
            r.push((x + x2) / (y + y2));
            me.push(x.min(x2));
            mb.push(y.min(y2));
        }
        r.sort_by(f64::total_cmp);
        me.sort_by(f64::total_cmp);
        mb.sort_by(f64::total_cmp);
        println!(
            "{name:5} ratio {:.3} [{:.3} {:.3}]  embree {:.2} bvh {:.2} Mray/s  hits {he} {hb} t {:.3e}",
            r[r.len() / 2],
            r[0],
            r[r.len() - 1],
            rays as f64 / me[me.len() / 2] / 1e6,
            rays as f64 / mb[mb.len() / 2] / 1e6,
            (tse - tsb).abs() / tse.max(1e-9)
        );
    }
}
