//! Photon maps: points in space, found by where they are.
use std::ffi::c_void;
use std::ops::Index;
use std::path::Path;
use std::ptr;

use crate::callback::call;
use crate::macros::c_path;
use crate::{sys, Device, Error, GatherKernel, GatherMethod, PhotonAttribute, Result, Scene};

handle! {
    /// Points, with a flux and a normal each where they are wanted, sorted so that those near a place are found fast.
    ///
    /// Answers have the same bits on every device and for any number of threads.
    ///
    /// ```
    /// # fn main() -> gpurt::Result<()> {
    /// use gpurt::{Device, PhotonMap, PhotonMapDesc};
    ///
    /// let device = Device::cpu()?;
    /// let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
    /// let map = PhotonMap::new(&device, &PhotonMapDesc { positions: &points, ..Default::default() })?;
    /// let nearest = map.nearest(&[[0.9, 0.0, 0.0]], 2)?;
    /// assert_eq!(nearest.ids, [1, 0]);
    /// # Ok(())
    /// # }
    /// ```
    PhotonMap: gpurt_photon_map, gpurt_photon_map_retain, gpurt_photon_map_release
}

/// What a map is made from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PhotonMapDesc<'a> {
    /// The points.
    pub positions: &'a [[f32; 3]],
    /// None, or one a point, not negative; kept as mantissas of 8 bits with a common exponent, rounded without bias.
    pub fluxes: &'a [[f32; 3]],
    /// None, or one a point, of any length; kept in steps of 1/127.
    pub normals: &'a [[f32; 3]],
    /// That queries will mostly have; 0: one that holds about 50 points where they lie densely.
    pub radius: f32,
    /// Grids, each with cells 4 times larger than the one before; with 4, nearest points that are far away are found
    /// faster. 0: 1.
    pub num_levels: u32,
}

/// Which photons of a scene a map holds. The default: a million paths of the first pass.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PhotonTraceDesc {
    /// Photons that leave the lights; 0: 1048576.
    pub num_paths: u32,
    /// Of the random numbers.
    pub seed: u64,
    /// Which of the passes of a frame. With the frame's seed, `frame_index` and `max_depth`, and its `photons_per_pass`
    /// for `num_paths`, the map holds the photons that the frame's sample of this index gathers.
    pub pass: u64,
    /// As of frames.
    pub frame_index: u32,
    /// Of paths from the eye, as of renders; 0: 17.
    pub max_depth: u32,
    /// As of [`PhotonMapDesc`].
    pub radius: f32,
    /// As of [`PhotonMapDesc`].
    pub num_levels: u32,
}

filled_struct! {
    /// What a map is.
    PhotonMapInfo: gpurt_photon_map_info as raw {
        same {
            /// Points.
            num_points: u64,
            /// Grids.
            num_levels: u32,
            /// Lowest and highest coordinates; an empty map: 0.
            bounds: [[f32; 3]; 2],
            /// That was asked for, or chosen.
            radius: f32,
            /// Points of the fullest entry of the finest grid's table.
            fullest_cell: u32,
            /// Of the device.
            memory_bytes: u64,
            /// On a CUDA device: of the device, without copies from the host.
            build_seconds: f64,
            /// Photons that left the lights for it; 0: the points are the caller's.
            num_paths: u32,
        }
        converted {
            /// Whether sums can be asked for.
            has_fluxes: bool = raw.has_fluxes != 0,
            /// Whether queries may have normals.
            has_normals: bool = raw.has_normals != 0,
            /// Whether points have directions of flight: those of [`PhotonMap::trace`].
            has_directions: bool = raw.has_directions != 0,
        }
    }
}

/// What a query of points within a radius asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Within<'a> {
    /// A point is within it where its distance is less.
    pub radius: f32,
    /// Of sums: the weight of a point by its distance.
    pub kernel: GatherKernel,
    /// None, or one a place: points count whose normal has a cosine with it above `min_cosine`.
    pub normals: &'a [[f32; 3]],
    /// In -1..=1.
    pub min_cosine: f32,
    /// How points are found.
    pub method: GatherMethod,
}

