//! Renders a scene, mesh or file to a film, and converts the film to arrays and files.

use std::path::PathBuf;
use std::sync::Arc;

use lightpath::scene::IN_MEMORY;
use lightpath::{ChannelKind, Film, LoadedScene, MeshArrays, Monitor, PictureWriter, Problem};
use pyo3::prelude::*;

use crate::arrays::copied;
use crate::mesh::{NumpyMesh, VertexColors};
use crate::{errors, pools, watch};

/// A rendered film, with the scene and the settings that are needed to write it to files.
#[pyclass(frozen, module = "lightpath._lightpath")]
pub struct Picture {
    loaded: Arc<LoadedScene>,
    film: Film,
    writer: PictureWriter,
}

/// What to render.
#[derive(FromPyObject)]
pub enum Subject<'py> {
    /// A scene as JSON text, and meshes: name, material, vertices, faces.
    Text(String, Vec<(String, String, Bound<'py, PyAny>, Bound<'py, PyAny>)>),
    /// Vertices and faces of a mesh, to show in the studio, and colours of its vertices.
    Mesh(Bound<'py, PyAny>, Bound<'py, PyAny>, Option<Bound<'py, PyAny>>),
    /// A scene file (`.json`), or a mesh file to show in the studio.
    File(PathBuf),
}

/// Renders a subject. `overrides` have the form `/json/pointer=VALUE`.
#[pyfunction]
pub fn render(
    py: Python<'_>,
    subject: Subject<'_>,
    overrides: Vec<String>,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Picture> {
    let pool = pools::pool(py, threads)?;
    let source = Source::new(subject)?;
    watch::run(py, &pool, usize::MAX, progress, |monitor| {
        let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
        let loaded = Arc::new(source.load(&overrides, monitor)?);
        let renderer = loaded.renderer_watched(monitor)?;
        let film = renderer.render_watched(monitor)?;
        let writer = renderer.writer();
        Ok(Picture { loaded: Arc::clone(&loaded), film, writer })
    })
}

enum Source {
    Text(String, Vec<(String, String, NumpyMesh)>),
    Studio(NumpyMesh, Option<VertexColors>),
    File(PathBuf),
}

impl Source {
    fn new(subject: Subject<'_>) -> PyResult<Self> {
        match subject {
            Subject::File(path) => Ok(Self::File(path)),
            Subject::Mesh(vertices, faces, colors) => {
                let colors = colors.map(|colors| VertexColors::new(&colors)).transpose()?;
                Ok(Self::Studio(NumpyMesh::new(&vertices, &faces)?, colors))
            }
            Subject::Text(text, meshes) => {
                let mut ready = Vec::new();
                for (name, material, vertices, faces) in meshes {
                    ready.push((name, material, NumpyMesh::new(&vertices, &faces)?));
                }
                Ok(Self::Text(text, ready))
            }
        }
    }

    fn load(self, overrides: &[&str], monitor: &Monitor) -> lightpath::Result<LoadedScene> {
        match self {
            Self::Text(text, meshes) => {
                let mut ready = Vec::new();
                for (name, material, arrays) in &meshes {
                    ready.push((&name[..], &material[..], arrays.to_mesh(&format!("{name}: "))?));
                }
                LoadedScene::with_meshes_watched(&text, overrides, ready, monitor)
            }
            Self::Studio(arrays, colors) => {
                let mut mesh = arrays.to_mesh("")?;
                if let Some(VertexColors { colors, alpha }) = colors {
                    (mesh.colors, mesh.alpha) = (Some(colors), alpha);
                }
                LoadedScene::in_studio_watched(mesh, IN_MEMORY, overrides, monitor)
            }
            Self::File(path) => {
                let is_scene = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"));
                if is_scene {
                    return LoadedScene::read_watched(path, overrides, monitor);
                }
                LoadedScene::read_in_studio_watched(&path, overrides, monitor)
            }
        }
    }
}

/// Returns warnings as texts, one each.
fn texts(warnings: Vec<Problem>) -> Vec<String> {
    warnings.into_iter().map(|warning| errors::translated(warning).to_string()).collect()
}

#[pymethods]
impl Picture {
    /// Height and width in pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (self.film.window.height(), self.film.window.width())
    }

    /// Warnings of the scene, as texts.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        texts(self.loaded.warnings().to_vec())
    }

    /// R, G, B, A of all pixels, row by row, as an array of one dimension.
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        copied(py, self.film.pixels.as_flattened(), "pixels")
    }

    /// Names of the layer channels, and whether they hold integers.
    #[getter]
    fn channels(&self) -> Vec<(String, bool)> {
        let channels = self.film.planes.channels.iter();
        channels.map(|c| (c.name.clone(), c.kind == ChannelKind::Uint)).collect()
    }

    /// The words of the layer channels, pixel by pixel, as an array of one dimension.
    fn words<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        copied(py, &self.film.planes.words, "layers")
    }

    /// Writes PREFIX.exr, of 32-bit floats or of halves, and PREFIX.png. Returns the path of each,
    /// with warnings about what it does not hold.
    fn write(
        &self,
        py: Python<'_>,
        prefix: PathBuf,
        float: bool,
    ) -> PyResult<[(PathBuf, Vec<String>); 2]> {
        let pool = pools::pool(py, None)?;
        let writer = self.writer.clone().float(float);
        let written = py.detach(|| pool.install(|| writer.write(&self.loaded, &self.film, prefix)));
        let written = written.map_err(|error| errors::to_python(py, error))?;
        let [exr, png] = written.files;
        Ok([(exr, texts(written.warnings)), (png, texts(written.png_warnings))])
    }
}
