//! Settings of the pipelines beside path tracing, and what these did.
use crate::{sys, PhotonEstimator, PhotonKernel, PhotonRemedy, ReyesFilter, ReyesShading, Result};

/// Settings of [`Pipeline::Photon`](crate::Pipeline::Photon). By default, the library's choice, or what the frame's samples
/// were made with.
///
/// ```
/// use gpurt::{PhotonRemedy, PhotonSettings, Pipeline, RenderDesc};
///
/// let photon = PhotonSettings {
///     photons_per_pass: 1 << 20,
///     remedies: Some(vec![PhotonRemedy::Normal, PhotonRemedy::Side]),
///     ..Default::default()
/// };
/// let render = RenderDesc::new().pipeline(Pipeline::Photon).photon(photon);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PhotonSettings {
    /// Photons that are emitted for each sample of the pixels; 0: about one for each pixel of the frame; where it
    /// renders for a time, chosen by trials.
    pub photons_per_pass: u32,
    /// Of the first pass, in metres; 0: from the scene; where it renders for a time, chosen by trials.
    pub initial_radius: f32,
    /// How photons become radiance.
    pub estimator: PhotonEstimator,
    /// What photons within the radius count.
    pub kernel: PhotonKernel,
    /// What is done about photons of other surfaces, and about surfaces that end; `None`: all of it.
    pub remedies: Option<Vec<PhotonRemedy>>,
}

impl Default for PhotonSettings {
    fn default() -> Self {
        PhotonSettings {
            photons_per_pass: 0,
            initial_radius: 0.0,
            estimator: PhotonEstimator::Auto,
            kernel: PhotonKernel::Auto,
            remedies: None,
        }
    }
}

impl PhotonSettings {
    pub(crate) fn raw(&self) -> sys::gpurt_photon_settings {
        let remedies = match self.remedies.as_deref() {
            None => 0,
            Some([]) => sys::GPURT_PHOTON_REMEDY_NONE,
            Some(remedies) => remedies.iter().fold(0, |bits, &remedy| bits | remedy as u32),
        };
        sys::gpurt_photon_settings {
            photons_per_pass: self.photons_per_pass,
            initial_radius: self.initial_radius,
            estimator: self.estimator as u32,
            kernel: self.kernel as u32,
            remedies,
            reserved: 0,
        }
    }

    /// `None`: another pipeline.
    pub(crate) fn from_raw(raw: &sys::gpurt_photon_settings) -> Result<Option<Self>> {
        if raw.photons_per_pass == 0 {
            return Ok(None);
        }
        let remedies = [1, 2, 4, 8, sys::GPURT_PHOTON_REMEDY_CONTINUE]
            .into_iter()
            .filter(|bit| raw.remedies & bit != 0)
            .map(PhotonRemedy::from_raw)
            .collect::<Result<_>>()?;
        Ok(Some(PhotonSettings {
            photons_per_pass: raw.photons_per_pass,
            initial_radius: raw.initial_radius,
            estimator: PhotonEstimator::from_raw(raw.estimator)?,
            kernel: PhotonKernel::from_raw(raw.kernel)?,
            remedies: Some(remedies),
        }))
    }
}

filled_struct! {
    /// What photon mapping did.
    PhotonCounters: gpurt_photon_counters as raw {
        same {
            /// Photon paths.
            num_emitted: u64,
            /// Rays of photons.
            num_rays: u64,
            /// Photons on surfaces that receive them.
            num_stored: u64,
            /// Photons that counted at visible points.
            num_gathered: u64,
            /// Visible points.
            num_visible: u64,
            /// Photon maps that were built: more than passes where memory held no whole pass.
            num_sub_passes: u64,
            /// Per stage, summed over threads: photons from the lights to where they end.
            trace_seconds: f64,
            /// Per stage, summed over threads.
            build_seconds: f64,
            /// Per stage, summed over threads.
            gather_seconds: f64,
            /// Of the last pass so far.
            smallest_radius: f64,
            /// Of `trace_seconds`: at the lights.
            emit_seconds: f64,
            /// Of `trace_seconds`: at surfaces; the rest is rays.
            scatter_seconds: f64,
        }
        converted {}
    }
}

