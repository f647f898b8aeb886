//! The bindings against the headers in include/, asked of the C compiler: nothing is missing, and constants,
//! signatures, layouts and default values are the same.
use std::collections::BTreeSet;
use std::fmt::Write;
use std::mem::{size_of, size_of_val, MaybeUninit};
use std::path::{Path, PathBuf};
use std::process::Command;

use gpurt_sys::*;

const BINDINGS: &str = concat!(include_str!("../src/bindings.rs"), include_str!("../src/lib.rs"));

fn include_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../include")
}

fn words(text: &str) -> BTreeSet<&str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').collect()
}

/// Compiles a C program that includes gpurt.h and returns what it prints.
fn run_c(name: &str, source: &str) -> String {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let (file, program) = (dir.join(format!("{}.c", name)), dir.join(name));
    std::fs::write(&file, source).unwrap();
    let compiled = Command::new(std::env::var_os("CC").unwrap_or_else(|| "cc".into()))
        .args(["-std=c11", "-Wall", "-Werror", "-I"])
        .args([include_dir().as_path(), Path::new("-o"), &program, &file])
        .output()
        .expect("a C compiler");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let output = Command::new(program).output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn nothing_is_missing() {
    let header = ["gpurt.h", "gpurt_cuda.h"]
        .map(|name| std::fs::read_to_string(include_dir().join(name)).unwrap())
        .concat();
    // Comments may name what is no declaration.
    let mut code = String::new();
    for (i, part) in header.split("/*").enumerate() {
        code += if i == 0 { part } else { part.split_once("*/").unwrap().1 };
    }
    let bound = words(BINDINGS);
    let is_macro =
        |word: &str| word.ends_with("_INIT") || ["GPURT_H", "GPURT_CUDA_H", "GPURT_API"].contains(&word);
    let missing: Vec<_> = words(&code)
        .into_iter()
        .filter(|word| word.to_lowercase().starts_with("gpurt_") && !is_macro(word) && !bound.contains(word))
        .collect();
    assert!(missing.is_empty(), "the headers declare {:?}: run scripts/bindgen", missing);
}

/// The C spelling of a type of the bindings.
fn c_type(rust: &str) -> String {
    if let Some(to) = rust.strip_prefix("*mut ") {
        return format!("{} *", c_type(to));
    }
    if let Some(to) = rust.strip_prefix("*const ") {
        // `const T *`; the pointers of the header are never const themselves.
        return format!("const {} *", c_type(to));
    }
    match rust {
        "u8" | "u32" | "u64" => format!("uint{}_t", &rust[1..]),
        "usize" => "size_t".into(),
        "f32" => "float".into(),
        "f64" => "double".into(),
        "::std::os::raw::c_void" => "void".into(),
        "::std::os::raw::c_char" => "char".into(),
        name => name.into(),
    }
}

#[test]
fn constants_and_signatures_agree() {
    let flat = BINDINGS.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut source = String::from("#include \"gpurt_cuda.h\"\n");
    let mut count = [0, 0];
    for part in flat.split("pub const GPURT_").skip(1) {
        let (name, rest) = part.split_once(':').unwrap();
        let value = rest.split_once("= ").unwrap().1.split_once(';').unwrap().0;
        let value = if value == "u64::MAX" { "18446744073709551615u" } else { value };
        writeln!(source, "_Static_assert(GPURT_{} == {}, \"GPURT_{}\");", name, value, name).unwrap();
        count[0] += 1;
    }
    // A declaration that differs from the header's does not compile.
    for part in flat.split("pub fn gpurt_").skip(1) {
        let declaration = part.split_once(';').unwrap().0;
        let (declaration, result) = declaration.split_once(" -> ").unwrap();
        let (name, arguments) = declaration.split_once('(').unwrap();
        let arguments: Vec<_> = arguments
            .trim_end_matches(')')
            .split(',')
            .filter_map(|argument| Some(c_type(argument.split_once(": ")?.1.trim())))
            .collect();
        let arguments = if arguments.is_empty() { "void".into() } else { arguments.join(", ") };
        writeln!(source, "{} gpurt_{}({});", c_type(result), name, arguments).unwrap();
        count[1] += 1;
    }
    assert!(count[0] > 80 && count[1] > 35, "found {:?} constants and functions", count);
    run_c("constants", &(source + "int main(void) { return 0; }\n"));
}

/// Lines that describe types: from Rust, and the C code that prints the same lines.
#[derive(Default)]
struct Layouts {
    rust: String,
    c: String,
}

impl Layouts {
    fn line(&mut self, expression: &str, value: usize) {
        writeln!(self.rust, "{} {}", expression, value).unwrap();
        writeln!(self.c, "printf(\"{} %zu\\n\", {});", expression, expression).unwrap();
    }

    /// The bytes of a field of the default value.
    fn bytes(&mut self, name: &str, field: &str, bytes: &[u8]) {
        let hex: String = bytes.iter().map(|byte| format!("{:02x}", byte)).collect();
        writeln!(self.rust, "{}.{} {}", name, field, hex).unwrap();
        let init = format!("{}_INIT", name.to_uppercase());
        writeln!(
            self.c,
            "{{ const {} v = {}; show(\"{}.{}\", &v.{}, sizeof v.{}); }}",
            name, init, name, field, field, field
        )
        .unwrap();
    }
}

/// `name { every field }`: the pattern makes the compiler refuse a list that is not complete.
macro_rules! layouts {
    ($layouts:ident: $($name:ident { $($field:ident)* })*) => {$({
        let value = MaybeUninit::<$name>::zeroed();
        let start = value.as_ptr();
        $layouts.line(concat!("sizeof(", stringify!($name), ")"), size_of::<$name>());
        $(
            // SAFETY: the address of a field alone; nothing is read.
            let offset = unsafe { std::ptr::addr_of!((*start).$field) as usize - start as usize };
            let field = stringify!($field).trim_end_matches('_');
            $layouts.line(&format!("offsetof({}, {})", stringify!($name), field), offset);
        )*
        let _complete = |value: $name| { let $name { $($field: _),* } = value; };
    })*};
}

macro_rules! defaults {
    ($layouts:ident: $($name:ident { $($field:ident)* })*) => {$({
        let value = $name::default();
        $(
            let field = &value.$field;
            let start = field as *const _ as *const u8;
            // SAFETY: no field has padding.
            let bytes = unsafe { std::slice::from_raw_parts(start, size_of_val(field)) };
            $layouts.bytes(stringify!($name), stringify!($field).trim_end_matches('_'), bytes);
        )*
    })*};
}

/// Hands every descriptor with its fields to a macro.
macro_rules! with_descriptors {
    ($macro:ident, $layouts:ident) => {
        $macro! { $layouts:
            gpurt_device_desc { struct_size type_ ordinal num_threads memory_limit_bytes log log_user ordinals
                num_ordinals reserved }
            gpurt_device_properties { struct_size type_ ordinal num_threads memory_bytes memory_limit_bytes
                memory_used_bytes memory_peak_bytes compute_capability name instruction_set }
            gpurt_buffer_desc { struct_size storage size_bytes data release release_user }
            gpurt_texture_desc { struct_size format width height wrap_u wrap_v filter reserved texels }
            gpurt_material_desc { struct_size type_ base_color roughness ior alpha alpha_cutoff emission
                base_color_texture two_sided_emission blends emission_texture attenuation_color
                attenuation_distance }
            gpurt_mesh_desc { struct_size material vertices indices normals uvs }
            gpurt_patches_desc { struct_size material control_points }
            gpurt_subdivision_desc { struct_size material scheme reserved vertices face_counts indices }
            gpurt_instance_desc { struct_size geometry transform }
            gpurt_light_desc { struct_size type_ intensity position direction inner_cone_angle_rad
                outer_cone_angle_rad }
            gpurt_environment_desc { struct_size texture radiance }
            gpurt_camera_desc { struct_size type_ transform yfov_rad lens_radius focus_distance shutter_open
                shutter_close width height }
            gpurt_build_desc { struct_size accel triangle_test max_depth traversal_cost empty_bonus
                patch_tolerance quality tree_cache_path patch_pixels patch_camera patch_width patch_height }
            gpurt_scene_facts { struct_size num_geometries num_instances num_materials num_textures
                num_cameras num_point_lights num_distant_lights num_patches num_triangles num_world_triangles
                num_emissive_triangles bounds_min bounds_max has_environment has_glass has_alpha_masks
                is_committed accel triangle_test accel_bytes scene_bytes num_nodes num_references tree_depth
                tree_from_cache build_seconds sah_cost accel_build_seconds build_peak_bytes tree_refitted
                has_blending patch_error patch_error_pixels }
            gpurt_kdtree { struct_size tree num_nodes num_references num_triangles bounds_min bounds_max nodes
                references }
            gpurt_trace_desc { struct_size query format storage num_rays rays hits occluded offsets
                hit_capacity schedule out_counters coherence image_width count_lanes reserved }
            gpurt_locate_desc { struct_size format num_hits hits geometry instance points positions normals }
            gpurt_frame_desc { struct_size width height camera outputs frame_index seed first_sample }
            gpurt_render_desc { struct_size pipeline samples_per_pixel target_error time_limit_s max_depth
                tile_size progress progress_user schedule photon reyes }
            gpurt_photon_map_desc { struct_size storage num_points positions fluxes normals radius num_levels }
            gpurt_photon_map_info { struct_size num_levels num_points bounds radius has_fluxes has_normals
                fullest_cell memory_bytes build_seconds has_directions num_paths }
            gpurt_photon_trace_desc { struct_size num_paths seed pass frame_index max_depth radius num_levels }
            gpurt_photon_query_desc { struct_size query storage kernel num_queries positions normals min_cosine
                radius radius_hint k counts sums offsets ids distances capacity coherence method }
            gpurt_state_info { struct_size width height camera outputs frame_index seed first_sample
                num_samples scene_hash pipeline accel triangle_test max_depth photon reyes }
            gpurt_statistics { struct_size pipeline accel triangle_test max_depth tile_size num_threads width
                height seed samples_per_pixel num_samples num_camera_rays num_bounce_rays num_shadow_rays
                num_nonfinite num_saturated render_seconds generate_seconds trace_seconds shade_seconds
                shadow_seconds film_seconds build_seconds estimated_error largest_sample memory_peak_bytes
                reason schedule schedule_counters photon photon_counters reyes reyes_counters estimated_bias }
        }
    };
}

#[test]
fn layouts_and_defaults_agree() {
    let mut layouts = Layouts::default();
    layouts! { layouts:
        gpurt_array { data buffer offset_bytes stride_bytes count }
        gpurt_kdtree_node { word tag }
        gpurt_ray { origin tmin direction tmax }
        gpurt_hit { t u v primitive geometry instance padding }
        gpurt_hit_compact { t u v primitive }
        gpurt_patch_point { patch u v }
        gpurt_tile { x0 y0 x1 y1 }
        gpurt_schedule { traversal launch fetch compaction shading generation reserved ray_budget }
        gpurt_schedule_counters { ray_refills list_rounds list_overflows mode_switches packets shared_triangles
            compactions sorted_hits counted_rays wave_splits device_ns path_refills warp_steps lane_steps reserved }
        gpurt_photon_settings { photons_per_pass initial_radius estimator kernel remedies reserved }
        gpurt_photon_counters { num_emitted num_rays num_stored num_gathered num_visible num_sub_passes
            trace_seconds build_seconds gather_seconds smallest_radius emit_seconds scatter_seconds reserved }
        gpurt_reyes_settings { shading_rate filter shading no_shadows flatness fragment_slots }
        gpurt_reyes_counters { num_patches num_triangles num_splits num_culled num_grids num_micropolygons
            num_fragments num_shaded largest_queue largest_bucket working_bytes bound_seconds split_seconds
            dice_seconds sample_seconds split_rounds num_donated largest_fragments num_lost_fragments
            reserved }
        gpurt_cuda_kernel { name num_launches block_threads registers local_bytes shared_bytes
            blocks_per_multiprocessor occupancy }
    }
    with_descriptors!(layouts, layouts);
    with_descriptors!(defaults, layouts);
    let source = format!(
        r#"#include <stdio.h>
#include "gpurt.h"
#include "gpurt_cuda.h"
static void show(const char *name, const void *value, size_t size)
{{
  printf("%s ", name);
  for (size_t i = 0; i < size; ++i) printf("%02x", ((const unsigned char *)value)[i]);
  printf("\n");
}}
int main(void)
{{
{}}}
"#,
        layouts.c
    );
    let c = run_c("layouts", &source);
    for (c, rust) in c.lines().zip(layouts.rust.lines()) {
        assert_eq!(rust, c, "left: Rust, right: C");
    }
    assert_eq!(c.lines().count(), layouts.rust.lines().count());
    // Every struct of the bindings is in the list above.
    let structs = BINDINGS.split("pub struct ").skip(1).map(|part| part.split_once(' ').unwrap().0);
    for name in structs.filter(|name| !name.ends_with("_t")) {
        assert!(layouts.rust.contains(&format!("sizeof({}) ", name)), "{} is not tested", name);
    }
}

#[test]
fn the_library_is_the_headers_version() {
    // SAFETY: takes nothing, changes nothing.
    let version = unsafe { gpurt_version() };
    assert_eq!(version, GPURT_VERSION_MAJOR << 16 | GPURT_VERSION_MINOR << 8 | GPURT_VERSION_PATCH);
    let crate_version = format!("{}.{}.{}", version >> 16, version >> 8 & 255, version & 255);
    assert_eq!(crate_version, env!("CARGO_PKG_VERSION"));
}
