//! Ray queries.
use std::ffi::c_void;
use std::mem::{align_of, size_of};
use std::ops::Index;
use std::ptr;

use crate::callback::call;
use crate::{sys, Coherence, DeviceBuffer, Error, Pod, Result, Scene, INVALID_ID};

/// A ray. One with a zero or non-finite direction, a non-finite origin or `tmin > tmax` misses.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Where it starts.
    pub origin: [f32; 3],
    /// Hits with `t < tmin` do not count.
    pub tmin: f32,
    /// Where it goes; need not be of unit length: `t` is in its units.
    pub direction: [f32; 3],
    /// Hits with `t > tmax` do not count; may be infinite.
    pub tmax: f32,
}

impl Ray {
    /// The ray from its origin to infinity.
    pub fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        Ray { origin, tmin: 0.0, direction, tmax: f32::INFINITY }
    }

    /// The segment between two points; `t` is 1 at the second.
    pub fn between(from: [f32; 3], to: [f32; 3]) -> Self {
        let direction = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
        Ray { origin: from, tmin: 0.0, direction, tmax: 1.0 }
    }

    /// The same ray, with hits counted in `tmin..=tmax` alone.
    pub fn clip(self, tmin: f32, tmax: f32) -> Self {
        Ray { tmin, tmax, ..self }
    }
}

/// What a ray hit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct Hit {
    /// Of a miss: the ray's `tmax`.
    pub t: f32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
    /// Triangle of the geometry; [`INVALID_ID`]: a miss.
    pub primitive: u32,
    /// The geometry; [`INVALID_ID`]: a miss.
    pub geometry: u32,
    /// The instance; [`INVALID_ID`]: a miss.
    pub instance: u32,
    padding: [u32; 2],
}

/// What a ray hit, in 16 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct HitCompact {
    /// Of a miss: the ray's `tmax`.
    pub t: f32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
    /// Triangle of the geometry; [`INVALID_ID`]: a miss.
    pub primitive: u32,
}

// The slices of these types are what the library reads and writes.
const _: () = assert!(size_of::<Ray>() == size_of::<sys::gpurt_ray>());
const _: () = assert!(align_of::<Ray>() == align_of::<sys::gpurt_ray>());
const _: () = assert!(size_of::<Hit>() == size_of::<sys::gpurt_hit>());
const _: () = assert!(align_of::<Hit>() == align_of::<sys::gpurt_hit>());
const _: () = assert!(size_of::<HitCompact>() == size_of::<sys::gpurt_hit_compact>());
const _: () = assert!(align_of::<HitCompact>() == align_of::<sys::gpurt_hit_compact>());

mod sealed {
    pub trait Sealed {
        const FORMAT: crate::sys::gpurt_hit_format;
    }
    impl Sealed for super::Hit {
        const FORMAT: crate::sys::gpurt_hit_format = crate::sys::GPURT_HIT_FULL;
    }
    impl Sealed for super::HitCompact {
        const FORMAT: crate::sys::gpurt_hit_format = crate::sys::GPURT_HIT_COMPACT;
    }
}

/// The records that queries fill: [`Hit`] and [`HitCompact`].
pub trait HitRecord: sealed::Sealed + Copy + Default + Send + Sync + 'static {
    /// Nothing was hit.
    fn is_miss(&self) -> bool;
}

impl HitRecord for Hit {
    fn is_miss(&self) -> bool {
        self.primitive == INVALID_ID
    }
}

impl HitRecord for HitCompact {
    fn is_miss(&self) -> bool {
        self.primitive == INVALID_ID
    }
}

impl Hit {
    /// Nothing was hit.
    pub fn is_miss(&self) -> bool {
        HitRecord::is_miss(self)
    }
}

impl HitCompact {
    /// Nothing was hit.
    pub fn is_miss(&self) -> bool {
        HitRecord::is_miss(self)
    }
}

/// Every crossing of every ray; `hits[i]` are those of ray `i`, sorted by (t, instance, primitive).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AllHits<H = Hit> {
    /// The hits of all rays, one ray after another.
    pub hits: Vec<H>,
    /// One more than there are rays: where each ray's hits begin.
    pub offsets: Vec<u64>,
}

impl<H> AllHits<H> {
    /// The hits of each ray in turn.
    pub fn iter(&self) -> impl Iterator<Item = &[H]> + '_ {
        self.offsets.windows(2).map(move |ends| &self.hits[ends[0] as usize..ends[1] as usize])
    }
}

impl<H> Index<usize> for AllHits<H> {
    type Output = [H];

    fn index(&self, ray: usize) -> &[H] {
        &self.hits[self.offsets[ray] as usize..self.offsets[ray + 1] as usize]
    }
}

