//! Raw bindings to gpurt's C ABI. The header `gpurt.h` is their documentation; the crate `gpurt` is the safe
//! way to use the library.
//!
//! Descriptors implement `Default` as the header's `_INIT` macros do:
//!
//! ```no_run
//! let desc = gpurt_sys::gpurt_frame_desc { width: 640, height: 480, ..Default::default() };
//! ```
#![allow(non_camel_case_types)]

#[rustfmt::skip]
mod bindings;
pub use bindings::*;

/// `UINT64_MAX`, as a timeout of [`gpurt_job_wait`].
pub const GPURT_WAIT_FOREVER: u64 = u64::MAX;

const IDENTITY: [f32; 12] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.];

macro_rules! init {
    ($($desc:ident { $($field:ident: $value:expr),* })*) => {$(
        impl Default for $desc {
            fn default() -> Self {
                // SAFETY: every field is a number, an array of numbers, a raw pointer or an Option of a
                // function pointer, or a struct of such fields; all of them may be all zero bits.
                let zeroed: Self = unsafe { std::mem::zeroed() };
                $desc { struct_size: std::mem::size_of::<Self>() as u32, $($field: $value,)* ..zeroed }
            }
        }
    )*};
}

init! {
    gpurt_device_desc {}
    gpurt_device_properties {}
    gpurt_buffer_desc {}
    gpurt_texture_desc {}
    gpurt_material_desc { base_color: [1.; 3], roughness: 1., alpha: 1., attenuation_color: [1.; 3] }
    gpurt_mesh_desc {}
    gpurt_patches_desc {}
    gpurt_subdivision_desc {}
    gpurt_instance_desc { transform: IDENTITY }
    gpurt_light_desc {}
    gpurt_environment_desc {}
    gpurt_camera_desc { transform: IDENTITY }
    gpurt_build_desc {}
    gpurt_scene_facts {}
    gpurt_kdtree {}
    gpurt_trace_desc {}
    gpurt_locate_desc {}
    gpurt_frame_desc {}
    gpurt_render_desc {}
    gpurt_state_info {}
    gpurt_statistics {}
    gpurt_photon_map_desc {}
    gpurt_photon_map_info {}
    gpurt_photon_query_desc {}
    gpurt_photon_trace_desc {}
}

impl Default for gpurt_array {
    /// No array.
    fn default() -> Self {
        gpurt_array {
            data: std::ptr::null(),
            buffer: std::ptr::null_mut(),
            offset_bytes: 0,
            stride_bytes: 0,
            count: 0,
        }
    }
}
