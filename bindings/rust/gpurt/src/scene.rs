//! Scenes: what there is, and the structure over it that rays are traced through.
use std::ffi::c_void;
use std::path::{Path, PathBuf};
use std::ptr;

use crate::callback::{call, Callbacks};
use crate::macros::c_path;
use crate::*;

handle! {
    /// Geometry, materials, textures, lights and cameras, and what [`commit`](Scene::commit) built of them.
    ///
    /// Methods that change a scene take `&self`: the library lets them exclude each other. Queries and
    /// renders see the last commit that succeeded before they started.
    Scene: gpurt_scene, gpurt_scene_retain, gpurt_scene_release
}

/// How a scene is built. Zero means the library's choice.
#[derive(Debug, Clone, PartialEq)]
#[must_use]
pub struct BuildDesc {
    /// The acceleration structure.
    pub accel: Accel,
    /// The intersection test.
    pub triangle_test: TriangleTest,
    /// Kd-tree: depth of the tree; 0: 8 + 1.3 log2 N; at most 48.
    pub max_depth: u32,
    /// Kd-tree: cost of a step in units of a triangle test.
    pub traversal_cost: f32,
    /// Kd-tree: factor on the cost of splits that cut off empty space.
    pub empty_bonus: f32,
    /// Largest distance, in metres of the world, between a patch and its triangles; 0: 1e-4 of the
    /// diagonal of the patches' bounds, or none with `patch_pixels`.
    pub patch_tolerance: f32,
    /// Above 0: largest distance between a patch and its triangles in pixels of a picture, as far as it shows them directly.
    /// With `patch_tolerance` too, the smaller one holds.
    pub patch_pixels: f32,
    /// With `patch_pixels`: whose picture it is.
    pub patch_camera: CameraId,
    /// With `patch_pixels`: of the picture; 0: what the camera says, else 512.
    pub patch_width: u32,
    /// With `patch_pixels`: of the picture; 0: what the camera says, else 512.
    pub patch_height: u32,
    /// How much time building may take.
    pub quality: BuildQuality,
    /// Kd-tree: reuse the tree of this file if it fits the scene, else build and write it.
    pub tree_cache: Option<PathBuf>,
}

impl Default for BuildDesc {
    fn default() -> Self {
        BuildDesc {
            accel: Accel::Auto,
            triangle_test: TriangleTest::Watertight,
            max_depth: 0,
            traversal_cost: 0.0,
            empty_bonus: 0.0,
            patch_tolerance: 0.0,
            patch_pixels: 0.0,
            patch_camera: CameraId(0),
            patch_width: 0,
            patch_height: 0,
            quality: BuildQuality::Auto,
            tree_cache: None,
        }
    }
}

impl Scene {
    /// Creates an empty scene.
    pub fn new(device: &Device) -> Result<Self> {
        let mut scene = ptr::null_mut();
        // SAFETY: the handle is valid; the output lives during the call.
        call(|| unsafe { sys::gpurt_scene_create(device.as_raw(), &mut scene) })?;
        Ok(Scene::own(scene, device.callbacks().clone()))
    }

    /// Loads a scene from a glTF 2.0 file (`.glb` or `.gltf`) and leaves it ready to commit.
    ///
    /// What has no exact counterpart here is named in a warning through the device's log.
    pub fn load(device: &Device, path: impl AsRef<Path>) -> Result<Self> {
        let path = c_path(path.as_ref())?;
        let mut scene = ptr::null_mut();
        // SAFETY: the handle is valid; the path and the output live during the call.
        call(|| unsafe { sys::gpurt_scene_load(device.as_raw(), path.as_ptr(), &mut scene) })?;
        Ok(Scene::own(scene, device.callbacks().clone()))
    }

    /// Calls a function that adds something and writes its id.
    fn add(&self, add: impl FnOnce(&mut u32) -> sys::gpurt_result) -> Result<u32> {
        let mut id = 0;
        call(|| add(&mut id))?;
        Ok(id)
    }

