//! Frames: the films that renders add samples to.
use std::ffi::c_void;
use std::mem::size_of_val;
use std::path::Path;
use std::ptr;

use crate::callback::{call, Callbacks};
use crate::macros::{c_path, text};
use crate::{
    sys, Accel, BuildDesc, CameraId, Error, Job, Output, PhotonCounters, PhotonSettings, Pipeline, RenderDesc,
    Result, ReyesCounters, ReyesSettings, Scene, Schedule, ScheduleCounters, Tile, TriangleTest,
};

handle! {
    /// A film of a committed scene. Renders add samples to it; it is read, saved, continued and merged.
    Frame: gpurt_frame, gpurt_frame_retain, gpurt_frame_release
}

/// What a frame shows and keeps. The default takes the size from the scene's first camera.
#[derive(Debug, Clone, Copy)]
#[must_use]
pub struct FrameDesc {
    raw: sys::gpurt_frame_desc,
}

impl FrameDesc {
    /// An image of so many pixels; 0: what the camera says, else 512.
    pub fn new(width: u32, height: u32) -> Self {
        FrameDesc { raw: sys::gpurt_frame_desc { width, height, ..Default::default() } }
    }

    /// The camera; the scene's first by default.
    pub fn camera(mut self, camera: CameraId) -> Self {
        self.raw.camera = camera.0;
        self
    }

    /// What to keep besides colour, alpha and sample count.
    pub fn outputs(mut self, outputs: &[Output]) -> Self {
        self.raw.outputs = outputs.iter().fold(0, |bits, &output| bits | 1 << output as u32);
        self
    }

    /// Which frame of an animation this is: decorrelates the samples of different frames.
    pub fn frame_index(mut self, index: u32) -> Self {
        self.raw.frame_index = index;
        self
    }

    /// The seed of the random numbers.
    pub fn seed(mut self, seed: u64) -> Self {
        self.raw.seed = seed;
        self
    }

    /// The first sample index that this frame renders; frames with other ranges can be merged.
    pub fn first_sample(mut self, first_sample: u64) -> Self {
        self.raw.first_sample = first_sample;
        self
    }
}

impl Default for FrameDesc {
    fn default() -> Self {
        FrameDesc::new(0, 0)
    }
}

/// A rendered image, top row first.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Linear radiance, and alpha: the share of samples whose eye ray hit something. Row by row.
    pub pixels: Vec<[f32; 4]>,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

mod sealed {
    pub trait Sealed {
        /// The outputs that consist of this type.
        const OUTPUTS: &'static [crate::Output];
    }
}

/// What outputs of a frame consist of: `f32`, `[f32; 3]` or `u32`; [`Output`] says which.
pub trait Pixel: sealed::Sealed + Copy + Default + Send + Sync + 'static {}

macro_rules! pixels {
    ($($type:ty: $($output:ident)*;)*) => {$(
        impl sealed::Sealed for $type {
            const OUTPUTS: &'static [Output] = &[$(Output::$output),*];
        }
        impl Pixel for $type {}
    )*};
}
pixels! {
    f32: Alpha Depth Time;
    [f32; 3]: Color Normal Albedo Position Variance Bias Error;
    u32: Primitive Instance SampleCount;
}

impl Frame {
    /// Creates a frame of a committed scene.
    pub fn new(scene: &Scene, desc: &FrameDesc) -> Result<Self> {
        let mut frame = ptr::null_mut();
        // SAFETY: the handle is valid; the descriptor and the output live during the call.
        call(|| unsafe { sys::gpurt_frame_create(scene.as_raw(), &desc.raw, &mut frame) })?;
        Ok(Frame::own(frame, scene.callbacks().clone()))
    }

    /// Starts rendering of the whole frame; returns at once.
    ///
    /// Samples are added to what the frame has: a job that was cancelled, or stopped early, goes on where it
    /// was, and the image has the same bits as if it had run at once. Jobs of one frame run one after
    /// another.
    pub fn submit(&self, render: &RenderDesc) -> Result<Job> {
        Job::submit(self, render, &[])
    }

    /// Starts rendering of tiles: any rectangles of the frame, in any order.
    pub fn submit_tiles(&self, render: &RenderDesc, tiles: &[Tile]) -> Result<Job> {
        if tiles.is_empty() {
            // To the library no tiles are the whole frame, which an empty list is unlikely to mean.
            return Err(Error::InvalidArgument(
                "no tiles to render; Frame::submit renders the whole frame".into(),
            ));
        }
        Job::submit(self, render, tiles)
    }