fn expect_len(what: &str, len: usize, expected: usize) -> Result<()> {
    if len == expected {
        return Ok(());
    }
    Err(Error::InvalidArgument(format!("{} has {} elements; these rays need {}", what, len, expected)))
}

/// Traces the rays of a scene, with what its caller knows of their order ([`Scene::tracer`]). A hint changes the speed on
/// CUDA devices alone, never a result.
///
/// ```
/// # fn main() -> gpurt::Result<()> {
/// # use gpurt::{Coherence, Device, Mesh, Ray, Scene, IDENTITY};
/// # let scene = Scene::new(&Device::new()?)?;
/// # let triangle = scene.add_mesh(&Mesh::new(&[[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))?;
/// # scene.add_instance(triangle, IDENTITY)?;
/// # scene.commit()?;
/// // 64 x 32 rays through a plane, row by row.
/// let rays: Vec<Ray> =
///     (0..64 * 32).map(|i| Ray::new([(i % 64) as f32 / 64.0, (i / 64) as f32 / 32.0, 1.0], [0.0, 0.0, -1.0])).collect();
/// let hits = scene.tracer().coherence(Coherence::Coherent).image_width(64).closest(&rays)?;
/// assert_eq!(hits.iter().filter(|hit| !hit.is_miss()).count(), scene.occluded(&rays)?.iter().filter(|o| **o).count());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Tracer<'a> {
    scene: &'a Scene,
    coherence: Coherence,
    image_width: u32,
}

impl Tracer<'_> {
    /// How rays that follow one another go; by default the tree's size or a look at a few of them tells.
    pub fn coherence(mut self, coherence: Coherence) -> Self {
        self.coherence = coherence;
        self
    }

    /// The rays are those of an image, row by row, of this many: coherent ones go by tiles. 0, the default: they are not.
    pub fn image_width(mut self, width: u32) -> Self {
        self.image_width = width;
        self
    }
}

