//! Checks the shapes: area, convexity, mesh files, materials.

use glam::{DAffine3, DVec3};

use crate::scene::checked::{CheckedShape, MeshColor, Role, ShapeKind, Smooth, Trimesh};
use crate::scene::description::{
    MeshColorDescription, ShapeCommon, ShapeDescription, SmoothDescription, TriMeshDescription,
};
use crate::scene::node::NodeKind;

use super::affine::affine;
use super::context::Check;
use super::geometry::{QuadFault, is_flat, quad_fault};
use super::materials::Materials;

impl Check<'_, '_> {
    /// Checks `/scene/shapes` and makes the checked shapes. Copies of meshes come last, with the
    /// names of their meshes.
    pub(super) fn shapes(&mut self, materials: &mut Materials) -> Vec<CheckedShape> {
        let (mut shapes, mut copies) = (Vec::new(), Vec::new());
        for i in 0..self.count("/scene/shapes") {
            let pointer = format!("/scene/shapes/{i}");
            let material = self.material_of(&pointer, materials);
            let Some(shape) = self.part::<ShapeDescription>(&pointer) else {
                continue;
            };
            let name = self.name(&format!("{pointer}/name"), &shape.common().name);
            let mut kind = self.shape_kind(&pointer, &shape);
            let instances = self.instances(&pointer, &shape);
            let hides = |material: usize| materials.all[material].texture.is_some();
            if let (ShapeKind::Trimesh(mesh), true) = (&kind, material.is_some_and(hides)) {
                self.warn_about_hidden_color(&pointer, mesh);
            }
            let role = self.role(&pointer, shape.common());
            let &ShapeCommon { visible, semantic, .. } = shape.common();
            let Some(material) = material else { continue };
            let mut instances = instances.into_iter().map(Box::new);
            if let ShapeKind::Trimesh(mesh) = &mut kind {
                mesh.transform = instances.next();
            }
            let of = shapes.len();
            for transform in instances {
                let (name, kind) = (name.clone(), ShapeKind::Instance { of, transform });
                copies.push(CheckedShape { name, material, kind, visible, role, semantic });
            }
            shapes.push(CheckedShape { name, material, kind, visible, role, semantic });
        }
        shapes.append(&mut copies);
        shapes
    }

    /// Checks the `instances` of a mesh. Returns their transforms; none without the key.
    fn instances(&mut self, pointer: &str, shape: &ShapeDescription) -> Vec<DAffine3> {
        let ShapeDescription::TriMesh(TriMeshDescription {
            instances: Some(written), points, ..
        }) = shape
        else {
            return Vec::new();
        };
        let pointer = format!("{pointer}/instances");
        if points.is_some() {
            let message = "found with `points`, expected a mesh of faces";
            let help = "list the file once for each copy of the points";
            self.problems.error(&pointer, message, Some(help.into()));
        }
        let mut transforms = Vec::with_capacity(written.len());
        for (i, matrix) in written.iter().enumerate() {
            match affine(matrix) {
                Ok(transform) => transforms.push(transform),
                Err((message, help)) => {
                    let help = help.map(String::from);
                    self.problems.error(&format!("{pointer}/{i}"), message, help);
                }
            }
        }
        transforms
    }

    /// Checks the keys for compositing over a plate: `visible`, `holdout` and `shadow_catcher`.
    fn role(&mut self, pointer: &str, shape: &ShapeCommon) -> Role {
        let &ShapeCommon { visible, holdout, shadow_catcher: catcher, .. } = shape;
        let key = if holdout { "holdout" } else { "shadow_catcher" };
        if holdout && catcher {
            let message = "found `shadow_catcher` with `holdout`, expected one of them: a holdout has no alpha";
            self.problems.error(&format!("{pointer}/shadow_catcher"), message, None);
        }
        if (holdout || catcher) && !visible.camera {
            let message = format!(
                "found `{key}` with `visible.camera` false, expected a shape that camera rays hit"
            );
            let help = format!("leave out `{key}`, or set `visible.camera` to true");
            self.problems.error(&format!("{pointer}/{key}"), message, Some(help));
        }
        if visible.kinds() == [false; 3] {
            let message = "found a shape that no ray can hit: it has no effect";
            self.problems.warn(&format!("{pointer}/visible"), message, None);
        }
        match (holdout, catcher) {
            (true, _) => Role::Holdout,
            (false, true) => Role::ShadowCatcher,
            (false, false) => Role::Surface,
        }
    }