    /// Adds a texture.
    pub fn add_texture(&self, texture: &Texture) -> Result<TextureId> {
        let (format, texels, len) = match texture.texels {
            Texels::Srgb8(texels) => {
                (sys::GPURT_TEXTURE_RGBA8_SRGB, texels.as_ptr() as *const c_void, texels.len())
            }
            Texels::Linear8(texels) => {
                (sys::GPURT_TEXTURE_RGBA8_LINEAR, texels.as_ptr() as *const c_void, texels.len())
            }
            Texels::Float(texels) => {
                (sys::GPURT_TEXTURE_RGBA32F, texels.as_ptr() as *const c_void, texels.len())
            }
        };
        if len as u64 != u64::from(texture.width) * u64::from(texture.height) {
            return Err(Error::InvalidArgument(format!(
                "a texture of {} x {} texels was given {}",
                texture.width, texture.height, len
            )));
        }
        let desc = sys::gpurt_texture_desc {
            format,
            width: texture.width,
            height: texture.height,
            wrap_u: texture.wrap_u as u32,
            wrap_v: texture.wrap_v as u32,
            filter: texture.filter as u32,
            texels,
            ..Default::default()
        };
        // SAFETY: the handle is valid; there are as many texels as the library reads, and it copies them.
        self.add(|id| unsafe { sys::gpurt_scene_add_texture(self.as_raw(), &desc, id) }).map(TextureId)
    }

    /// Adds a material.
    pub fn add_material(&self, material: &Material) -> Result<MaterialId> {
        let desc = sys::gpurt_material_desc {
            type_: material.kind as u32,
            base_color: material.base_color,
            roughness: material.roughness,
            ior: material.ior,
            alpha: material.alpha,
            alpha_cutoff: material.alpha_cutoff,
            emission: material.emission,
            base_color_texture: material.base_color_texture.map_or(0, |texture| texture.0),
            two_sided_emission: material.two_sided_emission.into(),
            blends: material.blends.into(),
            emission_texture: material.emission_texture.map_or(0, |texture| texture.0),
            attenuation_color: material.attenuation_color,
            attenuation_distance: material.attenuation_distance,
            ..Default::default()
        };
        // SAFETY: the handle is valid; the descriptor holds no pointer.
        self.add(|id| unsafe { sys::gpurt_scene_add_material(self.as_raw(), &desc, id) }).map(MaterialId)
    }

    /// Adds a triangle mesh. It is seen where instances place it.
    pub fn add_mesh(&self, mesh: &Mesh) -> Result<GeometryId> {
        // SAFETY: the handle is valid; slices live during the call, which copies them; the scene retains
        // buffers.
        self.add(|id| unsafe { sys::gpurt_scene_add_mesh(self.as_raw(), &mesh.raw(), id) }).map(GeometryId)
    }

    /// Adds bicubic Bézier patches. They are seen where instances place them.
    pub fn add_patches(&self, patches: &Patches) -> Result<GeometryId> {
        // SAFETY: as for meshes.
        self.add(|id| unsafe { sys::gpurt_scene_add_patches(self.as_raw(), &patches.raw(), id) })
            .map(GeometryId)
    }

    /// Adds a subdivision surface. This version of the library does not support it.
    pub fn add_subdivision(&self, surface: &Subdivision) -> Result<GeometryId> {
        // SAFETY: as for meshes.
        self.add(|id| unsafe { sys::gpurt_scene_add_subdivision(self.as_raw(), &surface.raw(), id) })
            .map(GeometryId)
    }

    /// Places a geometry in the world. The transform must be invertible.
    pub fn add_instance(&self, geometry: GeometryId, transform: Transform) -> Result<InstanceId> {
        let desc = sys::gpurt_instance_desc {
            geometry: geometry.0,
            transform: flatten(transform),
            ..Default::default()
        };
        // SAFETY: the handle is valid; the descriptor holds no pointer.
        self.add(|id| unsafe { sys::gpurt_scene_add_instance(self.as_raw(), &desc, id) }).map(InstanceId)
    }

    /// Adds a light without extent.
    pub fn add_light(&self, light: &Light) -> Result<LightId> {
        let mut desc = sys::gpurt_light_desc::default();
        match *light {
            Light::Point { intensity, position } => {
                desc.type_ = sys::GPURT_LIGHT_POINT;
                desc.intensity = intensity;
                desc.position = position;
            }
            Light::Spot { intensity, position, direction, inner_cone_angle_rad, outer_cone_angle_rad } => {
                desc.type_ = sys::GPURT_LIGHT_SPOT;
                desc.intensity = intensity;
                desc.position = position;
                desc.direction = direction;
                desc.inner_cone_angle_rad = inner_cone_angle_rad;
                desc.outer_cone_angle_rad = outer_cone_angle_rad;
            }
            Light::Distant { irradiance, direction } => {
                desc.type_ = sys::GPURT_LIGHT_DISTANT;
                desc.intensity = irradiance;
                desc.direction = direction;
            }
        }
        // SAFETY: the handle is valid; the descriptor holds no pointer.
        self.add(|id| unsafe { sys::gpurt_scene_add_light(self.as_raw(), &desc, id) }).map(LightId)
    }

