//! Meshes from arrays of a caller, and their checks.

use super::arrays::{Colors, Mesh, MeshElement, Notes, Positions, Uvs};
use crate::error::{Error, Result};
use crate::parallel;
use crate::units::{counted, plural};

/// Refuses a triangle with an index beyond the vertices, with a vertex that is not finite, or with
/// the same vertex twice.
///
/// # Errors
/// `Invalid` for the first such triangle.
fn checked(place: &str, positions: &Positions, triangles: &[[u32; 3]]) -> Result<()> {
    let count = positions.len();
    let problem = |index: usize| {
        let triangle = &triangles[index];
        if let Some(vertex) = triangle.iter().find(|&&vertex| vertex as usize >= count) {
            return Some(format!(
                "found vertex {vertex} in triangle {index}, expected less than {count}"
            ));
        }
        let [a, b, c] = *triangle;
        if a == b || b == c || c == a {
            return Some(format!("found a vertex twice in triangle {index}"));
        }
        let infinite = triangle.iter().find(|&&v| !positions.get(v as usize).is_finite());
        infinite.map(|v| format!("found vertex {v}, which is not finite"))
    };
    let runs = parallel::ranges(triangles.len(), parallel::GRAIN);
    let found = parallel::map(runs, |mut run| run.find_map(problem));
    match found.into_iter().flatten().next() {
        Some(message) => Err(Error::invalid(place, message)),
        None => Ok(()),
    }
}

impl Mesh {
    /// Makes a mesh from arrays, without normals, texture coordinates and colours. These fields can
    /// be set afterwards; a scene refuses arrays of a wrong length. Triangles without area are
    /// kept.
    ///
    /// # Errors
    /// `Invalid` for a triangle with an index beyond the vertices, with a vertex that is not
    /// finite, or with the same vertex twice. Also if there is no triangle, or if there are more
    /// than 2^32 - 2 vertices.
    pub fn new(positions: Positions, triangles: Vec<[u32; 3]>) -> Result<Self> {
        let count = positions.len();
        let refused = |message: String| Err(Error::invalid("mesh", message));
        if triangles.is_empty() || count >= u32::MAX as usize {
            let vertices = counted(count as u64, ["vertex", "vertices"]);
            return refused(format!("found {}, {vertices}", plural(triangles.len(), "triangle")));
        }
        checked("mesh", &positions, &triangles)?;
        Ok(Self {
            positions,
            triangles,
            stitches: Vec::new(),
            normals: None,
            uvs: None,
            colors: None,
            face_colors: None,
            alpha: None,
            property: None,
            texture_file: None,
            textures: None,
            notes: Notes::default(),
        })
    }

