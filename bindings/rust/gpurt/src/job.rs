//! Jobs: rendering that runs by itself.
use std::fmt;
use std::mem::{align_of, size_of};
use std::ptr;
use std::sync::Arc;
use std::time::Duration;

use crate::callback::{self, call, Closure, ProgressFn, Registration};
use crate::{sys, Error, Frame, PhotonSettings, Pipeline, Result, ReyesSettings, Schedule};

handle! {
    /// A render in the background. Dropping the last owner of one that still runs cancels it.
    Job: gpurt_job, gpurt_job_retain, gpurt_job_release
}

/// A rectangle of pixels: from (`x0`, `y0`) up to but without (`x1`, `y1`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(C)]
#[allow(missing_docs)]
pub struct Tile {
    pub x0: u32,
    pub y0: u32,
    pub x1: u32,
    pub y1: u32,
}

const _: () = assert!(size_of::<Tile>() == size_of::<sys::gpurt_tile>());
const _: () = assert!(align_of::<Tile>() == align_of::<sys::gpurt_tile>());

/// How to render. By default, path tracing with 64 samples a pixel.
///
/// ```
/// use gpurt::{Pipeline, RenderDesc};
///
/// let render = RenderDesc::new().pipeline(Pipeline::Path).samples(256).max_depth(8);
/// ```
#[derive(Clone)]
#[must_use]
pub struct RenderDesc {
    pipeline: Pipeline,
    samples_per_pixel: u32,
    target_error: f32,
    time_limit: Duration,
    max_depth: u32,
    tile_size: u32,
    progress: Option<ProgressFn>,
    schedule: Schedule,
    photon: PhotonSettings,
    reyes: ReyesSettings,
}

impl RenderDesc {
    /// The library's defaults.
    pub fn new() -> Self {
        RenderDesc {
            pipeline: Pipeline::Auto,
            samples_per_pixel: 0,
            target_error: 0.0,
            time_limit: Duration::ZERO,
            max_depth: 0,
            tile_size: 0,
            progress: None,
            schedule: Schedule::default(),
            photon: PhotonSettings::default(),
            reyes: ReyesSettings::default(),
        }
    }

    /// The method that renders.
    pub fn pipeline(mut self, pipeline: Pipeline) -> Self {
        self.pipeline = pipeline;
        self
    }

    /// Until every pixel of the tiles has this many; 0: by error or time, else 64.
    pub fn samples(mut self, per_pixel: u32) -> Self {
        self.samples_per_pixel = per_pixel;
        self
    }

    /// Stop at the first whole-frame pass whose estimated relMSE is below.
    pub fn target_error(mut self, rel_mse: f32) -> Self {
        self.target_error = rel_mse;
        self
    }

    /// Stop at the last whole-frame pass that fits.
    pub fn time_limit(mut self, limit: Duration) -> Self {
        self.time_limit = limit;
        self
    }

    /// Emission seen directly is 1, direct light 2; 0: 17.
    pub fn max_depth(mut self, depth: u32) -> Self {
        self.max_depth = depth;
        self
    }

    /// Edge of the square work unit in pixels; 0: the library's choice; at most 256. Changes no bits.
    pub fn tile_size(mut self, pixels: u32) -> Self {
        self.tile_size = pixels;
        self
    }

    /// How a CUDA device goes about it. Changes no bits.
    pub fn schedule(mut self, schedule: Schedule) -> Self {
        self.schedule = schedule;
        self
    }

    /// Settings of [`Pipeline::Photon`].
    pub fn photon(mut self, settings: PhotonSettings) -> Self {
        self.photon = settings;
        self
    }

    /// Settings of [`Pipeline::Reyes`].
    pub fn reyes(mut self, settings: ReyesSettings) -> Self {
        self.reyes = settings;
        self
    }

