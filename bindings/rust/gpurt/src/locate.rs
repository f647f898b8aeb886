//! From hits on the triangles of patches back to the patches.
use std::ffi::c_void;
use std::mem::{align_of, size_of};
use std::ptr;

use crate::callback::call;
use crate::{sys, GeometryId, Hit, HitCompact, Result, Scene, INVALID_ID};

/// Where a hit lies on its patch.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct PatchPoint {
    /// The patch of its geometry, in the order of the control points; [`INVALID_ID`]: a miss.
    pub patch: u32,
    /// In [0, 1], along columns of control points.
    pub u: f32,
    /// In [0, 1], along rows.
    pub v: f32,
}

// Slices of it are what the library writes.
const _: () = assert!(size_of::<PatchPoint>() == size_of::<sys::gpurt_patch_point>());
const _: () = assert!(align_of::<PatchPoint>() == align_of::<sys::gpurt_patch_point>());

impl PatchPoint {
    /// Nothing was hit.
    pub fn is_miss(&self) -> bool {
        self.patch == INVALID_ID
    }
}

/// The surfaces of patches themselves where hits lie, in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct PatchSurface {
    /// Which patches, and where on them.
    pub points: Vec<PatchPoint>,
    /// Of the patches and not of their triangles; of a miss 0.
    pub positions: Vec<[f32; 3]>,
    /// Of unit length, along dS/du x dS/dv of the patches as they were added; of a miss 0.
    pub normals: Vec<[f32; 3]>,
}

impl Scene {
    /// Finds the patches that hits of the last commit lie on, and where on them. Misses stay misses.
    ///
    /// Fails with [`Error::InvalidArgument`](crate::Error::InvalidArgument) naming the first hit that is on a mesh, or not
    /// of the last commit.
    pub fn locate(&self, hits: &[Hit]) -> Result<Vec<PatchPoint>> {
        let mut points = vec![PatchPoint::default(); hits.len()];
        let desc = sys::gpurt_locate_desc {
            format: sys::GPURT_HIT_FULL,
            hits: hits.as_ptr() as *const c_void,
            ..Default::default()
        };
        self.locate_into(hits.len(), desc, &mut points)?;
        Ok(points)
    }

    /// As [`locate`](Scene::locate), for hits that all are of one geometry.
    pub fn locate_compact(&self, hits: &[HitCompact], geometry: GeometryId) -> Result<Vec<PatchPoint>> {
        let mut points = vec![PatchPoint::default(); hits.len()];
        let desc = sys::gpurt_locate_desc {
            format: sys::GPURT_HIT_COMPACT,
            hits: hits.as_ptr() as *const c_void,
            geometry: geometry.0,
            ..Default::default()
        };
        self.locate_into(hits.len(), desc, &mut points)?;
        Ok(points)
    }

    /// As [`locate`](Scene::locate), with the patches' own positions and normals there.
    pub fn locate_surface(&self, hits: &[Hit]) -> Result<PatchSurface> {
        let mut surface = PatchSurface {
            points: vec![PatchPoint::default(); hits.len()],
            positions: vec![[0.0; 3]; hits.len()],
            normals: vec![[0.0; 3]; hits.len()],
        };
        let desc = sys::gpurt_locate_desc {
            format: sys::GPURT_HIT_FULL,
            hits: hits.as_ptr() as *const c_void,
            positions: surface.positions.as_mut_ptr() as *mut f32,
            normals: surface.normals.as_mut_ptr() as *mut f32,
            ..Default::default()
        };
        self.locate_into(hits.len(), desc, &mut surface.points)?;
        Ok(surface)
    }

    fn locate_into(
        &self,
        num_hits: usize,
        desc: sys::gpurt_locate_desc,
        points: &mut [PatchPoint],
    ) -> Result<()> {
        let desc = sys::gpurt_locate_desc {
            num_hits: num_hits as u64,
            points: if num_hits == 0 {
                ptr::null_mut()
            } else {
                points.as_mut_ptr() as *mut sys::gpurt_patch_point
            },
            ..desc
        };
        // SAFETY: the handle is valid; the records have the layouts of the C types; the callers above give arrays of
        // num_hits elements, which live during the call.
        call(|| unsafe { sys::gpurt_scene_locate(self.as_raw(), &desc) })
    }
}