    /// Checks the arrays, which a caller may have set: indices, vertices and lengths. `place` is
    /// the name of the mesh in errors.
    ///
    /// # Errors
    /// `Invalid` for triangles as in [`Mesh::new`], and for an array of another length than the
    /// vertices or triangles whose values it has.
    pub(crate) fn check(&self, place: &str) -> Result<()> {
        checked(place, &self.positions, &self.triangles)?;
        checked(place, &self.positions, &self.stitches)?;
        let (vertices, faces) = (self.positions.len(), self.triangles.len());
        let colors = |colors: &Colors| match colors {
            Colors::U8(all) => all.len(),
            Colors::U16(all) => all.len(),
            Colors::F32(all) => all.len(),
        };
        let uvs = self.uvs.as_ref().map(|uvs| match uvs {
            Uvs::PerVertex(all) => (all.len(), vertices),
            Uvs::PerCorner(all) => (all.len(), faces),
        });
        let colored = match (&self.colors, &self.face_colors) {
            (Some(_), _) => Some(vertices),
            (None, colors) => colors.as_ref().map(|_| faces),
        };
        let property = self.property.as_ref().map(|property| match property.element {
            MeshElement::Vertex => (property.values.len(), vertices),
            MeshElement::Face => (property.values.len(), faces),
        });
        let lengths = [
            ("normals", self.normals.as_ref().map(|all| (all.len(), vertices))),
            ("uvs", uvs),
            ("colors", self.colors.as_ref().map(|all| (colors(all), vertices))),
            ("face_colors", self.face_colors.as_ref().map(|all| (colors(all), faces))),
            ("alpha", self.alpha.as_ref().and_then(|all| Some((all.len(), colored?)))),
            ("property", property),
            ("textures", self.textures.as_ref().map(|all| (all.indices.len(), faces))),
        ];
        for (name, lengths) in lengths {
            if let Some((found, expected)) = lengths.filter(|(found, expected)| found != expected) {
                let message = format!("found {found} values in `{name}`, expected {expected}");
                return Err(Error::invalid(place, message));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::arrays::{FaceTextures, Property, Scalars};
    use super::*;

    fn mesh() -> Mesh {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [f32::NAN; 3]];
        Mesh::new(Positions::F32(corners), vec![[0, 1, 2], [2, 1, 0]]).unwrap()
    }

    /// A change of a mesh.
    type Change = fn(&mut Mesh);

    #[test]
    fn arrays_of_the_right_length_are_taken() {
        let changes: [Change; 8] = [
            |m| m.normals = Some(vec![[0.0; 3]; 4]),
            |m| m.uvs = Some(Uvs::PerVertex(vec![[0.0; 2]; 4])),
            |m| m.uvs = Some(Uvs::PerCorner(vec![[[0.0; 2]; 3]; 2])),
            |m| m.colors = Some(Colors::U8(vec![[0; 3]; 4])),
            |m| m.face_colors = Some(Colors::F32(vec![[0.0; 3]; 2])),
            |m| {
                m.colors = Some(Colors::U16(vec![[0; 3]; 4]));
                m.alpha = Some(Scalars::U8(vec![0; 4]));
            },
            |m| {
                m.face_colors = Some(Colors::U16(vec![[0; 3]; 2]));
                m.alpha = Some(Scalars::F32(vec![0.0; 2]));
            },
            |m| {
                let values = Scalars::F64(vec![0.0; 2]);
                let element = MeshElement::Face;
                m.property = Some(Property { name: "q".to_string(), element, values });
            },
        ];
        for change in changes {
            let mut mesh = mesh();
            change(&mut mesh);
            mesh.check("mesh").unwrap();
        }
    }

    #[test]
    fn arrays_of_another_length_and_changed_indices_are_refused() {
        let changes: [(Change, &str); 9] = [
            (|m| m.normals = Some(vec![[0.0; 3]; 3]), "found 3 values in `normals`, expected 4"),
            (|m| m.uvs = Some(Uvs::PerVertex(vec![])), "found 0 values in `uvs`, expected 4"),
            (|m| m.uvs = Some(Uvs::PerCorner(vec![])), "found 0 values in `uvs`, expected 2"),
            (|m| m.colors = Some(Colors::U8(vec![[0; 3]; 2])), "`colors`, expected 4"),
            (|m| m.face_colors = Some(Colors::U8(vec![[0; 3]; 4])), "`face_colors`, expected 2"),
            (
                |m| {
                    m.face_colors = Some(Colors::U8(vec![[0; 3]; 2]));
                    m.alpha = Some(Scalars::U8(vec![0; 4]));
                },
                "`alpha`, expected 2",
            ),
            (
                |m| m.textures = Some(FaceTextures { files: vec![], indices: vec![0] }),
                "`textures`, expected 2",
            ),
            (|m| m.triangles[1] = [0, 1, 9], "found vertex 9 in triangle 1, expected less than 4"),
            (|m| m.triangles[1] = [0, 1, 3], "found vertex 3, which is not finite"),
        ];
        for (change, expected) in changes {
            let mut mesh = mesh();
            change(&mut mesh);
            let found = mesh.check("mesh").unwrap_err().to_string();
            assert!(found.contains(expected), "{found}");
        }
    }
}
