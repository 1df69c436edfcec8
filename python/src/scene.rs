//! The class behind `lightpath.RayScene`.

use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, PoisonError};

use lightpath::{Limits, MeshArrays, Monitor, RayBatch, RayScene};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::arrays::{Triples, column, rows, table};
use crate::mesh::NumpyMesh;
use crate::pools::Pool;
use crate::{errors, pools, watch};

type Any<'py> = Bound<'py, PyAny>;
type Progress<'a, 'py> = Option<&'a Any<'py>>;
type Answer<T> = lightpath::Result<T>;

/// A scene, and the number of threads of its queries.
#[pyclass(frozen, module = "lightpath._lightpath")]
pub struct Scene {
    scene: RayScene,
    threads: Option<usize>,
    /// The pool of its latest use, whose threads would end without it.
    kept: Mutex<Arc<Pool>>,
    /// Whether `contains` has found which meshes are closed.
    knows_closed: AtomicBool,
    /// Whether `winding_number` has computed the multipole expansions of the tree.
    knows_multipoles: AtomicBool,
}

/// Rays as Python passes them: origins, directions, tnear and tfar. The last two are arrays of one
/// value for all rays, or of one value per ray.
#[derive(FromPyObject)]
pub struct PyRays<'py>(
    Triples<'py>,
    Triples<'py>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
);

impl PyRays<'_> {
    fn len(&self) -> PyResult<usize> {
        Ok(rows(&self.0)?.len())
    }
}

fn limits(values: &[f64]) -> Limits<'_> {
    if let [one] = values { Limits::All(*one) } else { Limits::Each(values) }
}

impl Scene {
    /// Returns the pool of this scene, and keeps it. After a fork, it is another one.
    fn pool(&self, py: Python<'_>) -> PyResult<Arc<Pool>> {
        let pool = pools::pool(py, self.threads)?;
        *self.kept.lock().unwrap_or_else(PoisonError::into_inner) = Arc::clone(&pool);
        Ok(pool)
    }

    /// Number of faces of all meshes.
    fn faces(&self) -> usize {
        self.scene.meshes().iter().map(|mesh| mesh.faces().len()).sum()
    }

    fn with_rays<T: Send>(
        &self,
        py: Python<'_>,
        rays: &PyRays<'_>,
        progress: Progress<'_, '_>,
        query: impl FnOnce(&RayScene, &RayBatch, &Monitor) -> Answer<T> + Send,
    ) -> PyResult<T> {
        let (origins, directions) = (rows(&rays.0)?, rows(&rays.1)?);
        let (tnear, tfar) = (limits(rays.2.as_slice()?), limits(rays.3.as_slice()?));
        let (pool, scene) = (self.pool(py)?, &self.scene);
        watch::run(py, &pool, rays.len()?, progress, move |monitor| {
            let rays = RayBatch::new(origins, directions)?.with_limits(tnear, tfar)?;
            query(scene, &rays, monitor)
        })
    }

    /// The first query with the flag `prepared` computes something of every face, and sets it.
    fn with_points<T: Send>(
        &self,
        py: Python<'_>,
        points: &Triples<'_>,
        progress: Progress<'_, '_>,
        prepared: Option<&AtomicBool>,
        query: impl FnOnce(&RayScene, &[[f64; 3]], &Monitor) -> Answer<T> + Send,
    ) -> PyResult<T> {
        let (points, pool, scene) = (rows(points)?, self.pool(py)?, &self.scene);
        // A point costs more than a ray, so fewer points need watching.
        let items = points.len().saturating_mul(16);
        let is_first = prepared.is_some_and(|prepared| !prepared.load(Relaxed));
        let items = items.saturating_add(if is_first { self.faces() } else { 0 });
        let answer =
            watch::run(py, &pool, items, progress, move |monitor| query(scene, points, monitor))?;
        prepared.inspect(|prepared| prepared.store(true, Relaxed));
        Ok(answer)
    }
}

#[pymethods]
impl Scene {
    #[new]
    fn new(
        py: Python<'_>,
        meshes: Vec<(Any<'_>, Any<'_>)>,
        threads: Option<usize>,
        backend: &str,
        progress: Progress<'_, '_>,
    ) -> PyResult<Self> {
        let backend = backend.parse().map_err(|error| errors::to_python(py, error))?;
        let mut arrays: Vec<Box<dyn MeshArrays>> = Vec::new();
        for (vertices, faces) in &meshes {
            arrays.push(Box::new(NumpyMesh::new(vertices, faces)?));
        }
        let items = arrays.iter().map(|mesh| mesh.faces().len()).sum();
        let pool = pools::pool(py, threads)?;
        let build = |monitor: &Monitor| RayScene::with_backend(arrays, backend, monitor);
        let scene = watch::run(py, &pool, items, progress, build)?;
        let [knows_closed, knows_multipoles] = Default::default();
        Ok(Self { scene, threads, kept: Mutex::new(pool), knows_closed, knows_multipoles })
    }