    /// Sets the radiance that comes from infinity: a constant, or the factor of a lat-long radiance image.
    ///
    /// World direction (x, y, z) of unit length is looked up at u = atan2(x, -z) / 2π mod 1, v = acos(y) / π.
    pub fn set_environment(&self, radiance: [f32; 3], texture: Option<TextureId>) -> Result<()> {
        let texture = texture.map_or(0, |texture| texture.0);
        let desc = sys::gpurt_environment_desc { texture, radiance, ..Default::default() };
        // SAFETY: the handle is valid; the descriptor holds no pointer.
        call(|| unsafe { sys::gpurt_scene_set_environment(self.as_raw(), &desc) })
    }

    /// Adds a camera.
    pub fn add_camera(&self, camera: &Camera) -> Result<CameraId> {
        let desc = sys::gpurt_camera_desc {
            type_: camera.kind as u32,
            transform: flatten(camera.transform),
            yfov_rad: camera.yfov_rad,
            lens_radius: camera.lens_radius,
            focus_distance: camera.focus_distance,
            shutter_open: camera.shutter_open,
            shutter_close: camera.shutter_close,
            width: camera.width,
            height: camera.height,
            ..Default::default()
        };
        // SAFETY: the handle is valid; the descriptor holds no pointer.
        self.add(|id| unsafe { sys::gpurt_scene_add_camera(self.as_raw(), &desc, id) }).map(CameraId)
    }

    /// Reads a camera back.
    pub fn camera(&self, camera: CameraId) -> Result<Camera> {
        let mut desc = sys::gpurt_camera_desc::default();
        // SAFETY: the handle is valid; the output lives during the call.
        call(|| unsafe { sys::gpurt_scene_get_camera(self.as_raw(), camera.0, &mut desc) })?;
        let t = desc.transform;
        Ok(Camera {
            kind: CameraType::from_raw(desc.type_)?,
            transform: [[t[0], t[1], t[2], t[3]], [t[4], t[5], t[6], t[7]], [t[8], t[9], t[10], t[11]]],
            yfov_rad: desc.yfov_rad,
            lens_radius: desc.lens_radius,
            focus_distance: desc.focus_distance,
            shutter_open: desc.shutter_open,
            shutter_close: desc.shutter_close,
            width: desc.width,
            height: desc.height,
        })
    }

    /// Builds the acceleration structure as the library chooses. See [`commit_with`](Scene::commit_with).
    pub fn commit(&self) -> Result<()> {
        self.commit_with(&BuildDesc::default())
    }

    /// Builds the acceleration structure. Queries and renders that start later see it.
    ///
    /// A failed commit leaves the previous one in force. Work in flight keeps the commit that it started
    /// with.
    pub fn commit_with(&self, build: &BuildDesc) -> Result<()> {
        let cache = build.tree_cache.as_deref().map(c_path).transpose()?;
        let desc = sys::gpurt_build_desc {
            accel: build.accel as u32,
            triangle_test: build.triangle_test as u32,
            max_depth: build.max_depth,
            traversal_cost: build.traversal_cost,
            empty_bonus: build.empty_bonus,
            patch_tolerance: build.patch_tolerance,
            patch_pixels: build.patch_pixels,
            patch_camera: build.patch_camera.0,
            patch_width: build.patch_width,
            patch_height: build.patch_height,
            quality: build.quality as u32,
            tree_cache_path: cache.as_ref().map_or(ptr::null(), |path| path.as_ptr()),
            ..Default::default()
        };
        // SAFETY: the handle is valid; the path lives during the call.
        call(|| unsafe { sys::gpurt_scene_commit(self.as_raw(), &desc) })
    }

    /// Counts and facts of the scene: of the description as it is now, but triangles, patches and bounds as of
    /// the last commit. Before the first commit what a commit adds is zero.
    pub fn facts(&self) -> Result<SceneFacts> {
        let mut raw = sys::gpurt_scene_facts::default();
        // SAFETY: the handle is valid; the output lives during the call.
        call(|| unsafe { sys::gpurt_scene_get_facts(self.as_raw(), &mut raw) })?;
        SceneFacts::from_raw(&raw)
    }