    /// Hears now and then how many of how many samples are done, from one thread at a time.
    ///
    /// The closure cannot call gpurt: fallible functions return an error there. If it panics, it is not
    /// called again.
    pub fn progress(mut self, progress: impl Fn(f64, f64) + Send + Sync + 'static) -> Self {
        self.progress = Some(Arc::new(progress));
        self
    }
}

impl Default for RenderDesc {
    fn default() -> Self {
        RenderDesc::new()
    }
}

impl fmt::Debug for RenderDesc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RenderDesc")
            .field("pipeline", &self.pipeline)
            .field("samples_per_pixel", &self.samples_per_pixel)
            .field("target_error", &self.target_error)
            .field("time_limit", &self.time_limit)
            .field("max_depth", &self.max_depth)
            .field("tile_size", &self.tile_size)
            .field("progress", &self.progress.is_some())
            .field("schedule", &self.schedule)
            .field("photon", &self.photon)
            .field("reyes", &self.reyes)
            .finish()
    }
}

impl Job {
    /// No tiles: the whole frame.
    pub(crate) fn submit(frame: &Frame, render: &RenderDesc, tiles: &[Tile]) -> Result<Job> {
        let mut desc = sys::gpurt_render_desc {
            pipeline: render.pipeline as u32,
            samples_per_pixel: render.samples_per_pixel,
            target_error: render.target_error,
            time_limit_s: render.time_limit.as_secs_f64(),
            max_depth: render.max_depth,
            tile_size: render.tile_size,
            schedule: render.schedule.raw(),
            photon: render.photon.raw(),
            reyes: render.reyes.raw(),
            ..Default::default()
        };
        let mut callbacks = frame.callbacks().clone();
        if let Some(progress) = &render.progress {
            let registration = Registration::new(Closure::Progress(progress.clone()));
            desc.progress = Some(callback::progress);
            desc.progress_user = registration.user();
            callbacks.push(registration);
        }
        let tiles_data =
            if tiles.is_empty() { ptr::null() } else { tiles.as_ptr() as *const sys::gpurt_tile };
        let mut job = ptr::null_mut();
        // SAFETY: the handle is valid; Tile has the layout of gpurt_tile; all arguments live during the call,
        // which copies them.
        call(|| unsafe {
            sys::gpurt_frame_submit(frame.as_raw(), &desc, tiles_data, tiles.len(), &mut job)
        })?;
        Ok(Job::own(job, callbacks))
    }

    /// Waits for the job's end: its result, or [`Error::Cancelled`].
    pub fn wait(&self) -> Result<()> {
        self.wait_ns(sys::GPURT_WAIT_FOREVER)
    }

    /// Waits no longer than `timeout`; zero polls. Returns whether the job has ended.
    pub fn wait_timeout(&self, timeout: Duration) -> Result<bool> {
        // The largest number means no limit to the library; this one is 584 years.
        let ns = timeout.as_nanos().min(u128::from(sys::GPURT_WAIT_FOREVER - 1)) as u64;
        match self.wait_ns(ns) {
            Ok(()) => Ok(true),
            Err(Error::Timeout(_)) => Ok(false),
            Err(error) => Err(error),
        }
    }

    fn wait_ns(&self, timeout_ns: u64) -> Result<()> {
        // SAFETY: the handle is valid.
        call(|| unsafe { sys::gpurt_job_wait(self.as_raw(), timeout_ns) })
    }

    /// Asks the job to stop. It does so within half a second, keeping whole samples; waiting then gives
    /// [`Error::Cancelled`].
    pub fn cancel(&self) -> Result<()> {
        // SAFETY: the handle is valid.
        call(|| unsafe { sys::gpurt_job_cancel(self.as_raw()) })
    }

    /// Share of the job that is done, in [0, 1].
    pub fn progress(&self) -> Result<f64> {
        let mut share = 0.0;
        // SAFETY: the handle is valid; the output lives during the call.
        call(|| unsafe { sys::gpurt_job_get_progress(self.as_raw(), &mut share) })?;
        Ok(share)
    }
}
