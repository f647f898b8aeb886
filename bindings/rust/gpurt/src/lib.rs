//! gpurt renders and queries 3D scenes on CPUs and CUDA GPUs.
//!
//! A [`Device`] does the work. A [`Scene`] describes geometry, materials, lights and cameras;
//! [`Scene::commit`] builds its acceleration structure. Then rays are cast with [`Scene::closest`],
//! [`Scene::occluded`] and [`Scene::all`], and images rendered with [`Scene::render`] or, with full control,
//! through a [`Frame`] and its [`Job`]s. A [`PhotonMap`] finds points near places.
//!
//! ```
//! use gpurt::{Device, Mesh, Ray, Scene, IDENTITY};
//!
//! # fn main() -> gpurt::Result<()> {
//! let device = Device::cpu()?;
//! let scene = Scene::new(&device)?;
//! let triangle = scene.add_mesh(&Mesh::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))?;
//! scene.add_instance(triangle, IDENTITY)?;
//! scene.commit()?;
//!
//! let rays = [Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -1.0]), Ray::new([2.0, 2.0, 1.0], [0.0, 0.0, -1.0])];
//! let hits = scene.closest(&rays)?;
//! assert!((hits[0].t - 1.0).abs() < 1e-6 && hits[0].primitive == 0);
//! assert!(hits[1].is_miss());
//! # Ok(())
//! # }
//! ```
//!
//! Everything is metres, right handed, Y up; radiance is linear Rec. 709; angles are radians. Objects may be
//! used from several threads, and dropped in any order: a child keeps its parent alive. `clone` makes another
//! owner of the same object.
#![deny(missing_docs, unsafe_op_in_unsafe_fn)]

pub use gpurt_sys as sys;

#[macro_use]
mod macros;
mod buffer;
mod callback;
mod description;
mod device;
mod device_buffer;
mod enums;
mod error;
mod frame;
mod job;
mod locate;
mod mesh;
mod photons;
mod pipelines;
mod scene;
mod schedule;
mod trace;
mod tree;

pub use buffer::{Array, Buffer, Element};
pub use description::*;
pub use device::{Device, DeviceDesc, DeviceProperties};
pub use device_buffer::{DeviceBuffer, Pod};
pub use enums::*;
pub use error::{Error, Result};
pub use frame::{Frame, FrameDesc, Image, Pixel, StateInfo, Statistics};
pub use job::{Job, RenderDesc, Tile};
pub use locate::{PatchPoint, PatchSurface};
pub use mesh::{Mesh, Patches, Subdivision};
pub use pipelines::{PhotonCounters, PhotonSettings, ReyesCounters, ReyesSettings};
pub use photons::{NearestPoints, PhotonMap, PhotonMapDesc, PhotonMapInfo, PhotonTraceDesc, PointLists, Within};
pub use scene::{BuildDesc, Scene, SceneFacts};
pub use schedule::{Schedule, ScheduleCounters};
pub use trace::{AllHits, Hit, HitCompact, HitRecord, Ray, Tracer};
pub use tree::{KdTree, KdTreeNode, KdTreeNodeKind};

/// "None" wherever ids count from 0, such as [`Hit::primitive`] of a miss.
pub const INVALID_ID: u32 = sys::GPURT_INVALID_ID;

/// Object to world, or camera to world: 3 rows of 4.
pub type Transform = [[f32; 4]; 3];

/// The transform that changes nothing.
pub const IDENTITY: Transform = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// The library's version: major, minor, patch.
pub fn version() -> (u32, u32, u32) {
    // SAFETY: takes nothing, changes nothing.
    let version = unsafe { sys::gpurt_version() };
    (version >> 16, version >> 8 & 255, version & 255)
}

/// The examples of README.md and docs/rust.md, as tests.
#[cfg(doctest)]
#[doc = include_str!(concat!(env!("OUT_DIR"), "/examples.md"))]
pub struct DocumentationExamples;