    /// Renders an image and waits for it: [`Frame::new`], [`Frame::render`] and [`Frame::image`] in one.
    ///
    /// ```
    /// # fn main() -> gpurt::Result<()> {
    /// use gpurt::{Device, FrameDesc, RenderDesc, Scene};
    ///
    /// let scene = Scene::new(&Device::cpu()?)?;
    /// scene.set_environment([0.5, 0.5, 0.5], None)?;
    /// scene.add_camera(&Default::default())?;
    /// scene.commit()?;
    /// let image = scene.render(&FrameDesc::new(8, 4), &RenderDesc::new().samples(1))?;
    /// assert_eq!((image.width, image.height), (8, 4));
    /// assert_eq!(image.pixels[0], [0.5, 0.5, 0.5, 0.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn render(&self, frame: &FrameDesc, render: &RenderDesc) -> Result<Image> {
        let frame = Frame::new(self, frame)?;
        frame.render(render)?;
        frame.image()
    }

    pub(crate) fn callbacks(&self) -> &Callbacks {
        &self.callbacks
    }
}

fn flatten(t: Transform) -> [f32; 12] {
    let [[a, b, c, d], [e, f, g, h], [i, j, k, l]] = t;
    [a, b, c, d, e, f, g, h, i, j, k, l]
}

filled_struct! {
    /// Counts of a scene, and what its last commit built.
    SceneFacts: gpurt_scene_facts as raw {
        same {
            /// Meshes, sets of patches and subdivision surfaces.
            num_geometries: u32,
            /// Geometries placed in the world.
            num_instances: u32,
            /// Materials.
            num_materials: u32,
            /// Textures.
            num_textures: u32,
            /// Cameras.
            num_cameras: u32,
            /// Point and spot lights.
            num_point_lights: u32,
            /// Distant lights.
            num_distant_lights: u32,
            /// Patches, stored.
            num_patches: u64,
            /// Triangles, stored, tessellated patches included.
            num_triangles: u64,
            /// Triangles seen through all instances.
            num_world_triangles: u64,
            /// Triangles that emit light.
            num_emissive_triangles: u64,
            /// World space; an empty scene has min > max.
            bounds_min: [f32; 3],
            /// World space.
            bounds_max: [f32; 3],
            /// The acceleration structure, its copies of triangles included.
            accel_bytes: u64,
            /// Everything that the commit holds.
            scene_bytes: u64,
            /// Nodes of the acceleration structure.
            num_nodes: u64,
            /// Triangle references in leaves.
            num_references: u64,
            /// Levels of the tree.
            tree_depth: u32,
            /// Of the last commit.
            build_seconds: f64,
            /// Expected cost of a ray by the surface area heuristic.
            sah_cost: f64,
            /// Of `build_seconds`, to build the acceleration structure.
            accel_build_seconds: f64,
            /// Device memory that its build held at a time; 0: it was not built on a CUDA device.
            build_peak_bytes: u64,
            /// No point of a patch of the last commit is further from its triangles, in metres of the world.
            patch_error: f64,
            /// The same in pixels of the picture of [`BuildDesc::patch_pixels`], for what it shows; infinite: none is proven.
            patch_error_pixels: f64,
        }
        converted {
            /// There is light from infinity.
            has_environment: bool = raw.has_environment != 0,
            /// A material is glass.
            has_glass: bool = raw.has_glass != 0,
            /// A material has holes.
            has_alpha_masks: bool = raw.has_alpha_masks != 0,
            /// A material blends.
            has_blending: bool = raw.has_blending != 0,
            /// A commit is in force, which later changes may not be part of.
            is_committed: bool = raw.is_committed != 0,
            /// What the last commit built.
            accel: Accel = Accel::from_raw(raw.accel)?,
            /// What the last commit was made for.
            triangle_test: TriangleTest = TriangleTest::from_raw(raw.triangle_test)?,
            /// A tree was refitted to vertices that have moved.
            tree_refitted: bool = raw.tree_refitted != 0,
            /// The tree was read from the cache file or imported.
            tree_from_cache: bool = raw.tree_from_cache != 0,
        }
    }
}
