//! Renders a scene, mesh or file to a film, and converts the film to arrays and files.

use std::path::PathBuf;

use lightpath::{
    ChannelKind, Film, MakeMesh, MeshArrays, PictureWriter, Problem, Views as SceneViews,
};
use pyo3::prelude::*;

use crate::arrays::copied;
use crate::mesh::{NumpyMesh, VertexColors};
use crate::{errors, pools, watch};

/// A rendered film, with what is needed to write it to files.
#[pyclass(frozen, module = "lightpath._lightpath")]
pub struct Picture {
    film: Film,
    writer: PictureWriter,
}

type Any<'py> = Bound<'py, PyAny>;

/// What to render.
#[derive(FromPyObject)]
pub enum Subject<'py> {
    /// A scene as JSON text, and meshes: name, material, vertices, faces.
    Text(String, Vec<(String, String, Any<'py>, Any<'py>)>),
    /// Vertices and faces of a mesh, to show in the studio, and colours of its vertices.
    Mesh(Any<'py>, Any<'py>, Option<Any<'py>>),
    /// A scene file (`.json`), or a mesh file to show in the studio.
    File(PathBuf),
}

/// A subject that is rendered from one camera after another.
#[pyclass(module = "lightpath._lightpath")]
pub struct Views {
    views: SceneViews,
    threads: Option<usize>,
}

#[pymethods]
impl Views {
    #[new]
    fn new(subject: Subject<'_>, threads: Option<usize>) -> PyResult<Self> {
        let views = match subject {
            Subject::File(path) => SceneViews::of_file(path),
            Subject::Mesh(vertices, faces, colors) => {
                let mesh = NumpyMesh::new(&vertices, &faces)?;
                let colors = colors.map(|colors| VertexColors::new(&colors)).transpose()?;
                SceneViews::of_mesh(in_studio(mesh, colors))
            }
            Subject::Text(text, meshes) => {
                let mut ready: Vec<(String, String, MakeMesh)> = Vec::new();
                for (name, material, vertices, faces) in meshes {
                    let (mesh, place) = (NumpyMesh::new(&vertices, &faces)?, format!("{name}: "));
                    ready.push((name, material, Box::new(move || mesh.to_mesh(&place))));
                }
                SceneViews::of_scene(&text, ready)
            }
        };
        Ok(Self { views, threads })
    }

    /// Renders the picture of one camera. `overrides` have the form `/json/pointer=VALUE`.
    fn render(
        &mut self,
        py: Python<'_>,
        overrides: Vec<String>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Picture> {
        let pool = pools::pool(py, self.threads)?;
        let views = &mut self.views;
        watch::run(py, &pool, usize::MAX, progress, |monitor| {
            let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
            let (film, writer) = views.render(&overrides, monitor)?;
            Ok(Picture { film, writer })
        })
    }
}

/// Returns how to make a mesh for the studio: again for each camera that is framed anew.
fn in_studio(arrays: NumpyMesh, colors: Option<VertexColors>) -> MakeMesh {
    Box::new(move || {
        let mut mesh = arrays.to_mesh("")?;
        if let Some(VertexColors { colors, alpha }) = colors.clone() {
            (mesh.colors, mesh.alpha) = (Some(colors), alpha);
        }
        Ok(mesh)
    })
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
        texts(self.writer.warnings().to_vec())
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
        let written = py.detach(|| pool.install(|| writer.write(&self.film, prefix)));
        let written = written.map_err(|error| errors::to_python(py, error))?;
        let [exr, png] = written.files;
        Ok([(exr, texts(written.warnings)), (png, texts(written.png_warnings))])
    }
}