impl Tracer<'_> {
    /// The rest of `desc` is that of a query on device memory; its arrays have the sizes that the query needs.
    fn trace_on_device(&self, rays: &DeviceBuffer<Ray>, desc: sys::gpurt_trace_desc) -> Result<()> {
        self.expect_device("rays", rays)?;
        let desc = sys::gpurt_trace_desc {
            storage: sys::GPURT_STORAGE_DEVICE,
            num_rays: rays.len() as u64,
            rays: rays.as_device_ptr() as *const sys::gpurt_ray,
            coherence: self.coherence as sys::gpurt_coherence,
            image_width: self.image_width,
            ..desc
        };
        // SAFETY: the handle is valid; all buffers are of the scene's device, have the sizes that the query reads
        // and writes, and are borrowed until it is done.
        call(|| unsafe { sys::gpurt_scene_trace(self.scene.as_raw(), &desc) })
    }

    fn expect_device<T: Pod>(&self, name: &str, buffer: &DeviceBuffer<T>) -> Result<()> {
        if buffer.callbacks().share_device(self.scene.callbacks()) {
            return Ok(());
        }
        Err(Error::InvalidArgument(format!("{} belongs to another device than the scene; make it there", name)))
    }

    /// As [`closest_into`](Tracer::closest_into), with rays and hits in device memory.
    pub fn closest_on_device<H: HitRecord + Pod>(
        &self,
        rays: &DeviceBuffer<Ray>,
        hits: &mut DeviceBuffer<H>,
    ) -> Result<()> {
        self.expect_device("hits", hits)?;
        expect_len("hits", hits.len(), rays.len())?;
        let desc = sys::gpurt_trace_desc {
            query: sys::GPURT_QUERY_CLOSEST,
            format: H::FORMAT,
            hits: hits.as_device_ptr() as *mut c_void,
            ..Default::default()
        };
        self.trace_on_device(rays, desc)
    }

    /// As [`occluded_into`](Tracer::occluded_into), with rays and results in device memory.
    pub fn occluded_on_device(
        &self,
        rays: &DeviceBuffer<Ray>,
        occluded: &mut DeviceBuffer<u8>,
    ) -> Result<()> {
        self.expect_device("occluded", occluded)?;
        expect_len("occluded", occluded.len(), rays.len())?;
        let desc = sys::gpurt_trace_desc {
            query: sys::GPURT_QUERY_ANY,
            occluded: occluded.as_device_ptr(),
            ..Default::default()
        };
        self.trace_on_device(rays, desc)
    }

    /// As [`all_into`](Tracer::all_into), with rays, hits and offsets in device memory; without hits, as
    /// [`count_into`](Tracer::count_into).
    pub fn all_on_device<H: HitRecord + Pod>(
        &self,
        rays: &DeviceBuffer<Ray>,
        hits: Option<&mut DeviceBuffer<H>>,
        offsets: &mut DeviceBuffer<u64>,
    ) -> Result<u64> {
        self.expect_device("offsets", offsets)?;
        expect_len("offsets", offsets.len(), rays.len() + 1)?;
        let (hits, hit_capacity) = match hits {
            Some(hits) => {
                self.expect_device("hits", hits)?;
                (hits.as_device_ptr() as *mut c_void, hits.len() as u64)
            }
            None => (ptr::null_mut(), 0),
        };
        let desc = sys::gpurt_trace_desc {
            query: sys::GPURT_QUERY_ALL,
            format: H::FORMAT,
            hits,
            hit_capacity,
            offsets: offsets.as_device_ptr(),
            ..Default::default()
        };
        self.trace_on_device(rays, desc)?;
        let mut last = [0];
        offsets.download_into(rays.len(), &mut last)?;
        Ok(last[0])
    }

    fn trace(&self, rays: &[Ray], desc: sys::gpurt_trace_desc) -> Result<()> {
        let desc = sys::gpurt_trace_desc {
            storage: sys::GPURT_STORAGE_HOST,
            num_rays: rays.len() as u64,
            rays: rays.as_ptr() as *const sys::gpurt_ray,
            coherence: self.coherence as sys::gpurt_coherence,
            image_width: self.image_width,
            ..desc
        };
        // SAFETY: the handle is valid; `Ray` has the layout of gpurt_ray; the callers below give outputs of
        // the sizes that the query writes, which are borrowed mutably during the call.
        call(|| unsafe { sys::gpurt_scene_trace(self.scene.as_raw(), &desc) })
    }

    /// The closest hit of each ray; of equal ones that of the smaller (instance, primitive).
    pub fn closest(&self, rays: &[Ray]) -> Result<Vec<Hit>> {
        let mut hits = vec![Hit::default(); rays.len()];
        self.closest_into(rays, &mut hits)?;
        Ok(hits)
    }

    /// Writes the closest hit of each ray, as [`Hit`] or [`HitCompact`].
    pub fn closest_into<H: HitRecord>(&self, rays: &[Ray], hits: &mut [H]) -> Result<()> {
        expect_len("hits", hits.len(), rays.len())?;
        let desc = sys::gpurt_trace_desc {
            query: sys::GPURT_QUERY_CLOSEST,
            format: H::FORMAT,
            hits: hits.as_mut_ptr() as *mut c_void,
            ..Default::default()
        };
        self.trace(rays, desc)
    }

    /// Whether each ray hits anything.
    pub fn occluded(&self, rays: &[Ray]) -> Result<Vec<bool>> {
        let mut occluded = vec![0; rays.len()];
        self.occluded_into(rays, &mut occluded)?;
        Ok(occluded.into_iter().map(|byte| byte != 0).collect())
    }

    /// Writes whether each ray hits anything: 1, or 0.
    pub fn occluded_into(&self, rays: &[Ray], occluded: &mut [u8]) -> Result<()> {
        expect_len("occluded", occluded.len(), rays.len())?;
        let desc = sys::gpurt_trace_desc {
            query: sys::GPURT_QUERY_ANY,
            occluded: occluded.as_mut_ptr(),
            ..Default::default()
        };
        self.trace(rays, desc)
    }

    /// Counts every crossing of each ray, then returns them: the rays are traced twice.
    pub fn all(&self, rays: &[Ray]) -> Result<AllHits> {
        let mut offsets = vec![0; rays.len() + 1];
        let num_hits = self.count_into(rays, &mut offsets)?;
        let num_hits = usize::try_from(num_hits)
            .map_err(|_| Error::OutOfMemory(format!("{} hits do not fit into memory", num_hits)))?;
        let mut hits = vec![Hit::default(); num_hits];
        let num_hits = self.all_into(rays, &mut hits, &mut offsets)?;
        hits.truncate(num_hits as usize);
        Ok(AllHits { hits, offsets })
    }

    /// Counts every crossing of each ray and returns their sum. `offsets` has one element more than there are
    /// rays; ray `i` has `offsets[i + 1] - offsets[i]` hits.
    pub fn count_into(&self, rays: &[Ray], offsets: &mut [u64]) -> Result<u64> {
        self.trace_all::<Hit>(rays, None, offsets)
    }

    /// Writes every crossing of each ray, sorted by (t, instance, primitive), and returns their number. Ray
    /// `i` has `hits[offsets[i]..offsets[i + 1]]`; `offsets` has one element more than there are rays.
    ///
    /// Fails with [`Error::InvalidArgument`] where `hits` is too small; the last of `offsets` is what it
    /// needs.
    pub fn all_into<H: HitRecord>(&self, rays: &[Ray], hits: &mut [H], offsets: &mut [u64]) -> Result<u64> {
        self.trace_all(rays, Some(hits), offsets)
    }

    fn trace_all<H: HitRecord>(
        &self,
        rays: &[Ray],
        hits: Option<&mut [H]>,
        offsets: &mut [u64],
    ) -> Result<u64> {
        expect_len("offsets", offsets.len(), rays.len() + 1)?;
        let (hits, hit_capacity) = match hits {
            Some(hits) => (hits.as_mut_ptr() as *mut c_void, hits.len() as u64),
            None => (ptr::null_mut(), 0),
        };
        let desc = sys::gpurt_trace_desc {
            query: sys::GPURT_QUERY_ALL,
            format: H::FORMAT,
            hits,
            hit_capacity,
            offsets: offsets.as_mut_ptr(),
            ..Default::default()
        };
        self.trace(rays, desc)?;
        Ok(offsets[rays.len()])
    }
}