    /// Renders the whole frame and waits for it.
    pub fn render(&self, render: &RenderDesc) -> Result<()> {
        self.submit(render)?.wait()
    }

    /// Colour and alpha.
    pub fn image(&self) -> Result<Image> {
        let statistics = self.statistics()?;
        let color = self.read::<[f32; 3]>(Output::Color)?;
        let alpha = self.read::<f32>(Output::Alpha)?;
        let pixels = color.iter().zip(alpha).map(|(&[r, g, b], a)| [r, g, b, a]).collect();
        Ok(Image { pixels, width: statistics.width, height: statistics.height })
    }

    /// Reads an output, top row first. Pixels without samples are 0, and their ids
    /// [`INVALID_ID`](crate::INVALID_ID); while a job runs, whole samples are seen.
    ///
    /// The type is the one that [`Output`] names: `frame.read::<f32>(Output::Depth)`.
    pub fn read<T: Pixel>(&self, output: Output) -> Result<Vec<T>> {
        let statistics = self.statistics()?;
        let mut pixels = vec![T::default(); statistics.width as usize * statistics.height as usize];
        self.read_into(output, &mut pixels)?;
        Ok(pixels)
    }

    /// Reads an output into a slice of `width * height` pixels.
    pub fn read_into<T: Pixel>(&self, output: Output, pixels: &mut [T]) -> Result<()> {
        if !T::OUTPUTS.contains(&output) {
            let name = std::any::type_name::<T>();
            return Err(Error::InvalidArgument(format!("output {:?} does not consist of {}", output, name)));
        }
        let (data, size) = (pixels.as_mut_ptr() as *mut c_void, size_of_val(pixels) as u64);
        // SAFETY: the handle is valid; the slice is borrowed mutably during the call, and any bits are valid
        // in it.
        call(|| unsafe { sys::gpurt_frame_read(self.as_raw(), output as u32, data, size) })
    }

    /// Writes the frame to a file, by its extension: `.exr`, every output as a layer; `.png`, the colour,
    /// tonemapped; `.gpurt`, the exact sums, for [`load_state`](Frame::load_state).
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = c_path(path.as_ref())?;
        // SAFETY: the handle is valid; the path lives during the call.
        call(|| unsafe { sys::gpurt_frame_save(self.as_raw(), path.as_ptr()) })
    }

    /// Adds the samples of another frame; any order of merging gives the same bits as rendering at once.
    pub fn merge(&self, other: &Frame) -> Result<()> {
        // SAFETY: both handles are valid.
        call(|| unsafe { sys::gpurt_frame_merge(self.as_raw(), other.as_raw()) })
    }

    /// Adds the samples of a `.gpurt` file. [`StateInfo`] says which frame can.
    pub fn load_state(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = c_path(path.as_ref())?;
        // SAFETY: the handle is valid; the path lives during the call.
        call(|| unsafe { sys::gpurt_frame_load_state(self.as_raw(), path.as_ptr()) })
    }

    /// What was done so far, with which settings.
    pub fn statistics(&self) -> Result<Statistics> {
        let mut raw = sys::gpurt_statistics::default();
        // SAFETY: the handle is valid; the output lives during the call.
        call(|| unsafe { sys::gpurt_frame_get_statistics(self.as_raw(), &mut raw) })?;
        Statistics::from_raw(&raw)
    }

    pub(crate) fn callbacks(&self) -> &Callbacks {
        &self.callbacks
    }
}