/// Settings of [`Pipeline::Reyes`](crate::Pipeline::Reyes). By default, the library's choice, or what the frame's samples
/// were made with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReyesSettings {
    /// Area of a micropolygon in pixels; 0: 0.25, of [`ReyesFilter::Gaussian`] 0.375.
    pub shading_rate: f32,
    /// How samples become pixels.
    pub filter: ReyesFilter,
    /// Where light is computed.
    pub shading: ReyesShading,
    /// Nothing stands between a surface and a light.
    pub no_shadows: bool,
    /// Above 0, micropolygons may be larger, with edges of up to 2.8 pixels, where they stay within so many pixels of the surface.
    pub flatness: f32,
    /// 0: a sample keeps all fragments of surfaces that blend. Above 0, at most 64: a study variant, the fixed A-buffer: the
    /// nearest ones, so many of them; the others are lost, and counted.
    pub fragment_slots: u32,
}

impl Default for ReyesSettings {
    fn default() -> Self {
        ReyesSettings {
            shading_rate: 0.0,
            filter: ReyesFilter::Auto,
            shading: ReyesShading::Auto,
            no_shadows: false,
            flatness: 0.0,
            fragment_slots: 0,
        }
    }
}

impl ReyesSettings {
    pub(crate) fn raw(&self) -> sys::gpurt_reyes_settings {
        sys::gpurt_reyes_settings {
            shading_rate: self.shading_rate,
            filter: self.filter as u32,
            shading: self.shading as u32,
            no_shadows: self.no_shadows as u32,
            flatness: self.flatness,
            fragment_slots: self.fragment_slots,
        }
    }

    /// `None`: another pipeline.
    pub(crate) fn from_raw(raw: &sys::gpurt_reyes_settings) -> Result<Option<Self>> {
        if raw.shading_rate == 0.0 {
            return Ok(None);
        }
        Ok(Some(ReyesSettings {
            shading_rate: raw.shading_rate,
            filter: ReyesFilter::from_raw(raw.filter)?,
            shading: ReyesShading::from_raw(raw.shading)?,
            no_shadows: raw.no_shadows != 0,
            flatness: raw.flatness,
            fragment_slots: raw.fragment_slots,
        }))
    }
}

filled_struct! {
    /// What REYES did. What several tiles see counts in each.
    ReyesCounters: gpurt_reyes_counters as raw {
        same {
            /// Patches that may be seen.
            num_patches: u64,
            /// Triangles of meshes that may be seen.
            num_triangles: u64,
            /// Pieces of patches that were cut in two.
            num_splits: u64,
            /// Pieces that cannot be seen.
            num_culled: u64,
            /// Pieces that were diced.
            num_grids: u64,
            /// Micropolygons of these.
            num_micropolygons: u64,
            /// Times that a sample took a surface, nearer than what it had.
            num_fragments: u64,
            /// Points where light was computed.
            num_shaded: u64,
            /// Pieces that waited at a time.
            largest_queue: u64,
            /// Primitives that a bucket of the image had to look at.
            largest_bucket: u64,
            /// Memory of the pipeline at a time, beside the scene and the film.
            working_bytes: u64,
            /// Per stage, summed over threads.
            bound_seconds: f64,
            /// Per stage, summed over threads.
            split_seconds: f64,
            /// Per stage, summed over threads.
            dice_seconds: f64,
            /// Per stage, summed over threads.
            sample_seconds: f64,
            /// CUDA devices: launches, or rounds of one, in which pieces were cut.
            split_rounds: u64,
            /// `Launch::Persistent`: pieces that a block gave away for others to cut.
            num_donated: u64,
            /// Fragments of surfaces that blend that were kept at a time; a largest, not a sum.
            largest_fragments: u64,
            /// Fragments that found no slot, with [`ReyesSettings::fragment_slots`].
            num_lost_fragments: u64,
        }
        converted {}
    }
}