impl Scene {
    /// Traces rays with what the caller knows of their order. The queries below are those of a tracer without hints.
    pub fn tracer(&self) -> Tracer<'_> {
        Tracer { scene: self, coherence: Coherence::Auto, image_width: 0 }
    }

    /// [`Tracer::closest`] without hints.
    pub fn closest(&self, rays: &[Ray]) -> Result<Vec<Hit>> {
        self.tracer().closest(rays)
    }

    /// [`Tracer::closest_into`] without hints.
    pub fn closest_into<H: HitRecord>(&self, rays: &[Ray], hits: &mut [H]) -> Result<()> {
        self.tracer().closest_into(rays, hits)
    }

    /// [`Tracer::closest_on_device`] without hints.
    pub fn closest_on_device<H: HitRecord + Pod>(
        &self,
        rays: &DeviceBuffer<Ray>,
        hits: &mut DeviceBuffer<H>,
    ) -> Result<()> {
        self.tracer().closest_on_device(rays, hits)
    }

    /// [`Tracer::occluded`] without hints.
    pub fn occluded(&self, rays: &[Ray]) -> Result<Vec<bool>> {
        self.tracer().occluded(rays)
    }

    /// [`Tracer::occluded_into`] without hints.
    pub fn occluded_into(&self, rays: &[Ray], occluded: &mut [u8]) -> Result<()> {
        self.tracer().occluded_into(rays, occluded)
    }

    /// [`Tracer::occluded_on_device`] without hints.
    pub fn occluded_on_device(
        &self,
        rays: &DeviceBuffer<Ray>,
        occluded: &mut DeviceBuffer<u8>,
    ) -> Result<()> {
        self.tracer().occluded_on_device(rays, occluded)
    }

    /// [`Tracer::all`] without hints.
    pub fn all(&self, rays: &[Ray]) -> Result<AllHits> {
        self.tracer().all(rays)
    }

    /// [`Tracer::count_into`] without hints.
    pub fn count_into(&self, rays: &[Ray], offsets: &mut [u64]) -> Result<u64> {
        self.tracer().count_into(rays, offsets)
    }

    /// [`Tracer::all_into`] without hints.
    pub fn all_into<H: HitRecord>(&self, rays: &[Ray], hits: &mut [H], offsets: &mut [u64]) -> Result<u64> {
        self.tracer().all_into(rays, hits, offsets)
    }

    /// [`Tracer::all_on_device`] without hints.
    pub fn all_on_device<H: HitRecord + Pod>(
        &self,
        rays: &DeviceBuffer<Ray>,
        hits: Option<&mut DeviceBuffer<H>>,
        offsets: &mut DeviceBuffer<u64>,
    ) -> Result<u64> {
        self.tracer().all_on_device(rays, hits, offsets)
    }

    /// Traces arrays that are given by their addresses, as [`sys::gpurt_scene_trace`] does.
    ///
    /// # Safety
    ///
    /// The descriptor's pointers must be valid for what the query reads and writes, in the memory that its storage
    /// names, on the scene's device, and nothing else may use what is written until the call returns.
    pub unsafe fn trace_raw(&self, desc: &sys::gpurt_trace_desc) -> Result<()> {
        // SAFETY: the caller's promise.
        call(|| unsafe { sys::gpurt_scene_trace(self.as_raw(), desc) })
    }

    /// Queues a query on a CUDA stream and returns before it is done, as [`sys::gpurt_cuda_trace`] does. `stream` is a
    /// `cudaStream_t` or `CUstream`, null the default stream; the events may be null.
    ///
    /// # Safety
    ///
    /// As for [`trace_raw`](Scene::trace_raw), with device memory, until the work on the stream is done. Scene and commit
    /// must live as long. The stream and the events belong to the scene's device.
    pub unsafe fn trace_on_stream(
        &self,
        desc: &sys::gpurt_trace_desc,
        stream: *mut c_void,
        wait_event: *mut c_void,
        done_event: *mut c_void,
    ) -> Result<()> {
        // SAFETY: the caller's promise.
        call(|| unsafe { sys::gpurt_cuda_trace(self.as_raw(), desc, stream, wait_event, done_event) })
    }
}