filled_struct! {
    /// What rendering a frame took: the resolved settings of the last job, and totals over all jobs.
    Statistics: gpurt_statistics as raw {
        same {
            /// Most vertices of a path.
            max_depth: u32,
            /// Edge of the square work unit, in pixels.
            tile_size: u32,
            /// Threads of the device.
            num_threads: u32,
            /// Of the frame.
            width: u32,
            /// Of the frame.
            height: u32,
            /// Of the random numbers.
            seed: u64,
            /// The smallest number that a pixel of the frame has.
            samples_per_pixel: u64,
            /// Camera paths.
            num_samples: u64,
            /// Rays from the camera.
            num_camera_rays: u64,
            /// Rays that go on from surfaces.
            num_bounce_rays: u64,
            /// Rays to lights.
            num_shadow_rays: u64,
            /// Samples that were not finite and left out; 0 in a sound scene.
            num_nonfinite: u64,
            /// Sums that left the film's range; not 0 makes the job fail.
            num_saturated: u64,
            /// From start to end of jobs.
            render_seconds: f64,
            /// Per stage, summed over threads.
            generate_seconds: f64,
            /// Per stage, summed over threads.
            trace_seconds: f64,
            /// Per stage, summed over threads.
            shade_seconds: f64,
            /// Per stage, summed over threads.
            shadow_seconds: f64,
            /// Per stage, summed over threads.
            film_seconds: f64,
            /// Of the scene's commit.
            build_seconds: f64,
            /// relMSE of the frame, noise and known bias; negative: not known.
            estimated_error: f64,
            /// The part of `estimated_error` that is bias; the rest is noise. Negative: not known.
            estimated_bias: f64,
            /// Largest radiance of a single sample.
            largest_sample: f64,
            /// Peak memory.
            memory_peak_bytes: u64,
        }
        converted {
            /// What renders.
            pipeline: Pipeline = Pipeline::from_raw(raw.pipeline)?,
            /// What traces.
            accel: Accel = Accel::from_raw(raw.accel)?,
            /// What tests triangles.
            triangle_test: TriangleTest = TriangleTest::from_raw(raw.triangle_test)?,
            /// Why settings were chosen.
            reason: String = text(&raw.reason),
            /// How the device went about it.
            schedule: Schedule = Schedule::from_raw(&raw.schedule)?,
            /// What schedules did.
            schedule_counters: ScheduleCounters = ScheduleCounters::from_raw(&raw.schedule_counters)?,
            /// Settings of photon mapping, resolved; `None` for other pipelines.
            photon: Option<PhotonSettings> = PhotonSettings::from_raw(&raw.photon)?,
            /// What photon mapping did.
            photon_counters: PhotonCounters = PhotonCounters::from_raw(&raw.photon_counters)?,
            /// Settings of REYES, resolved; `None` for other pipelines.
            reyes: Option<ReyesSettings> = ReyesSettings::from_raw(&raw.reyes)?,
            /// What REYES did.
            reyes_counters: ReyesCounters = ReyesCounters::from_raw(&raw.reyes_counters)?,
        }
    }
}

filled_struct! {
    /// What a `.gpurt` file is the state of.
    StateInfo: gpurt_state_info as raw {
        same {
            /// Of the frame.
            width: u32,
            /// Of the frame.
            height: u32,
            /// Which frame of an animation.
            frame_index: u32,
            /// Of the random numbers.
            seed: u64,
            /// The first sample index that the frame rendered.
            first_sample: u64,
            /// In all pixels together.
            num_samples: u64,
            /// Tells scenes apart.
            scene_hash: u64,
            /// Of the renders; 0: no samples yet.
            max_depth: u32,
        }
        converted {
            /// Of the scene.
            camera: CameraId = CameraId(raw.camera),
            /// What the frame keeps.
            outputs: Vec<Output> = outputs(raw.outputs)?,
            /// Of the renders; [`Pipeline::Auto`]: no samples yet.
            pipeline: Pipeline = Pipeline::from_raw(raw.pipeline)?,
            /// Of the scene's commit.
            accel: Accel = Accel::from_raw(raw.accel)?,
            /// Of the scene's commit.
            triangle_test: TriangleTest = TriangleTest::from_raw(raw.triangle_test)?,
        }
    }
}

fn outputs(bits: u32) -> Result<Vec<Output>> {
    (0..32).filter(|bit| bits >> bit & 1 == 1).map(Output::from_raw).collect()
}

impl StateInfo {
    /// Reads the head of a `.gpurt` file.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = c_path(path.as_ref())?;
        let mut raw = sys::gpurt_state_info::default();
        // SAFETY: the path and the output live during the call.
        call(|| unsafe { sys::gpurt_state_read_info(path.as_ptr(), &mut raw) })?;
        StateInfo::from_raw(&raw)
    }

    /// Describes a frame that can load the file.
    pub fn frame_desc(&self) -> FrameDesc {
        FrameDesc::new(self.width, self.height)
            .camera(self.camera)
            .outputs(&self.outputs)
            .frame_index(self.frame_index)
            .seed(self.seed)
            .first_sample(self.first_sample)
    }

    /// How to commit the scene of such a frame.
    pub fn build_desc(&self) -> BuildDesc {
        BuildDesc { accel: self.accel, triangle_test: self.triangle_test, ..Default::default() }
    }
}