    fn shape_kind(&mut self, pointer: &str, shape: &ShapeDescription) -> ShapeKind {
        match shape {
            ShapeDescription::Sphere(s) => {
                ShapeKind::Sphere { center: s.center.vec(), radius: s.radius, pole: s.pole as u8 }
            }
            ShapeDescription::Plane(s) => {
                let corners = [s.v0.vec(), s.v1.vec(), s.v2.vec(), s.v3.vec()];
                self.quad(pointer, &corners);
                ShapeKind::Plane { corners }
            }
            ShapeDescription::Triangle(s) => {
                let corners = [s.v0.vec(), s.v1.vec(), s.v2.vec()];
                let [v0, v1, v2] = corners;
                if is_flat(v1 - v0, v2 - v0) {
                    let message =
                        "found a triangle of zero area, expected v0, v1 and v2 not on one line";
                    self.problems.error(pointer, message, None);
                }
                ShapeKind::Triangle { corners }
            }
            ShapeDescription::TriMesh(s) => ShapeKind::Trimesh(Box::new(self.trimesh(pointer, s))),
        }
    }

    fn quad(&mut self, pointer: &str, corners: &[DVec3; 4]) {
        let Some(fault) = quad_fault(corners) else {
            return;
        };
        let in_order = || Some("list the corners in order around the quad".to_string());
        let (at, message, help) = match fault {
            QuadFault::NoArea => (
                pointer.to_string(),
                "found a quad of zero area, expected four corners in order around it".to_string(),
                in_order(),
            ),
            QuadFault::Coincident(i) => {
                let next = (i + 1) % 4;
                let message =
                    format!("found v{i} equal to v{next}, expected four different corners");
                (format!("{pointer}/v{next}"), message, Some("use a `triangle`".to_string()))
            }
            QuadFault::OutOfPlane(off) => {
                let message = format!(
                    "found corners out of the quad's plane by {off:.2e} of the longest edge, expected at most 1e-4"
                );
                (pointer.to_string(), message, Some("use two triangles".to_string()))
            }
            QuadFault::Concave(i) => {
                let message =
                    format!("found a quad that is not convex at v{i}, expected a convex one");
                (format!("{pointer}/v{i}"), message, in_order())
            }
        };
        self.problems.error(&at, message, help);
    }

    fn trimesh(&mut self, pointer: &str, mesh: &TriMeshDescription) -> Trimesh {
        let place = format!("{pointer}/path");
        Trimesh {
            place: self.document.place(&place),
            path: self.mesh_file(&place, &mesh.path.0),
            fit: mesh.fit,
            rotate_deg: mesh.rotate.0.into(),
            size: mesh.size,
            center: mesh.center.vec(),
            smooth: (&mesh.smooth).into(),
            bvh: mesh.bvh,
            vertex_colors: mesh.vertexcolors,
            vertex_color_space: mesh.vertexcolorspace,
            points: mesh.points,
            color: mesh.color.as_ref().map(|color| self.mesh_color(pointer, color)),
            transform: None,
        }
    }

    fn mesh_color(&mut self, shape: &str, color: &MeshColorDescription) -> MeshColor {
        let pointer = format!("{shape}/color");
        if let Some(node) = self.document.get(&format!("{shape}/vertexcolors")) {
            if matches!(node.kind, NodeKind::Bool(false)) {
                let message = "found with `vertexcolors` false, expected one of the two";
                self.problems.error(&pointer, message, Some("leave `vertexcolors` out".into()));
            }
        }
        let mut place = pointer.clone();
        if let MeshColorDescription::Property(color) = color {
            if let Some([low, high]) = color.range.filter(|[low, high]| low == high) {
                let message = format!("found [{low}, {high}], expected two different numbers");
                self.problems.error(&format!("{pointer}/range"), message, None);
            }
            place += "/property";
        }
        MeshColor { place: self.document.place(&place), color: color.clone() }
    }

    fn warn_about_hidden_color(&mut self, pointer: &str, mesh: &Trimesh) {
        if mesh.color.is_some() {
            let message =
                "found `color` and a material with `tPath`; the texture hides the colours";
            self.problems.warn(&format!("{pointer}/color"), message, None);
        }
    }
}

impl From<&SmoothDescription> for Smooth {
    fn from(smooth: &SmoothDescription) -> Self {
        match smooth {
            SmoothDescription::Everywhere(false) => Self::Off,
            SmoothDescription::Everywhere(true) => Self::All,
            SmoothDescription::Below(crease) => {
                Self::Below { angle: crease.angle, flat: crease.flat.unwrap_or(crease.angle) }
            }
        }
    }
}
