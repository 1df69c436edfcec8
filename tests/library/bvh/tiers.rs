//! One geometry, one tree per instruction set, and one answer per ray.

use lightpath::accel::bvh::Bvh;
use lightpath::accel::{Accelerator, BuildOptions, Cone, Shaft};
use lightpath::geometry::Geometry;
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, Mask, NONE, RayPacket, Rays};
use lightpath::simd::Isa;

pub const ALL: Mask = Mask::ALL;

/// Every mode of a query.
const WAYS: [Coherence; 3] = [Coherence::Single, Coherence::Unordered, Coherence::Coherent];

/// How far apart the weights of two modes may be: each is off by 1.5 / 1024.
const APART: f32 = 1.0 / 256.0;

/// The closest hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Number of the primitive in the whole scene.
    pub primitive: u32,
    pub t: f32,
}

pub const OPTIONS: BuildOptions = BuildOptions { threads: 1, max_bytes: None };

/// Builds a tree and validates it.
pub fn build(geometry: &Geometry, isa: Isa) -> Bvh<'_> {
    let bvh = Bvh::build(geometry, isa, &OPTIONS, &Monitor::default()).expect("a tree");
    if let Err(wrong) = bvh.validate() {
        panic!("{isa}: {wrong}");
    }
    bvh
}

/// The trees of every instruction set that this machine supports.
pub struct Tiers<'g> {
    geometry: &'g Geometry,
    trees: Vec<(Isa, Bvh<'g>)>,
}

impl<'g> Tiers<'g> {
    pub fn new(geometry: &'g Geometry) -> Self {
        Self { geometry, trees: Isa::available().map(|isa| (isa, build(geometry, isa))).collect() }
    }

    /// Builds only the tree of the best instruction set.
    pub fn best(geometry: &'g Geometry) -> Self {
        let isa = Isa::detect();
        Self::of(geometry, isa, build(geometry, isa))
    }

    /// Takes one tree.
    pub fn of(geometry: &'g Geometry, isa: Isa, tree: Bvh<'g>) -> Self {
        Self { geometry, trees: vec![(isa, tree)] }
    }

    /// Returns the number of instruction sets that report the cone of the active rays as empty.
    pub fn reporting_empty(&self, active: &Mask, rays: &Rays) -> usize {
        self.trees.iter().filter(|(_, tree)| tree.cone(active, rays) == Some(Cone::Empty)).count()
    }

    /// Returns the number of instruction sets that report the shaft as empty.
    pub fn reporting_empty_shaft(&self, shaft: &Shaft) -> usize {
        self.trees.iter().filter(|(_, tree)| tree.is_shaft_empty(shaft) == Some(true)).count()
    }

    /// Returns the tree of the best instruction set.
    pub fn last(&self) -> &dyn Accelerator {
        &self.trees[self.trees.len() - 1].1
    }

    /// Returns the hits of the active rays.
    ///
    /// # Panics
    /// If two instruction sets or modes differ in the primitive or in a bit of t, or by more than
    /// [`APART`] in the weights, if a ray is occluded without a closest hit or the other way round,
    /// or if an inactive lane is written to.
    pub fn trace(&self, active: &Mask, rays: &Rays) -> [Option<Hit>; LANES] {
        let mut agreed = None;
        for (tree, bvh) in &self.trees {
            for way in WAYS {
                let (hits, weights) = self.closest(bvh, active, rays, way);
                let (expected, places) = *agreed.get_or_insert((hits, weights));
                for i in 0..LANES {
                    let (found, expected) = (hits[i], expected[i]);
                    assert_eq!(found, expected, "{tree} {way:?} lane {i}: {}", ray(rays, i));
                    let ([u, v], place) = (weights[i], places[i]);
                    // False for NaN.
                    let near = |a: f32, b: f32| (a - b).abs() <= APART;
                    let is_near = near(u, place[0]) && near(v, place[1]);
                    assert!(
                        is_near,
                        "{tree} {way:?} lane {i}: {u} {v} {place:?}: {}",
                        ray(rays, i)
                    );
                }
                let mut after = rays.clone();
                bvh.occluded(active, &mut after, way);
                for i in 0..LANES {
                    let stopped = hits[i].is_some();
                    let end = if stopped { f32::NEG_INFINITY } else { rays.tfar[i] };
                    assert_eq!(
                        after.tfar[i].to_bits(),
                        end.to_bits(),
                        "{tree} {way:?} lane {i}, hit {:?}: {}",
                        hits[i],
                        ray(rays, i)
                    );
                }
            }
        }
        agreed.expect("one tier at least").0
    }

    /// Returns the hits of the active rays and their weights.
    fn closest(
        &self,
        bvh: &Bvh,
        active: &Mask,
        rays: &Rays,
        way: Coherence,
    ) -> ([Option<Hit>; LANES], [[f32; 2]; LANES]) {
        let mut packet = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
        bvh.closest(active, &mut packet, way);
        let hits = std::array::from_fn(|i| {
            let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
            if active.0[i] == 0 || geom == NONE {
                assert_eq!((geom, prim), (NONE, NONE), "lane {i}");
                assert_eq!(packet.rays.tfar[i].to_bits(), rays.tfar[i].to_bits(), "lane {i}");
                return None;
            }
            for weight in [packet.hits.u[i], packet.hits.v[i]] {
                assert!((0.0..=1.0).contains(&weight), "{weight}: {}", ray(rays, i));
            }
            let primitive = self.geometry.primitive(geom, prim);
            Some(Hit { primitive, t: packet.rays.tfar[i] })
        });
        (hits, std::array::from_fn(|i| [packet.hits.u[i], packet.hits.v[i]]))
    }
}

/// Formats a ray for messages.
pub fn ray(rays: &Rays, i: usize) -> String {
    let of = |v: &[[f32; LANES]; 3]| v.map(|lanes| lanes[i]);
    format!(
        "from {:?} along {:?}, t in ({:?}, {:?}), leaves {}",
        of(&rays.org),
        of(&rays.dir),
        rays.tnear[i],
        rays.tfar[i],
        rays.leaving[i]
    )
}

/// Sets origin and direction of a ray.
pub fn put(rays: &mut Rays, i: usize, origin: [f32; 3], direction: [f32; 3]) {
    for axis in 0..3 {
        rays.org[axis][i] = origin[axis];
        rays.dir[axis][i] = direction[axis];
    }
}
