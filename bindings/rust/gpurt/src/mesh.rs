//! Geometries.
use std::fmt;

use crate::{sys, Array, MaterialId, SubdivisionScheme};

/// A triangle mesh: its vertices alone form triangles three by three, or [`indices`](Mesh::indices) do.
///
/// Degenerate triangles are legal and never hit. The counter-clockwise side is the front.
#[derive(Clone, Copy)]
#[must_use]
pub struct Mesh<'a> {
    material: MaterialId,
    vertices: Array<'a, [f32; 3]>,
    indices: Option<Array<'a, [u32; 3]>>,
    normals: Option<Array<'a, [f32; 3]>>,
    uvs: Option<Array<'a, [f32; 2]>>,
}

impl<'a> Mesh<'a> {
    /// A flat-shaded mesh of white Lambertian material; vertices in metres, object space.
    pub fn new(vertices: impl Into<Array<'a, [f32; 3]>>) -> Self {
        Mesh {
            material: MaterialId::default(),
            vertices: vertices.into(),
            indices: None,
            normals: None,
            uvs: None,
        }
    }

    /// The corners of each triangle.
    pub fn indices(mut self, indices: impl Into<Array<'a, [u32; 3]>>) -> Self {
        self.indices = Some(indices.into());
        self
    }

    /// Shading normals at the vertices, of any length; zero: that of the faces around.
    pub fn normals(mut self, normals: impl Into<Array<'a, [f32; 3]>>) -> Self {
        self.normals = Some(normals.into());
        self
    }

    /// Texture coordinates at the vertices.
    pub fn uvs(mut self, uvs: impl Into<Array<'a, [f32; 2]>>) -> Self {
        self.uvs = Some(uvs.into());
        self
    }

    /// The material of all triangles.
    pub fn material(mut self, material: MaterialId) -> Self {
        self.material = material;
        self
    }

    pub(crate) fn raw(&self) -> sys::gpurt_mesh_desc {
        sys::gpurt_mesh_desc {
            material: self.material.0,
            vertices: self.vertices.raw,
            indices: self.indices.map(|array| array.raw).unwrap_or_default(),
            normals: self.normals.map(|array| array.raw).unwrap_or_default(),
            uvs: self.uvs.map(|array| array.raw).unwrap_or_default(),
            ..Default::default()
        }
    }
}

impl fmt::Debug for Mesh<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.raw().fmt(f)
    }
}

/// Bicubic Bézier patches. For rays they are tessellated at commit: each becomes as many triangles as
/// it needs, patch by patch, and a hit's primitive is one of these.
#[derive(Clone, Copy)]
#[must_use]
pub struct Patches<'a> {
    material: MaterialId,
    control_points: Array<'a, [f32; 3]>,
}

impl<'a> Patches<'a> {
    /// 16 control points a patch: point 4·row + column, u along columns.
    pub fn new(control_points: impl Into<Array<'a, [f32; 3]>>) -> Self {
        Patches { material: MaterialId::default(), control_points: control_points.into() }
    }

    /// The material of all patches.
    pub fn material(mut self, material: MaterialId) -> Self {
        self.material = material;
        self
    }

    pub(crate) fn raw(&self) -> sys::gpurt_patches_desc {
        sys::gpurt_patches_desc {
            material: self.material.0,
            control_points: self.control_points.raw,
            ..Default::default()
        }
    }
}

impl fmt::Debug for Patches<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.raw().fmt(f)
    }
}

/// A subdivision surface. This version of the library does not support it.
#[derive(Clone, Copy)]
#[must_use]
pub struct Subdivision<'a> {
    material: MaterialId,
    scheme: SubdivisionScheme,
    vertices: Array<'a, [f32; 3]>,
    face_counts: Array<'a, u32>,
    indices: Array<'a, u32>,
}

impl<'a> Subdivision<'a> {
    /// A cage: how many corners each face has, and the corners of all faces.
    pub fn new(
        scheme: SubdivisionScheme,
        vertices: impl Into<Array<'a, [f32; 3]>>,
        face_counts: impl Into<Array<'a, u32>>,
        indices: impl Into<Array<'a, u32>>,
    ) -> Self {
        Subdivision {
            material: MaterialId::default(),
            scheme,
            vertices: vertices.into(),
            face_counts: face_counts.into(),
            indices: indices.into(),
        }
    }

    /// The material of the surface.
    pub fn material(mut self, material: MaterialId) -> Self {
        self.material = material;
        self
    }

    pub(crate) fn raw(&self) -> sys::gpurt_subdivision_desc {
        sys::gpurt_subdivision_desc {
            material: self.material.0,
            scheme: self.scheme as u32,
            vertices: self.vertices.raw,
            face_counts: self.face_counts.raw,
            indices: self.indices.raw,
            ..Default::default()
        }
    }
}

impl fmt::Debug for Subdivision<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.raw().fmt(f)
    }
}