    #[getter]
    fn bytes(&self) -> (u64, u64) {
        (self.scene.bytes(), self.scene.peak_bytes())
    }

    #[getter]
    fn bounds(&self) -> [[f64; 3]; 2] {
        self.scene.bounds()
    }

    fn closed(&self, py: Python<'_>) -> PyResult<Vec<bool>> {
        let (pool, scene) = (self.pool(py)?, &self.scene);
        watch::run(py, &pool, self.faces(), None, |monitor| Ok(scene.closed(monitor)?.to_vec()))
    }

    fn closest<'py>(
        &self,
        py: Python<'py>,
        rays: PyRays<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<(Any<'py>, Any<'py>, Any<'py>, Any<'py>, Any<'py>)> {
        let hits = self.with_rays(py, &rays, progress, |scene, rays, m| scene.closest(rays, m))?;
        let ids = (column(py, hits.primitive), column(py, hits.mesh));
        let (weights, normal) = (table(py, hits.barycentrics)?, table(py, hits.normal)?);
        Ok((column(py, hits.t), ids.0, ids.1, weights, normal))
    }

    fn occluded<'py>(
        &self,
        py: Python<'py>,
        rays: PyRays<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let all = self.with_rays(py, &rays, progress, |scene, rays, m| scene.occluded(rays, m))?;
        Ok(column(py, all))
    }

    fn count<'py>(
        &self,
        py: Python<'py>,
        rays: PyRays<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let all = self.with_rays(py, &rays, progress, |scene, rays, m| scene.count(rays, m))?;
        Ok(column(py, all))
    }

    fn all_hits<'py>(
        &self,
        py: Python<'py>,
        rays: PyRays<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<(Any<'py>, Any<'py>, Any<'py>, Any<'py>, Any<'py>)> {
        let hits = self.with_rays(py, &rays, progress, |scene, rays, m| scene.all_hits(rays, m))?;
        let ids = (column(py, hits.primitive), column(py, hits.mesh));
        let weights = table(py, hits.barycentrics)?;
        Ok((column(py, hits.offsets), column(py, hits.t), ids.0, ids.1, weights))
    }

    fn contains<'py>(
        &self,
        py: Python<'py>,
        points: Triples<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let query = |scene: &RayScene, p: &[[f64; 3]], m: &Monitor| scene.contains(p, m);
        let all = self.with_points(py, &points, progress, Some(&self.knows_closed), query)?;
        Ok(column(py, all))
    }

    fn winding_number<'py>(
        &self,
        py: Python<'py>,
        points: Triples<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let query = |scene: &RayScene, p: &[[f64; 3]], m: &Monitor| scene.winding_number(p, m);
        let prepared = Some(&self.knows_multipoles);
        Ok(column(py, self.with_points(py, &points, progress, prepared, query)?))
    }

    fn closest_point<'py>(
        &self,
        py: Python<'py>,
        points: Triples<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<(Any<'py>, Any<'py>, Any<'py>, Any<'py>)> {
        let query = |scene: &RayScene, p: &[[f64; 3]], m: &Monitor| scene.closest_point(p, m);
        let all = self.with_points(py, &points, progress, None, query)?;
        let ids = (column(py, all.primitive), column(py, all.mesh));
        Ok((table(py, all.point)?, column(py, all.distance), ids.0, ids.1))
    }

    fn visible<'py>(
        &self,
        py: Python<'py>,
        points: Triples<'py>,
        from: Triples<'py>,
        progress: Progress<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let from = rows(&from)?;
        let all = self.with_points(py, &points, progress, None, move |scene, points, m| {
            scene.visible(points, from, m).map_err(|mut error| {
                // `from` is a keyword in Python.
                let problems = error.problems.iter_mut();
                problems.for_each(|p| p.place = p.place.replacen("from", "from_", 1));
                error
            })
        })?;
        Ok(column(py, all))
    }

    /// The library's error for invalid input, for tests of the mapping.
    #[staticmethod]
    fn refuse(py: Python<'_>, place: String, message: String) -> PyErr {
        errors::to_python(py, lightpath::Error::invalid(place, message))
    }
}