impl Within<'_> {
    /// All points within a radius, of weight 1.
    pub fn new(radius: f32) -> Self {
        Within {
            radius,
            kernel: GatherKernel::Constant,
            normals: &[],
            min_cosine: 0.0,
            method: GatherMethod::Grid,
        }
    }
}

/// Points near places; `lists[i]` are the ids of those near place `i`, in the order in which the map keeps them.
#[derive(Debug, Clone, PartialEq)]
pub struct PointLists {
    /// Of all places, one after another.
    pub ids: Vec<u32>,
    /// As `ids`.
    pub distances: Vec<f32>,
    /// One more than there are places: where the list of each begins.
    pub offsets: Vec<u64>,
}

impl Index<usize> for PointLists {
    type Output = [u32];

    fn index(&self, place: usize) -> &[u32] {
        &self.ids[self.offsets[place] as usize..self.offsets[place + 1] as usize]
    }
}

/// The nearest points of places, `k` each, sorted by (distance, id).
#[derive(Debug, Clone, PartialEq)]
pub struct NearestPoints {
    /// How many a place has room for.
    pub k: usize,
    /// Where there are fewer, the rest is [`INVALID_ID`](crate::INVALID_ID).
    pub ids: Vec<u32>,
    /// As `ids`, the rest infinite.
    pub distances: Vec<f32>,
}

fn floats(values: &[[f32; 3]]) -> *const f32 {
    if values.is_empty() {
        ptr::null()
    } else {
        values.as_ptr() as *const f32
    }
}

fn expect_as_many(name: &str, values: &[[f32; 3]], as_many: &str, count: usize) -> Result<()> {
    if values.is_empty() || values.len() == count {
        return Ok(());
    }
    Err(Error::InvalidArgument(format!(
        "{} has {} elements; it needs none, or as many as {}: {}",
        name,
        values.len(),
        as_many,
        count
    )))
}

impl PhotonMap {
    /// Builds a map; the points are copied.
    pub fn new(device: &Device, desc: &PhotonMapDesc) -> Result<Self> {
        expect_as_many("fluxes", desc.fluxes, "positions", desc.positions.len())?;
        expect_as_many("normals", desc.normals, "positions", desc.positions.len())?;
        let raw = sys::gpurt_photon_map_desc {
            num_points: desc.positions.len() as u64,
            positions: floats(desc.positions),
            fluxes: floats(desc.fluxes),
            normals: floats(desc.normals),
            radius: desc.radius,
            num_levels: desc.num_levels,
            ..Default::default()
        };
        let mut map = ptr::null_mut();
        // SAFETY: the handle is valid; the arrays have the lengths that the library reads, during the call.
        call(|| unsafe { sys::gpurt_photon_map_create(device.as_raw(), &raw, &mut map) })?;
        Ok(PhotonMap::own(map, device.callbacks().clone()))
    }

    /// Traces photons from the lights of a scene's last commit, as photon mapping does and keeps them, to a map on the
    /// scene's device.
    ///
    /// Points are where a photon comes to a diffuse or rough surface, but for the first surface after the light. They
    /// have fluxes in watts, normals and directions; a sum of fluxes over a disc divided by its area is irradiance.
    pub fn trace(scene: &Scene, desc: &PhotonTraceDesc) -> Result<Self> {
        let raw = sys::gpurt_photon_trace_desc {
            num_paths: desc.num_paths,
            seed: desc.seed,
            pass: desc.pass,
            frame_index: desc.frame_index,
            max_depth: desc.max_depth,
            radius: desc.radius,
            num_levels: desc.num_levels,
            ..Default::default()
        };
        let mut map = ptr::null_mut();
        // SAFETY: the handle is valid; the output lives during the call.
        call(|| unsafe { sys::gpurt_photon_map_trace(scene.as_raw(), &raw, &mut map) })?;
        Ok(PhotonMap::own(map, scene.callbacks().clone()))
    }

    /// What the map keeps of its points, in the order of ids.
    pub fn read(&self, attribute: PhotonAttribute) -> Result<Vec<[f32; 3]>> {
        let mut values = vec![[0.0; 3]; self.info()?.num_points as usize];
        let (data, size) = (values.as_mut_ptr() as *mut c_void, std::mem::size_of_val(&values[..]) as u64);
        // SAFETY: the handle is valid; the output has the size that is given, and is borrowed mutably.
        call(|| unsafe { sys::gpurt_photon_map_read(self.as_raw(), attribute as u32, data, size) })?;
        Ok(values)
    }

    /// Reads a map that [`save`](PhotonMap::save) wrote.
    pub fn load(device: &Device, path: impl AsRef<Path>) -> Result<Self> {
        let path = c_path(path.as_ref())?;
        let mut map = ptr::null_mut();
        // SAFETY: the handle is valid; the path and the output live during the call.
        call(|| unsafe { sys::gpurt_photon_map_load(device.as_raw(), path.as_ptr(), &mut map) })?;
        Ok(PhotonMap::own(map, device.callbacks().clone()))
    }

    /// Writes the map to a file, under a temporary name that is then changed.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = c_path(path.as_ref())?;
        // SAFETY: the handle is valid; the path lives during the call.
        call(|| unsafe { sys::gpurt_photon_map_save(self.as_raw(), path.as_ptr()) })
    }

    /// What the map is.
    pub fn info(&self) -> Result<PhotonMapInfo> {
        let mut raw = sys::gpurt_photon_map_info::default();
        // SAFETY: the handle is valid, the output is of the size that it says.
        call(|| unsafe { sys::gpurt_photon_map_get_info(self.as_raw(), &mut raw) })?;
        PhotonMapInfo::from_raw(&raw)
    }

    fn within(
        &self,
        query: sys::gpurt_photon_query,
        places: &[[f32; 3]],
        what: &Within,
        outputs: sys::gpurt_photon_query_desc,
    ) -> Result<()> {
        expect_as_many("normals", what.normals, "places", places.len())?;
        let desc = sys::gpurt_photon_query_desc {
            query,
            kernel: what.kernel as u32,
            num_queries: places.len() as u64,
            positions: floats(places),
            normals: floats(what.normals),
            min_cosine: what.min_cosine,
            radius: what.radius,
            method: what.method as u32,
            ..outputs
        };
        // SAFETY: the handle is valid; the callers below give outputs of the sizes that the query writes, which are
        // borrowed mutably during the call.
        call(|| unsafe { sys::gpurt_photon_map_query(self.as_raw(), &desc) })
    }

    /// How many points are near each place.
    pub fn count(&self, places: &[[f32; 3]], within: &Within) -> Result<Vec<u32>> {
        let mut counts = vec![0; places.len()];
        let outputs = sys::gpurt_photon_query_desc { counts: counts.as_mut_ptr(), ..Default::default() };
        self.within(sys::GPURT_PHOTON_QUERY_COUNT, places, within, outputs)?;
        Ok(counts)
    }

    /// The sum of the fluxes near each place.
    pub fn sum(&self, places: &[[f32; 3]], within: &Within) -> Result<Vec<[f32; 3]>> {
        let mut sums = vec![[0.0; 3]; places.len()];
        let outputs = sys::gpurt_photon_query_desc { sums: sums.as_mut_ptr() as *mut f32, ..Default::default() };
        self.within(sys::GPURT_PHOTON_QUERY_SUM, places, within, outputs)?;
        Ok(sums)
    }

    /// Which points are near each place. They are counted first.
    pub fn list(&self, places: &[[f32; 3]], within: &Within) -> Result<PointLists> {
        let mut offsets = vec![0; places.len() + 1];
        let outputs = sys::gpurt_photon_query_desc { offsets: offsets.as_mut_ptr(), ..Default::default() };
        self.within(sys::GPURT_PHOTON_QUERY_LIST, places, within, outputs)?;
        let total = usize::try_from(offsets[places.len()])
            .map_err(|_| Error::OutOfMemory(format!("{} ids do not fit into memory", offsets[places.len()])))?;
        let (mut ids, mut distances) = (vec![0; total], vec![0.0; total]);
        let outputs = sys::gpurt_photon_query_desc {
            offsets: offsets.as_mut_ptr(),
            ids: ids.as_mut_ptr(),
            distances: distances.as_mut_ptr(),
            capacity: total as u64,
            ..Default::default()
        };
        self.within(sys::GPURT_PHOTON_QUERY_LIST, places, within, outputs)?;
        Ok(PointLists { ids, distances, offsets })
    }

    /// The `k` nearest points of each place.
    pub fn nearest(&self, places: &[[f32; 3]], k: usize) -> Result<NearestPoints> {
        self.nearest_within(places, k, 0.0, 0.0)
    }

    /// The `k` nearest points of each place, of those nearer than `radius`; 0: of all. `hint` is about what holds `k`
    /// points, and changes the speed alone; 0: not known.
    pub fn nearest_within(
        &self,
        places: &[[f32; 3]],
        k: usize,
        radius: f32,
        hint: f32,
    ) -> Result<NearestPoints> {
        let count = places
            .len()
            .checked_mul(k)
            .filter(|_| k <= sys::GPURT_MAX_NEAREST as usize)
            .ok_or_else(|| Error::InvalidArgument(format!("k is {}; it is at most {}", k, sys::GPURT_MAX_NEAREST)))?;
        let (mut ids, mut distances) = (vec![0; count], vec![0.0; count]);
        let desc = sys::gpurt_photon_query_desc {
            query: sys::GPURT_PHOTON_QUERY_NEAREST,
            num_queries: places.len() as u64,
            positions: floats(places),
            radius,
            radius_hint: hint,
            k: k as u32,
            ids: ids.as_mut_ptr(),
            distances: distances.as_mut_ptr(),
            ..Default::default()
        };
        // SAFETY: the handle is valid; outputs have k elements a place, and are borrowed mutably during the call.
        call(|| unsafe { sys::gpurt_photon_map_query(self.as_raw(), &desc) })?;
        Ok(NearestPoints { k, ids, distances })
    }

    /// Asks with arrays that are given by their addresses, as [`sys::gpurt_photon_map_query`] does.
    ///
    /// # Safety
    ///
    /// The descriptor's pointers must be valid for what the query reads and writes, in the memory that its storage
    /// names, on the map's device, and nothing else may use what is written until the call returns.
    pub unsafe fn query_raw(&self, desc: &sys::gpurt_photon_query_desc) -> Result<()> {
        // SAFETY: the caller's promise.
        call(|| unsafe { sys::gpurt_photon_map_query(self.as_raw(), desc) })
    }

    /// Queues a query on a CUDA stream and returns before it is done, as [`sys::gpurt_cuda_query_photons`] does.
    ///
    /// # Safety
    ///
    /// As for [`query_raw`](PhotonMap::query_raw), with device memory, until the work on the stream is done; the map must
    /// live as long. The stream and the events belong to the map's device.
    pub unsafe fn query_on_stream(
        &self,
        desc: &sys::gpurt_photon_query_desc,
        stream: *mut c_void,
        wait_event: *mut c_void,
        done_event: *mut c_void,
    ) -> Result<()> {
        // SAFETY: the caller's promise.
        call(|| unsafe { sys::gpurt_cuda_query_photons(self.as_raw(), desc, stream, wait_event, done_event) })
    }
}
