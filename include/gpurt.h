/* gpurt: render and query 3D scenes on CPUs and CUDA GPUs.
 *
 * This file is the whole public C ABI. It is C99, needs nothing but the
 * standard integer types, and no build option changes it.
 *
 * Conventions
 *   Handles     opaque values; 0 is no handle. A wrong, stale or foreign handle
 *               gives GPURT_ERROR_INVALID_ARGUMENT, never a crash. `retain` and
 *               `release` count references; a child keeps its parent alive.
 *   Descriptors start with struct_size, which the _INIT macro fills. A zero
 *               field means the default unless its comment says otherwise.
 *               Smaller (older) descriptors are accepted; bytes that this
 *               library does not know must be zero.
 *   Results     every fallible call returns gpurt_result, outputs come last and
 *               are written only on GPURT_OK unless stated otherwise.
 *               gpurt_last_error() tells cause and remedy of the thread's last
 *               failure.
 *   Threads     any function may be called from any thread unless stated
 *               otherwise; calls that change one scene exclude each other.
 *   Units       metres, right handed, Y up; radiance in linear Rec. 709; angles
 *               in radians; times in nanoseconds or, where named so, seconds.
 *   Ids         geometries and instances count from 0 in the order of their
 *               creation; materials and textures count from 1, so that 0 means
 *               none.
 */
#ifndef GPURT_H
#define GPURT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(_WIN32)
#define GPURT_API
#elif defined(__GNUC__)
#define GPURT_API __attribute__((visibility("default")))
#else
#define GPURT_API
#endif

#define GPURT_VERSION_MAJOR 0
#define GPURT_VERSION_MINOR 1
#define GPURT_VERSION_PATCH 0

#define GPURT_INVALID_ID 0xffffffffu /* "none" wherever ids count from 0 */
#define GPURT_WAIT_FOREVER UINT64_MAX

typedef struct gpurt_device_t *gpurt_device;
typedef struct gpurt_scene_t *gpurt_scene;
typedef struct gpurt_frame_t *gpurt_frame;
typedef struct gpurt_job_t *gpurt_job;
typedef struct gpurt_buffer_t *gpurt_buffer;
typedef struct gpurt_photon_map_t *gpurt_photon_map;

typedef enum gpurt_result {
  GPURT_OK = 0,
  GPURT_ERROR_INVALID_ARGUMENT = 1,
  GPURT_ERROR_OUT_OF_MEMORY = 2,
  GPURT_ERROR_UNSUPPORTED = 3,
  GPURT_ERROR_CANCELLED = 4,
  GPURT_ERROR_DEVICE = 5, /* there is none, its driver failed, or a fault ended this process' work on it */
  GPURT_ERROR_TIMEOUT = 6,
  GPURT_ERROR_IO = 7,
  GPURT_ERROR_INTERNAL = 8,
  GPURT_RESULT_FORCE32 = 0x7fffffff
} gpurt_result;

/* ---- Library ---------------------------------------------------------- */

/** The library's version as major << 16 | minor << 8 | patch. */
GPURT_API uint32_t gpurt_version(void);

/** The name of a result, such as "GPURT_ERROR_IO"; "unknown result" for others. Static storage. */
GPURT_API const char *gpurt_result_name(gpurt_result result);

/** Text of the calling thread's last failed call, "" if there was none.
 *
 *  Reading does not clear it. Works before a device exists. The pointer stays
 *  valid until the same thread calls gpurt again.
 */
GPURT_API const char *gpurt_last_error(void);

/* ---- Device ----------------------------------------------------------- */

typedef enum gpurt_device_type {
  GPURT_DEVICE_AUTO = 0, /* the first CUDA device that works, else the CPU */
  GPURT_DEVICE_CPU = 1,
  GPURT_DEVICE_CUDA = 2,
  GPURT_DEVICE_TYPE_FORCE32 = 0x7fffffff
} gpurt_device_type;

typedef enum gpurt_log_level {
  GPURT_LOG_ERROR = 1,
  GPURT_LOG_WARNING = 2,
  GPURT_LOG_INFO = 3,
  GPURT_LOG_LEVEL_FORCE32 = 0x7fffffff
} gpurt_log_level;

/** Receives messages. Called from any thread, never from two at once for one device; must not call gpurt. */
typedef void (*gpurt_log_fn)(void *user, gpurt_log_level level, const char *message);

typedef struct gpurt_device_desc {
  uint32_t struct_size; /* set by GPURT_DEVICE_DESC_INIT */
  gpurt_device_type type;
  uint32_t ordinal;            /* which CUDA device; 0 is the first */
  uint32_t num_threads;        /* CPU worker threads; 0: all that the process may use */
  uint64_t memory_limit_bytes; /* of all scenes, frames and working memory of each device; 0: none */
  gpurt_log_fn log;            /* NULL: errors and warnings are not shown */
  void *log_user;
  const uint32_t
      *ordinals; /* [num_ordinals] different CUDA devices that work as one; NULL: the one in `ordinal` */
  uint32_t num_ordinals;
  uint32_t reserved; /* 0 */
} gpurt_device_desc;
#define GPURT_DEVICE_DESC_INIT {sizeof(gpurt_device_desc), GPURT_DEVICE_AUTO, 0, 0, 0, NULL, NULL, NULL, 0, 0}

typedef struct gpurt_device_properties {
  uint32_t struct_size; /* set by GPURT_DEVICE_PROPERTIES_INIT */
  gpurt_device_type type;
  uint32_t ordinal;
  uint32_t num_threads;        /* CPU: worker threads; CUDA: multiprocessors */
  uint64_t memory_bytes;       /* physical memory of the device */
  uint64_t memory_limit_bytes; /* 0: none */
  uint64_t memory_used_bytes;  /* held now by scenes, frames and jobs of this device object */
  uint64_t memory_peak_bytes;  /* the largest that memory_used_bytes has been */
  uint32_t compute_capability; /* CUDA: 90 for 9.0; CPU: 0 */
  char name[128];
  char instruction_set[32]; /* CPU: the variant in use, such as "x86_64_v3"; CUDA: "sm_90" */
} gpurt_device_properties;
#define GPURT_DEVICE_PROPERTIES_INIT \
  {sizeof(gpurt_device_properties), GPURT_DEVICE_AUTO, 0, 0, 0, 0, 0, 0, 0, {0}, {0}}

/** Lists the devices of this machine: the CPU first, then CUDA devices by ordinal.
 *
 *  @param devices    [capacity] array whose struct_size fields are set, or NULL to count.
 *  @param out_count  Number of devices found, also when it exceeds capacity.
 *
 *  Never fails for want of a driver: without one there are no CUDA devices.
 *  Errors: INVALID_ARGUMENT.
 */
GPURT_API gpurt_result gpurt_device_enumerate(gpurt_device_properties *devices, uint32_t capacity,
                                              uint32_t *out_count);

/** Creates a device object.
 *
 *  @param desc        Options, or NULL for defaults.
 *  @param out_device  Owned by the caller; give it back with gpurt_device_release.
 *
 *  With several ordinals it stands for several CUDA devices: a scene is built on each of them, and they share the
 *  work of every frame, and of queries whose rays are in host memory, as each of them gets on. The image and the hits
 *  have the bits of one device. Rays in device memory are traced by the device that holds them; buffers in device
 *  memory are of the first one. Properties are sums, but for the ordinal, which is the first one's.
 *
 *  Errors: INVALID_ARGUMENT; UNSUPPORTED for a CUDA device that the build or its
 *  age rules out; DEVICE where there is no such device or the driver fails.
 */
GPURT_API gpurt_result gpurt_device_create(const gpurt_device_desc *desc, gpurt_device *out_device);
/** Adds a reference, or takes one away. With the last one the handle is stale; what was made from the device lives on. */
GPURT_API gpurt_result gpurt_device_retain(gpurt_device device);
GPURT_API gpurt_result gpurt_device_release(gpurt_device device);

/** Reads what the device is and how much memory it holds now. */
GPURT_API gpurt_result gpurt_device_get_properties(gpurt_device device,
                                                   gpurt_device_properties *out_properties);

/* ---- Buffer ----------------------------------------------------------- */

typedef enum gpurt_storage {
  GPURT_STORAGE_HOST = 0,   /* host memory */
  GPURT_STORAGE_DEVICE = 1, /* memory of the device; on the CPU device the same as host */
  GPURT_STORAGE_FORCE32 = 0x7fffffff
} gpurt_storage;

/** Gives memory back to the caller once gpurt no longer reads it. Called once, from any thread; must not call gpurt. */
typedef void (*gpurt_release_fn)(void *user, void *data);

typedef struct gpurt_buffer_desc {
  uint32_t struct_size; /* set by GPURT_BUFFER_DESC_INIT */
  gpurt_storage storage;
  uint64_t size_bytes;
  void *data; /* the caller's memory, shared without a copy; NULL: gpurt allocates, filled with zeros */
  gpurt_release_fn
      release; /* for the caller's memory; NULL: the caller keeps it valid until the buffer is gone */
  void *release_user;
} gpurt_buffer_desc;
#define GPURT_BUFFER_DESC_INIT {sizeof(gpurt_buffer_desc), GPURT_STORAGE_HOST, 0, NULL, NULL, NULL}

/** Creates a buffer, or wraps the caller's memory.
 *
 *  The release function is called when the last reader is gone, scenes included; where this call fails, never.
 *  Errors: INVALID_ARGUMENT; OUT_OF_MEMORY.
 */
GPURT_API gpurt_result gpurt_buffer_create(gpurt_device device, const gpurt_buffer_desc *desc,
                                           gpurt_buffer *out_buffer);
GPURT_API gpurt_result gpurt_buffer_retain(gpurt_buffer buffer);
GPURT_API gpurt_result gpurt_buffer_release(gpurt_buffer buffer);

/** Copies host memory into part of a buffer, or part of a buffer into host memory, whatever its storage; done on return.
 *
 *  Work on the device's default stream comes first. Nothing may use the part meanwhile that is written.
 *  Errors: INVALID_ARGUMENT for a part that leaves the buffer; DEVICE.
 */
GPURT_API gpurt_result gpurt_buffer_write(gpurt_buffer buffer, uint64_t offset_bytes, const void *data,
                                          uint64_t size_bytes);
GPURT_API gpurt_result gpurt_buffer_read(gpurt_buffer buffer, uint64_t offset_bytes, void *data,
                                         uint64_t size_bytes);

/** The address (host or device, by its storage) and size of a buffer; valid while the buffer lives. */
GPURT_API gpurt_result gpurt_buffer_get_data(gpurt_buffer buffer, void **out_data, uint64_t *out_size_bytes);

/** An array for gpurt to read: host memory that is copied during the call, or part of a shared buffer, whose contents
 *  must not change while the scene needs it. All zero: no array. */
typedef struct gpurt_array {
  const void *data;      /* host memory, or NULL */
  gpurt_buffer buffer;   /* or a buffer of the scene's device; retained while the scene needs it */
  uint64_t offset_bytes; /* into data or buffer */
  uint64_t stride_bytes; /* between elements; 0: tightly packed */
  uint64_t count;        /* elements; nothing past the last one is read */
} gpurt_array;

/* ---- Scene description ------------------------------------------------- */

/** Creates an empty scene. It keeps the device alive. */
GPURT_API gpurt_result gpurt_scene_create(gpurt_device device, gpurt_scene *out_scene);

/** Loads a scene from a glTF 2.0 file (.glb or .gltf) and leaves it ready to commit.
 *
 *  Reads meshes (every accessor form, strips and fans), node hierarchies with instancing kept, materials,
 *  textures, alpha masks, KHR_lights_punctual, cameras, the environment of the scene's `extras` and
 *  GPURT_bezier_patches. What has no exact counterpart here is named in a warning through the device's log.
 *
 *  Errors: IO with one line that names the file and its defect; OUT_OF_MEMORY.
 */
GPURT_API gpurt_result gpurt_scene_load(gpurt_device device, const char *path, gpurt_scene *out_scene);
GPURT_API gpurt_result gpurt_scene_retain(gpurt_scene scene);
GPURT_API gpurt_result gpurt_scene_release(gpurt_scene scene);

typedef enum gpurt_texture_format {
  GPURT_TEXTURE_RGBA8_SRGB =
      0, /* uint8 [h][w][4]; colours decoded from sRGB before filtering, alpha linear */
  GPURT_TEXTURE_RGBA8_LINEAR = 1, /* uint8 [h][w][4] / 255 */
  GPURT_TEXTURE_RGBA32F = 2,      /* float32 [h][w][4] */
  GPURT_TEXTURE_FORMAT_FORCE32 = 0x7fffffff
} gpurt_texture_format;

typedef enum gpurt_wrap {
  GPURT_WRAP_REPEAT = 0,
  GPURT_WRAP_CLAMP = 1,
  GPURT_WRAP_MIRROR = 2,
  GPURT_WRAP_FORCE32 = 0x7fffffff
} gpurt_wrap;

typedef enum gpurt_filter {
  GPURT_FILTER_LINEAR = 0, /* bilinear, texel centres at (i + 0.5) / size */
  GPURT_FILTER_NEAREST = 1,
  GPURT_FILTER_FORCE32 = 0x7fffffff
} gpurt_filter;

typedef struct gpurt_texture_desc {
  uint32_t struct_size; /* set by GPURT_TEXTURE_DESC_INIT */
  gpurt_texture_format format;
  uint32_t width;
  uint32_t height;
  gpurt_wrap wrap_u;
  gpurt_wrap wrap_v;
  gpurt_filter filter;
  uint32_t reserved;  /* 0 */
  const void *texels; /* row 0 is the top row and lies at v = 0, as in glTF; copied */
} gpurt_texture_desc;
#define GPURT_TEXTURE_DESC_INIT \
  {sizeof(gpurt_texture_desc), GPURT_TEXTURE_RGBA8_SRGB, 0, 0,   GPURT_WRAP_REPEAT, \
   GPURT_WRAP_REPEAT,          GPURT_FILTER_LINEAR,      0, NULL}

/** Adds a texture; its id counts from 1. Errors: INVALID_ARGUMENT, also for texels that are not finite. */
GPURT_API gpurt_result gpurt_scene_add_texture(gpurt_scene scene, const gpurt_texture_desc *desc,
                                               uint32_t *out_texture);

typedef enum gpurt_material_type {
  GPURT_MATERIAL_LAMBERT = 0, /* base colour / pi, on both sides */
  GPURT_MATERIAL_MIRROR = 1,  /* perfect mirror, reflectance is the base colour */
  GPURT_MATERIAL_GLASS =
      2, /* smooth dielectric, exact Fresnel; closed solids; base colour tints transmission */
  GPURT_MATERIAL_METAL =
      3, /* GGX, alpha = roughness^2, separable Smith, Schlick Fresnel with F0 = base colour */
  GPURT_MATERIAL_TYPE_FORCE32 = 0x7fffffff
} gpurt_material_type;

typedef struct gpurt_material_desc {
  uint32_t struct_size; /* set by GPURT_MATERIAL_DESC_INIT, which also sets a white Lambertian surface */
  gpurt_material_type type;
  float base_color[3];         /* linear, in [0, 1]; zero is black */
  float roughness;             /* METAL: in (0, 1] */
  float ior;                   /* GLASS: index of refraction; 0: 1.5 */
  float alpha;                 /* multiplies the texture's alpha; used with alpha_cutoff or blends alone */
  float alpha_cutoff;          /* > 0: parts whose alpha is below it are holes; 0: none */
  float emission[3];           /* radiance, W/(m^2 sr) up to the lights' scale; zero: not a lamp */
  uint32_t base_color_texture; /* multiplies base_color; 0: none */
  uint32_t two_sided_emission; /* 0: emits from the counter-clockwise side alone; 1: from both */
  uint32_t blends; /* 1: alpha is opacity: of light, 1 - alpha passes straight on; wants alpha_cutoff 0 */
  uint32_t
      emission_texture; /* multiplies emission, at the texture coordinates of base_color_texture; its alpha
                                  does not count; 0: none */
  float attenuation_color[3]; /* GLASS: the share of light that is left after attenuation_distance within it,
                                  linear, in [0, 1] */
  float
      attenuation_distance; /* GLASS: metres of the world, whatever instances scale; 0: glass does not absorb */
} gpurt_material_desc;
#define GPURT_MATERIAL_DESC_INIT \
  {sizeof(gpurt_material_desc), \
   GPURT_MATERIAL_LAMBERT, \
   {1, 1, 1}, \
   1, \
   0, \
   1, \
   0, \
   {0, 0, 0}, \
   0, \
   0, \
   0, \
   0, \
   {1, 1, 1}, \
   0}

/* Glass absorbs by Beer and Lambert's law: of light that goes a distance d within it, attenuation_color to the power of
   d / attenuation_distance is left, colour by colour. A ray is within glass from where it goes in to where it comes out,
   also where it meets other surfaces between. Solids stand in air and do not overlap; cameras and lights stand in air, of
   which a ray that starts within glass learns no earlier than where it comes out: such a ray's way to an opaque surface
   within the same glass does not absorb. */

/* A ray meets a surface of a material that blends with the probability of its opacity there, and passes it otherwise:
   in every query and every pipeline but REYES, which blends all surfaces that a sample sees. What happens is a function of
   the ray's origin and direction and of the triangle, on every device the same. */

/** Adds a material; its id counts from 1. Errors: INVALID_ARGUMENT. */
GPURT_API gpurt_result gpurt_scene_add_material(gpurt_scene scene, const gpurt_material_desc *desc,
                                                uint32_t *out_material);

typedef struct gpurt_mesh_desc {
  uint32_t struct_size; /* set by GPURT_MESH_DESC_INIT */
  uint32_t material;    /* 0: white Lambertian */
  gpurt_array vertices; /* float32 [n][3], metres, object space */
  gpurt_array indices;  /* uint32 [m][3], each < n; no array: vertices form triangles three by three */
  gpurt_array normals;  /* float32 [n][3], of any length; zero: that of the faces around; no array: flat */
  gpurt_array uvs;      /* float32 [n][2]; no array: (0, 0) */
} gpurt_mesh_desc;
#define GPURT_MESH_DESC_INIT \
  {sizeof(gpurt_mesh_desc), 0, {NULL, NULL, 0, 0, 0}, {NULL, NULL, 0, 0, 0}, {NULL, NULL, 0, 0, 0}, \
   {NULL, NULL, 0, 0, 0}}

/** Adds a triangle mesh. It is seen where instances place it.
 *
 *  Degenerate triangles are legal and never hit. The counter-clockwise side is the front.
 *  Errors: INVALID_ARGUMENT naming the first index out of range or vertex that is not finite.
 */
GPURT_API gpurt_result gpurt_scene_add_mesh(gpurt_scene scene, const gpurt_mesh_desc *desc,
                                            uint32_t *out_geometry);

typedef struct gpurt_patches_desc {
  uint32_t struct_size; /* set by GPURT_PATCHES_DESC_INIT */
  uint32_t material;
  gpurt_array control_points; /* float32 [16 n][3]: bicubic Bezier, point 4*row + column, u along columns */
} gpurt_patches_desc;
#define GPURT_PATCHES_DESC_INIT {sizeof(gpurt_patches_desc), 0, {NULL, NULL, 0, 0, 0}}

/** Moves the vertices of a mesh: the next commit sees them.
 *
 *  @param vertices  As in gpurt_mesh_desc, as many as there are.
 *  @param normals   NULL, where the mesh has none; else as many.
 *
 *  A FAST commit with accel BVH on a CUDA device refits its tree in place of building it, where the last commit built one of
 *  the same triangles, none of them is degenerate, and the tree has not become much slower by it; hits are those of a new
 *  tree. Others build anew. Imported kd-trees are dropped.
 *  Errors: INVALID_ARGUMENT for a geometry that is no mesh, other numbers, or numbers that are not finite; the scene is
 *  then as it was.
 */
GPURT_API gpurt_result gpurt_scene_set_vertices(gpurt_scene scene, uint32_t geometry,
                                                const gpurt_array *vertices, const gpurt_array *normals);

/** Adds bicubic Bezier patches. For rays they are tessellated at commit, to gpurt_build_desc.patch_tolerance or
 *  patch_pixels.
 *
 *  Each patch becomes cells of two triangles, as many as it needs; neighbours that share boundary points, in this geometry
 *  or in another one, leave no cracks. The primitive of a hit is one of these triangles, which go patch by patch;
 *  gpurt_scene_locate tells the patch and the place on it.
 *  Errors: INVALID_ARGUMENT naming the first control point that is not finite; at commit, for a tolerance that takes
 *  more than 2^28 triangles.
 */
GPURT_API gpurt_result gpurt_scene_add_patches(gpurt_scene scene, const gpurt_patches_desc *desc,
                                               uint32_t *out_geometry);

typedef enum gpurt_subdivision_scheme {
  GPURT_SUBDIVISION_CATMULL_CLARK = 0,
  GPURT_SUBDIVISION_LOOP = 1,
  GPURT_SUBDIVISION_SCHEME_FORCE32 = 0x7fffffff
} gpurt_subdivision_scheme;

typedef struct gpurt_subdivision_desc {
  uint32_t struct_size; /* set by GPURT_SUBDIVISION_DESC_INIT */
  uint32_t material;
  gpurt_subdivision_scheme scheme;
  uint32_t reserved;       /* 0 */
  gpurt_array vertices;    /* float32 [n][3] */
  gpurt_array face_counts; /* uint32 [f]: corners of each face */
  gpurt_array indices;     /* uint32 [sum of face_counts] */
} gpurt_subdivision_desc;
#define GPURT_SUBDIVISION_DESC_INIT \
  {sizeof(gpurt_subdivision_desc), \
   0, \
   GPURT_SUBDIVISION_CATMULL_CLARK, \
   0, \
   {NULL, NULL, 0, 0, 0}, \
   {NULL, NULL, 0, 0, 0}, \
   {NULL, NULL, 0, 0, 0}}

/** Adds a subdivision surface. This version returns GPURT_ERROR_UNSUPPORTED. */
GPURT_API gpurt_result gpurt_scene_add_subdivision(gpurt_scene scene, const gpurt_subdivision_desc *desc,
                                                   uint32_t *out_geometry);

typedef struct gpurt_instance_desc {
  uint32_t struct_size; /* set by GPURT_INSTANCE_DESC_INIT, which also sets the identity */
  uint32_t geometry;
  float transform[12]; /* object to world, 3 rows of 4; must be invertible */
} gpurt_instance_desc;
#define GPURT_INSTANCE_DESC_INIT {sizeof(gpurt_instance_desc), 0, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}}

/** Places a geometry in the world. A geometry placed once is stored in world space; one placed more often is
 *  stored once and shared. Errors: INVALID_ARGUMENT. */
GPURT_API gpurt_result gpurt_scene_add_instance(gpurt_scene scene, const gpurt_instance_desc *desc,
                                                uint32_t *out_instance);

typedef enum gpurt_light_type {
  GPURT_LIGHT_POINT = 0,
  GPURT_LIGHT_SPOT = 1,
  GPURT_LIGHT_DISTANT = 2,
  GPURT_LIGHT_TYPE_FORCE32 = 0x7fffffff
} gpurt_light_type;

typedef struct gpurt_light_desc {
  uint32_t struct_size; /* set by GPURT_LIGHT_DESC_INIT */
  gpurt_light_type type;
  float intensity[3];         /* POINT, SPOT: W/sr; DISTANT: irradiance on a facing surface, W/m^2 */
  float position[3];          /* POINT, SPOT */
  float direction[3];         /* SPOT, DISTANT: where the light shines; need not be unit length */
  float inner_cone_angle_rad; /* SPOT: full intensity within; 0 is the axis alone */
  float outer_cone_angle_rad; /* SPOT: none beyond; in (inner, pi/2]; falloff as glTF defines it; 0: pi/4 */
} gpurt_light_desc;
#define GPURT_LIGHT_DESC_INIT \
  {sizeof(gpurt_light_desc), GPURT_LIGHT_POINT, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}, 0, 0}

/** Adds a light without extent; ids count from 0. Lamps with extent are materials that emit. Errors: INVALID_ARGUMENT. */
GPURT_API gpurt_result gpurt_scene_add_light(gpurt_scene scene, const gpurt_light_desc *desc,
                                             uint32_t *out_light);

typedef struct gpurt_environment_desc {
  uint32_t struct_size; /* set by GPURT_ENVIRONMENT_DESC_INIT */
  uint32_t texture;     /* lat-long radiance image; 0: constant */
  float radiance[3];    /* constant radiance, or the factor of the texture; zero: black */
} gpurt_environment_desc;
#define GPURT_ENVIRONMENT_DESC_INIT {sizeof(gpurt_environment_desc), 0, {0, 0, 0}}

/** Sets the radiance that comes from infinity.
 *
 *  World direction (x, y, z) of unit length is looked up at u = atan2(x, -z) / (2 pi) mod 1, v = acos(y) / pi;
 *  u wraps, v is clamped, filtered bilinearly. Errors: INVALID_ARGUMENT.
 */
GPURT_API gpurt_result gpurt_scene_set_environment(gpurt_scene scene, const gpurt_environment_desc *desc);

typedef enum gpurt_camera_type {
  GPURT_CAMERA_PERSPECTIVE = 0,
  GPURT_CAMERA_ORTHOGRAPHIC = 1, /* this version: UNSUPPORTED */
  GPURT_CAMERA_TYPE_FORCE32 = 0x7fffffff
} gpurt_camera_type;

typedef struct gpurt_camera_desc {
  uint32_t struct_size; /* set by GPURT_CAMERA_DESC_INIT */
  gpurt_camera_type type;
  float transform[12];  /* camera to world, 3 rows of 4; looks along its -Z, +Y is up; scale is ignored */
  float yfov_rad;       /* full vertical angle; 0: 45 degrees */
  float lens_radius;    /* this version: must be 0 (pinhole) */
  float focus_distance; /* this version: must be 0 */
  float shutter_open;   /* this version: must be 0 */
  float shutter_close;  /* this version: must be 0 */
  uint32_t width;       /* the image size that the scene's author meant; 0: not said */
  uint32_t height;
} gpurt_camera_desc;
#define GPURT_CAMERA_DESC_INIT \
  {sizeof(gpurt_camera_desc), \
   GPURT_CAMERA_PERSPECTIVE, \
   {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0}

/** Adds a camera; ids count from 0. Errors: INVALID_ARGUMENT; UNSUPPORTED. */
GPURT_API gpurt_result gpurt_scene_add_camera(gpurt_scene scene, const gpurt_camera_desc *desc,
                                              uint32_t *out_camera);

/** Reads a camera back. Errors: INVALID_ARGUMENT if there is no such camera. */
GPURT_API gpurt_result gpurt_scene_get_camera(gpurt_scene scene, uint32_t camera,
                                              gpurt_camera_desc *out_desc);

/* ---- Commit ------------------------------------------------------------ */

typedef enum gpurt_accel {
  GPURT_ACCEL_AUTO =
      0, /* CUDA: bvh, or kdtree where a probe of both expects it to be faster, as statistics say; CPU: embree;
            either: kdtree where an imported tree or a setting of the kdtree is there */
  GPURT_ACCEL_KDTREE = 1, /* the same bits on every backend */
  GPURT_ACCEL_EMBREE = 2, /* CPU alone; not the same bits; rare leaks at vertices: docs/stability.md */
  GPURT_ACCEL_BVH = 3,    /* 2-wide, spatial splits; the same bits on every backend */
  GPURT_ACCEL_FORCE32 = 0x7fffffff
} gpurt_accel;

typedef enum gpurt_triangle_test {
  GPURT_TRIANGLE_WATERTIGHT = 0,      /* Woop, Benthin and Wald 2013; Embree: its robust mode */
  GPURT_TRIANGLE_MOLLER_TRUMBORE = 1, /* leaks at edges; Embree: its fast mode */
  GPURT_TRIANGLE_DOUBLE = 2,          /* the watertight test in double precision; not embree */
  GPURT_TRIANGLE_TEST_FORCE32 = 0x7fffffff
} gpurt_triangle_test;

typedef enum gpurt_build_quality {
  GPURT_BUILD_QUALITY_AUTO = 0, /* HIGH */
  GPURT_BUILD_QUALITY_FAST = 1, /* CUDA, bvh and kdtree: large trees are built on the device, in milliseconds
                                   (kdtree: tens of them) a million triangles, and trace within a few percent of
                                   the best. Hits are those of HIGH,
                                   bit for bit, but by MOLLER_TRUMBORE, by which a ray that grazes triangles may
                                   meet another one of them. Elsewhere as HIGH */
  /* The tree that traces fastest, built on the host's threads. Hits have the same bits on every device. */
  GPURT_BUILD_QUALITY_HIGH = 2,
  GPURT_BUILD_QUALITY_FORCE32 = 0x7fffffff
} gpurt_build_quality;

typedef struct gpurt_build_desc {
  uint32_t struct_size; /* set by GPURT_BUILD_DESC_INIT */
  gpurt_accel accel;
  gpurt_triangle_test triangle_test;
  uint32_t max_depth; /* kdtree; 0: 8 + 1.3 log2 N; at most 48 */
  /* kdtree: cost of a step in units of a triangle test. 0: the library's choice, 2, or 1 for trees of CUDA devices but with
   * MOLLER_TRUMBORE or a cache. */
  float traversal_cost;
  float empty_bonus;     /* kdtree: factor on the cost of splits that cut off empty space; 0: the library's */
  float patch_tolerance; /* largest distance, in metres of the world, between a patch and its triangles;
                                  0: 1e-4 of the diagonal of the patches' bounds, or none with patch_pixels */
  gpurt_build_quality quality;
  const char *
      tree_cache_path; /* kdtree: reuse the tree of this file if it fits the scene, else build and write it */
  /* > 0: largest distance between a patch and its triangles in pixels of a picture: patches have fewer triangles the
   * further away they are. It holds for what the picture shows directly, wherever the patch is placed; what is seen in
   * mirrors or casts shadows has the triangles that its depth asks for. With patch_tolerance too, the smaller one holds. */
  float patch_pixels;
  uint32_t patch_camera; /* with patch_pixels: whose picture it is */
  uint32_t patch_width;  /* with patch_pixels: of the picture; 0: what the camera says, else 512 */
  uint32_t patch_height;
} gpurt_build_desc;
#define GPURT_BUILD_DESC_INIT \
  {sizeof(gpurt_build_desc), \
   GPURT_ACCEL_AUTO, \
   GPURT_TRIANGLE_WATERTIGHT, \
   0, \
   0, \
   0, \
   0, \
   GPURT_BUILD_QUALITY_AUTO, \
   NULL, \
   0, \
   0, \
   0, \
   0}

/** Builds the acceleration structure of a scene; queries and renders that start later see it.
 *
 *  @param desc  Build options, or NULL for defaults.
 *
 *  A failed commit leaves the previous one in force. Work in flight keeps the commit it started with.
 *  An empty scene is legal: every ray misses.
 *  Errors: INVALID_ARGUMENT; OUT_OF_MEMORY; UNSUPPORTED; IO for a cache file that cannot be written.
 *  Source: SAH kd-tree with perfect splits after Wald and Havran 2006; bvh with spatial splits after Stich et al. 2009.
 */
GPURT_API gpurt_result gpurt_scene_commit(gpurt_scene scene, const gpurt_build_desc *desc);

typedef struct gpurt_scene_facts {
  uint32_t struct_size; /* set by GPURT_SCENE_FACTS_INIT */
  uint32_t num_geometries;
  uint32_t num_instances;
  uint32_t num_materials;
  uint32_t num_textures;
  uint32_t num_cameras;
  uint32_t num_point_lights; /* point and spot */
  uint32_t num_distant_lights;
  uint64_t num_patches;         /* stored */
  uint64_t num_triangles;       /* stored, tessellated patches included */
  uint64_t num_world_triangles; /* seen through all instances */
  uint64_t num_emissive_triangles;
  float bounds_min[3]; /* world; an empty scene has min > max */
  float bounds_max[3];
  uint32_t has_environment;
  uint32_t has_glass;
  uint32_t has_alpha_masks;
  uint32_t is_committed; /* 1: a commit is in force, which later changes may not be part of */
  /* what the last commit built; zero before it */
  gpurt_accel accel;
  gpurt_triangle_test triangle_test;
  uint64_t accel_bytes; /* acceleration structure, its copies of triangles included */
  uint64_t scene_bytes; /* everything that the commit holds */
  uint64_t num_nodes;
  uint64_t num_references; /* triangle references in leaves */
  uint32_t tree_depth;
  uint32_t tree_from_cache; /* 1: read from the cache file or imported */
  double build_seconds;     /* of the whole commit */
  double sah_cost;
  double accel_build_seconds; /* of these, to build the acceleration structure */
  uint64_t build_peak_bytes;  /* device memory that its build held at a time, the structure included;
                                 0: it was not built on a CUDA device */
  uint32_t tree_refitted;     /* 1: a tree was refitted to vertices that have moved */
  uint32_t has_blending;      /* 1: a material blends */
  double patch_error;         /* no point of a patch of the last commit is further from its triangles, in
                                 metres of the world: proven, rounding to float left out */
  /* The same in pixels of the picture of patch_pixels, for what the picture shows: at most patch_pixels, but infinite where
   * the camera is so near to a patch's control points that no bound is proven; 0: patch_pixels was 0. */
  double patch_error_pixels;
} gpurt_scene_facts;
#define GPURT_SCENE_FACTS_INIT \
  {sizeof(gpurt_scene_facts), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, {0}, {0}, 0, 0, 0, 0, GPURT_ACCEL_AUTO, \
   GPURT_TRIANGLE_WATERTIGHT, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,   0,   0}

/** Reads counts and facts of a scene: of the description as it is now, but triangles, patches and bounds as of the
 *  last commit. Before the first commit what a commit adds is zero. */
GPURT_API gpurt_result gpurt_scene_get_facts(gpurt_scene scene, gpurt_scene_facts *out_facts);

/* ---- Tree exchange ------------------------------------------------------ */

/** A kd-tree node. Inner: word is the bits of the float plane; tag = child << 2 | axis, children at child and
 *  child + 1, below and above the plane. Leaf: word is the first reference; tag = count << 2 | 3. */
typedef struct gpurt_kdtree_node {
  uint32_t word;
  uint32_t tag;
} gpurt_kdtree_node;

typedef struct gpurt_kdtree {
  uint32_t struct_size; /* set by GPURT_KDTREE_INIT */
  uint32_t tree;      /* 0: all geometries placed once, in world space; 1 + g: geometry g, in object space */
  uint64_t num_nodes; /* node 0 is the root; a child's index exceeds its parent's */
  uint64_t num_references;
  uint64_t num_triangles; /* of this tree; tree 0 orders them by instance, then primitive */
  float bounds_min[3];
  float bounds_max[3];
  gpurt_kdtree_node *nodes; /* [num_nodes] */
  uint32_t *references;     /* [num_references], triangles of leaves */
} gpurt_kdtree;
#define GPURT_KDTREE_INIT {sizeof(gpurt_kdtree), 0, 0, 0, 0, {0, 0, 0}, {0, 0, 0}, NULL, NULL}

/** Copies a kd-tree of the last commit out.
 *
 *  With nodes and references NULL only sizes and bounds are written. Otherwise num_nodes and num_references tell
 *  the capacity of the arrays and become the sizes.
 *  Errors: INVALID_ARGUMENT where there is no such tree or an array is too small.
 */
GPURT_API gpurt_result gpurt_scene_export_tree(gpurt_scene scene, gpurt_kdtree *tree);

/** Hands in a kd-tree that the next commits use in place of building one, until the geometry changes.
 *
 *  The tree is copied. Its triangles are those of gpurt_scene_export_tree's order; every triangle must be in the
 *  leaves that it touches, else hits are lost: that alone is the caller's duty and cannot be checked here.
 *  Errors: INVALID_ARGUMENT for a depth over 48, a plane outside its cell, a child or reference out of range, a
 *  node reached twice.
 */
GPURT_API gpurt_result gpurt_scene_import_tree(gpurt_scene scene, const gpurt_kdtree *tree);

/* ---- Schedules ---------------------------------------------------------- */

/* How a CUDA device goes about its work. 0 everywhere: the library's choice, which is what measures best. Every schedule
 * gives the same hits and images, bit for bit. docs/schedules.md says what each does and what it measures.
 * GPURT_PIPELINE_REYES: `launch` is how patches are cut, `traversal` how grids are diced, shaded and sampled. */

typedef enum gpurt_traversal {
  GPURT_TRAVERSAL_AUTO = 0,
  GPURT_TRAVERSAL_STACK = 1, /* one kernel: descend to a leaf, test its triangles, resume from the stack */
  GPURT_TRAVERSAL_LEAF_LISTS =
      2, /* kdtree: one kernel selects up to eight leaves of each ray, another tests them; in turn */
  GPURT_TRAVERSAL_UBER =
      3, /* one kernel whose warps switch by vote: queries (kdtree) between leaves and triangles, renders
            between the stages of whole paths. REYES with micropolygons' or blocks' own light: STACK is one kernel in
            which a warp takes a grid through all stages; LEAF_LISTS a kernel each for dicing, shading and sampling,
            with memory between them; UBER one kernel whose blocks turn to the stage whose queue is full */
  GPURT_TRAVERSAL_FORCE32 = 0x7fffffff
} gpurt_traversal;

typedef enum gpurt_launch {
  GPURT_LAUNCH_AUTO = 0,
  GPURT_LAUNCH_REGULAR =
      1, /* a thread for every ray. REYES: a launch for each level of cutting, whose count the
                               host reads */
  GPURT_LAUNCH_PERSISTENT =
      2, /* as many threads as the device holds, which draw rays from a pool. REYES: pieces from queues, each
            block's own first; what a block has too much of it donates */
  GPURT_LAUNCH_ROUNDS =
      3, /* REYES alone: one launch whose threads wait for each other after every round of cutting */
  GPURT_LAUNCH_FORCE32 = 0x7fffffff
} gpurt_launch;

typedef enum gpurt_fetch {
  GPURT_FETCH_AUTO = 0,
  GPURT_FETCH_PER_THREAD = 1, /* every thread loads the triangles that it tests */
  GPURT_FETCH_PACKETS = 2, /* kdtree: a warp's rays traverse together and share triangles in shared memory */
  GPURT_FETCH_FORCE32 = 0x7fffffff
} gpurt_fetch;

/* How the rays that are there are moved together, and pieces that REYES cuts with LAUNCH_REGULAR. Renders alone. */
typedef enum gpurt_compaction {
  GPURT_COMPACTION_AUTO = 0,
  GPURT_COMPACTION_BLOCK_SCAN = 1, /* counts of blocks of rays, and a scan over these */
  GPURT_COMPACTION_PYRAMID = 2,    /* histogram pyramid */
  GPURT_COMPACTION_NAIVE_SCAN = 3, /* the scan of n log n additions */
  GPURT_COMPACTION_LIBRARY_SCAN = 4,
  GPURT_COMPACTION_FORCE32 = 0x7fffffff
} gpurt_compaction;

/* In which order hits are shaded. Renders alone. */
typedef enum gpurt_shading {
  GPURT_SHADING_AUTO = 0,
  GPURT_SHADING_IMMEDIATE = 1, /* as the rays lie */
  GPURT_SHADING_SORTED = 2,    /* deferred until the hits are sorted by material */
  GPURT_SHADING_FORCE32 = 0x7fffffff
} gpurt_shading;

/* How shading makes rays. Renders alone. */
typedef enum gpurt_generation {
  GPURT_GENERATION_AUTO = 0,
  GPURT_GENERATION_SLOTS = 1, /* each hit has a slot for every ray it may make; empty ones are removed */
  GPURT_GENERATION_COUNTED =
      2, /* rays are counted first, the count is checked against ray_budget, then exactly these are made */
  GPURT_GENERATION_REFILLED =
      3, /* hits write the rays that there are, and new paths start where others have ended */
  GPURT_GENERATION_FORCE32 = 0x7fffffff
} gpurt_generation;

typedef struct gpurt_schedule {
  gpurt_traversal traversal;
  gpurt_launch launch;
  gpurt_fetch fetch;
  gpurt_compaction compaction;
  gpurt_shading shading;
  gpurt_generation generation;
  uint32_t reserved[2]; /* 0 */
  uint64_t ray_budget;  /* COUNTED: rays that may be made at once; a wave that wants more splits; 0: what its
                           memory holds; else at least 2 */
} gpurt_schedule;
#define GPURT_SCHEDULE_INIT \
  {GPURT_TRAVERSAL_AUTO, GPURT_LAUNCH_AUTO,     GPURT_FETCH_AUTO, GPURT_COMPACTION_AUTO, \
   GPURT_SHADING_AUTO,   GPURT_GENERATION_AUTO, {0, 0},           0}

/** What schedules did. */
typedef struct gpurt_schedule_counters {
  uint64_t ray_refills;      /* PERSISTENT: times that a warp drew rays from the pool */
  uint64_t list_rounds;      /* LEAF_LISTS: times that both kernels ran */
  uint64_t list_overflows;   /* LEAF_LISTS and UBER: lists that were full with leaves left to select */
  uint64_t mode_switches;    /* UBER: times that a warp turned to other work */
  uint64_t packets;          /* PACKETS: warps of rays that traversed together */
  uint64_t shared_triangles; /* PACKETS: triangles that a packet loaded once for all of its rays */
  uint64_t compactions;      /* any but BLOCK_SCAN of rays: queues that were compacted */
  uint64_t sorted_hits;      /* SORTED: hits that were sorted by material */
  uint64_t counted_rays;     /* COUNTED: rays that were counted, and then made */
  uint64_t wave_splits;      /* COUNTED: times that a count was over the budget, so that a wave split */
  uint64_t device_ns;        /* queries: time on the device, without copies */
  uint64_t path_refills;     /* REFILLED: paths that started in the place of ones that had ended */
  uint64_t warp_steps;       /* count_lanes: steps of traversal, at nodes and triangles, as warps took them */
  uint64_t lane_steps;       /* the same as lanes took them: of 32 warp_steps, the share of lanes that work */
  uint64_t reserved[2];      /* 0 */
} gpurt_schedule_counters;
#define GPURT_SCHEDULE_COUNTERS_INIT {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, {0, 0}}

/* ---- Ray queries -------------------------------------------------------- */

typedef struct gpurt_ray {
  float origin[3];
  float tmin;         /* hits with t < tmin do not count */
  float direction[3]; /* need not be unit length; t is in its units. Zero or not finite: the ray misses */
  float tmax;         /* hits with t > tmax do not count; may be infinite */
} gpurt_ray;

typedef struct gpurt_hit {
  float t;            /* of a miss: the ray's tmax */
  float u, v;         /* barycentric weights of the second and third corner */
  uint32_t primitive; /* triangle of the geometry; GPURT_INVALID_ID: a miss */
  uint32_t geometry;
  uint32_t instance;
  uint32_t padding[2];
} gpurt_hit;

typedef struct gpurt_hit_compact {
  float t;
  float u, v;
  uint32_t primitive;
} gpurt_hit_compact;

typedef enum gpurt_query {
  GPURT_QUERY_CLOSEST = 0, /* one hit a ray; equal t: the smaller (instance, primitive) */
  GPURT_QUERY_ANY = 1,     /* one byte a ray: 1 where something is hit */
  GPURT_QUERY_ALL = 2,     /* every crossing, sorted by (t, instance, primitive) */
  GPURT_QUERY_FORCE32 = 0x7fffffff
} gpurt_query;

typedef enum gpurt_hit_format {
  GPURT_HIT_FULL = 0,    /* gpurt_hit, 32 bytes */
  GPURT_HIT_COMPACT = 1, /* gpurt_hit_compact, 16 bytes */
  GPURT_HIT_FORMAT_FORCE32 = 0x7fffffff
} gpurt_hit_format;

/* How rays that follow one another in a batch go. Changes the speed on CUDA devices alone, never a result. */
typedef enum gpurt_coherence {
  GPURT_COHERENCE_AUTO = 0,       /* by the tree's size or a look at a few rays */
  GPURT_COHERENCE_COHERENT = 1,   /* nearly the same way, as those of a camera's neighbouring pixels */
  GPURT_COHERENCE_INCOHERENT = 2, /* apart, as those that surfaces scatter */
  GPURT_COHERENCE_FORCE32 = 0x7fffffff
} gpurt_coherence;

typedef struct gpurt_trace_desc {
  uint32_t struct_size; /* set by GPURT_TRACE_DESC_INIT */
  gpurt_query query;
  gpurt_hit_format format;
  gpurt_storage storage; /* where rays, hits, occluded and offsets lie */
  uint64_t num_rays;
  const gpurt_ray *rays; /* [num_rays] */
  void *hits; /* CLOSEST: [num_rays]; ALL: [hit_capacity] or NULL to count; ANY: NULL. Not the rays' memory */
  uint8_t *occluded;     /* ANY: [num_rays]; else NULL */
  uint64_t *offsets;     /* ALL: [num_rays + 1]; ray i has hits offsets[i] .. offsets[i + 1]; else NULL */
  uint64_t hit_capacity; /* ALL: elements that hits has room for */
  gpurt_schedule schedule;
  gpurt_schedule_counters
      *out_counters; /* host memory, written where the call succeeds; NULL: not wanted. Chunks of
                                            rays in host memory then go one after another */
  gpurt_coherence coherence;
  uint32_t image_width; /* rays are an image's, row by row, of this many: coherent ones go by tiles; 0: not */
  /* 1: CLOSEST of CUDA devices also counts the lanes of warps that work, into out_counters, by kernels of their own: slower,
   * with the same hits; 0: not. */
  uint32_t count_lanes;
  uint32_t reserved; /* 0 */
} gpurt_trace_desc;
#define GPURT_TRACE_DESC_INIT \
  {sizeof(gpurt_trace_desc), \
   GPURT_QUERY_CLOSEST, \
   GPURT_HIT_FULL, \
   GPURT_STORAGE_HOST, \
   0, \
   NULL, \
   NULL, \
   NULL, \
   NULL, \
   0, \
   GPURT_SCHEDULE_INIT, \
   NULL, \
   GPURT_COHERENCE_AUTO, \
   0, \
   0, \
   0}

/** Traces a batch of rays on all threads of the device and returns when it is done.
 *
 *  Alpha masks are holes. Rays with a zero or non-finite direction, a non-finite origin or tmin > tmax miss.
 *  Errors: INVALID_ARGUMENT, also for ALL where hits is too small (offsets are written: offsets[num_rays] is the
 *  capacity needed) and for a scene that was never committed; OUT_OF_MEMORY; DEVICE; UNSUPPORTED, also for a schedule
 *  that the device, the accelerator or the query does not have, and for count_lanes where it does not exist.
 */
GPURT_API gpurt_result gpurt_scene_trace(gpurt_scene scene, const gpurt_trace_desc *desc);

/* ---- Hits on patches ------------------------------------------------------ */

/* Where a hit lies on its patch. */
typedef struct gpurt_patch_point {
  uint32_t patch; /* of its geometry, in the order of the control points; GPURT_INVALID_ID: a miss */
  float u, v;     /* in [0, 1], u along columns of control points, v along rows; of a miss 0 */
} gpurt_patch_point;

typedef struct gpurt_locate_desc {
  uint32_t struct_size; /* set by GPURT_LOCATE_DESC_INIT */
  gpurt_hit_format format;
  uint64_t num_hits;
  const void *hits;          /* [num_hits], in host memory, as gpurt_scene_trace wrote them */
  uint32_t geometry;         /* COMPACT: the geometry of all hits; FULL: 0 */
  uint32_t instance;         /* COMPACT: their instance, where positions or normals are wanted; else 0 */
  gpurt_patch_point *points; /* [num_hits], in host memory */
  /* float32 [num_hits][3], of the patch itself and not of its triangles, in the world; of a miss 0; NULL: not wanted. */
  float *positions;
  float *normals; /* float32 [num_hits][3]: unit length, along dS/du x dS/dv of the patch as it was added */
} gpurt_locate_desc;
#define GPURT_LOCATE_DESC_INIT {sizeof(gpurt_locate_desc), GPURT_HIT_FULL, 0, NULL, 0, 0, NULL, NULL, NULL}

/** Finds the patches that hits lie on, and where on them.
 *
 *  The surface at (u, v) is no further from the hit than the commit's patch_error. Misses stay misses. Hits are those of the
 *  scene's last commit, of any device.
 *  Errors: INVALID_ARGUMENT naming the first hit that is on a mesh, or of a geometry, primitive or instance that the last
 *  commit does not have, or whose u and v are no point of a triangle; for a scene that was never committed. Nothing is
 *  written then.
 */
GPURT_API gpurt_result gpurt_scene_locate(gpurt_scene scene, const gpurt_locate_desc *desc);

/* ---- Photon maps --------------------------------------------------------- */

/* Points in space, with a flux and a normal each where they are wanted, sorted so that those near a place are found
 * fast. A distance is in single precision: d^2 = dx^2 + (dy^2 + dz^2) with fused multiply-adds. A point is within a
 * radius where d^2 < r^2. Answers have the same bits on every device and for any number of threads. */

typedef struct gpurt_photon_map_desc {
  uint32_t struct_size;   /* set by GPURT_PHOTON_MAP_DESC_INIT */
  gpurt_storage storage;  /* where the arrays lie; they are copied */
  uint64_t num_points;    /* below 2^31; 0: an empty map */
  const float *positions; /* float32 [num_points][3], finite */
  /* float32 [num_points][3], not negative, at most 3.3e38; NULL: none. Kept as mantissas of 8 bits with a common
   * exponent, rounded up or down at random, so that sums have no bias. */
  const float *fluxes;
  const float
      *normals; /* float32 [num_points][3], finite, of any length, kept in steps of 1/127; NULL: none */
  float radius; /* that queries will mostly have; 0: one that holds about 50 points where they lie densely */
  /* Grids, each with cells 4 times larger than the one before, at most 8: with more, nearest points that lie farther
   * away than `radius` are found faster. 0: 1. */
  uint32_t num_levels;
} gpurt_photon_map_desc;
#define GPURT_PHOTON_MAP_DESC_INIT \
  {sizeof(gpurt_photon_map_desc), GPURT_STORAGE_HOST, 0, NULL, NULL, NULL, 0, 0}

/* Photons of a scene, as GPURT_PIPELINE_PHOTON traces and keeps them. */
typedef struct gpurt_photon_trace_desc {
  uint32_t struct_size; /* set by GPURT_PHOTON_TRACE_DESC_INIT */
  uint32_t num_paths;   /* photons that leave the lights; 0: 1048576 */
  uint64_t seed;
  /* Which of the passes of a frame. With the frame's seed and frame_index, its max_depth, and num_paths its
   * photons_per_pass, the map holds the photons that the frame's sample of this index gathers. Below 2^64 - 1. */
  uint64_t pass;
  uint32_t frame_index;
  uint32_t max_depth;  /* vertices of a path from the eye, as of gpurt_render_desc; 0: 17; at most 255 */
  float radius;        /* as in gpurt_photon_map_desc */
  uint32_t num_levels; /* as in gpurt_photon_map_desc */
} gpurt_photon_trace_desc;
#define GPURT_PHOTON_TRACE_DESC_INIT {sizeof(gpurt_photon_trace_desc), 0, 0, 0, 0, 0, 0, 0}

/** Builds a map of the caller's points. It keeps the device alive.
 *
 *  With a device of several, the map lies on the first one.
 *  Errors: INVALID_ARGUMENT, also for an element that is not allowed, with the index of the first; OUT_OF_MEMORY;
 *  DEVICE.
 */
GPURT_API gpurt_result gpurt_photon_map_create(gpurt_device device, const gpurt_photon_map_desc *desc,
                                               gpurt_photon_map *out_map);

/** Traces photons from the lights of a scene's last commit, and builds a map of them on its device, where they stay.
 *
 *  The points are those that photon mapping keeps: where a photon comes to a diffuse surface or to metal of alpha
 *  0.35 (roughness squared) or more, but for the first surface after the light, whose light is direct, and for
 *  surfaces that no path of max_depth vertices sees. With max_depth 2 there are none. They are sorted by path, and
 *  along each path; they have the direction of flight, the surface's normal on the side that the photon came to, and a
 *  flux in watts of each colour: a sum over a disc divided by its area is irradiance, and sums are in proportion to
 *  1 / num_paths already. The same points on every device and for any number of threads. The map does not keep the
 *  scene.
 *
 *  @param desc  NULL: defaults.
 *
 *  Errors: INVALID_ARGUMENT, also for a scene that was never committed or where nothing shines; OUT_OF_MEMORY where
 *  the photons do not fit into the device's memory or its limit: fewer num_paths take less; DEVICE.
 *  Threads: any number of calls at a time.
 *  Source: Jensen 1996.
 */
GPURT_API gpurt_result gpurt_photon_map_trace(gpurt_scene scene, const gpurt_photon_trace_desc *desc,
                                              gpurt_photon_map *out_map);
GPURT_API gpurt_result gpurt_photon_map_retain(gpurt_photon_map map);
GPURT_API gpurt_result gpurt_photon_map_release(gpurt_photon_map map);

typedef struct gpurt_photon_map_info {
  uint32_t struct_size; /* set by GPURT_PHOTON_MAP_INFO_INIT */
  uint32_t num_levels;
  uint64_t num_points;
  float bounds[2][3]; /* lowest and highest coordinates; an empty map: 0 */
  float radius;       /* of the description, or the one that was chosen */
  uint32_t has_fluxes;
  uint32_t has_normals;
  uint32_t fullest_cell; /* points of the fullest entry of the finest grid's table */
  uint64_t memory_bytes;
  double build_seconds;    /* on a CUDA device: of the device, without copies from the host */
  uint32_t has_directions; /* of flight: points of gpurt_photon_map_trace have them */
  uint32_t num_paths;      /* photons that left the lights for it; 0: the points are the caller's */
} gpurt_photon_map_info;
#define GPURT_PHOTON_MAP_INFO_INIT \
  {sizeof(gpurt_photon_map_info), 0, 0, {{0, 0, 0}, {0, 0, 0}}, 0, 0, 0, 0, 0, 0, 0, 0}

/** Reads what a map is. */
GPURT_API gpurt_result gpurt_photon_map_get_info(gpurt_photon_map map, gpurt_photon_map_info *out_info);

/* What a map keeps of each point: float32 [num_points][3], in the order of ids. */
typedef enum gpurt_photon_attribute {
  GPURT_PHOTON_ATTRIBUTE_POSITION = 0,
  GPURT_PHOTON_ATTRIBUTE_FLUX = 1,      /* as it counts in sums */
  GPURT_PHOTON_ATTRIBUTE_NORMAL = 2,    /* in steps of 1/127, of about unit length, or 0 */
  GPURT_PHOTON_ATTRIBUTE_DIRECTION = 3, /* of flight, unit length */
  GPURT_PHOTON_ATTRIBUTE_FORCE32 = 0x7fffffff
} gpurt_photon_attribute;

/** Copies what a map keeps of its points to host memory.
 *
 *  @param data        float32 [num_points][3].
 *  @param size_bytes  Its size: 12 bytes a point.
 *
 *  Errors: INVALID_ARGUMENT for another size, and for what the map was made without; OUT_OF_MEMORY; DEVICE.
 *  Threads: any number of calls at a time.
 */
GPURT_API gpurt_result gpurt_photon_map_read(gpurt_photon_map map, gpurt_photon_attribute attribute,
                                             void *data, uint64_t size_bytes);

/** Writes a map to a file, under a temporary name that is then changed. Errors: IO; OUT_OF_MEMORY. */
GPURT_API gpurt_result gpurt_photon_map_save(gpurt_photon_map map, const char *path);

/** Reads a map that gpurt_photon_map_save wrote, on any device; it answers with the same bits.
 *
 *  Errors: IO for a foreign or damaged file; OUT_OF_MEMORY.
 */
GPURT_API gpurt_result gpurt_photon_map_load(gpurt_device device, const char *path,
                                             gpurt_photon_map *out_map);

typedef enum gpurt_photon_query {
  GPURT_PHOTON_QUERY_COUNT = 0,   /* how many points are within the radius */
  GPURT_PHOTON_QUERY_SUM = 1,     /* the sum of their fluxes, weighted by the kernel */
  GPURT_PHOTON_QUERY_LIST = 2,    /* which they are, in the order in which the map keeps them */
  GPURT_PHOTON_QUERY_NEAREST = 3, /* the k nearest, sorted by (distance, id) */
  GPURT_PHOTON_QUERY_FORCE32 = 0x7fffffff
} gpurt_photon_query;

/* Weight of a point at distance d of a radius r, not normalised. */
typedef enum gpurt_gather_kernel {
  GPURT_GATHER_KERNEL_CONSTANT = 0,  /* 1 */
  GPURT_GATHER_KERNEL_CONE = 1,      /* 1 - d / r */
  GPURT_GATHER_KERNEL_QUADRATIC = 2, /* 1 - d^2 / r^2 */
  GPURT_GATHER_KERNEL_FORCE32 = 0x7fffffff
} gpurt_gather_kernel;

#define GPURT_MAX_NEAREST 512

/* How points within a radius are found. */
typedef enum gpurt_gather_method {
  GPURT_GATHER_GRID = 0, /* in the cells of a grid */
  /* In lists of those within the radius of a kd-tree's leaves: a reference to compare with. The first query makes the
   * lists for its radius, and the map keeps them until one has another radius. Not for NEAREST. */
  GPURT_GATHER_NODE_LISTS = 1,
  GPURT_GATHER_METHOD_FORCE32 = 0x7fffffff
} gpurt_gather_method;

typedef struct gpurt_photon_query_desc {
  uint32_t struct_size; /* set by GPURT_PHOTON_QUERY_DESC_INIT */
  gpurt_photon_query query;
  gpurt_storage storage;      /* where all arrays lie */
  gpurt_gather_kernel kernel; /* SUM */
  uint64_t num_queries;
  const float *positions; /* float32 [num_queries][3]; one that is not finite finds nothing */
  /* float32 [num_queries][3], of any length: points count whose normal has a cosine with it above min_cosine, both in
   * steps of 1/127; NULL: all points count. Not for NEAREST. */
  const float *normals;
  float min_cosine;  /* in [-1, 1] */
  float radius;      /* in [1.1e-19, 1.8e19]; NEAREST: points farther away do not count, 0: all do */
  float radius_hint; /* NEAREST: about what holds k points; changes the speed alone. 0: not known */
  uint32_t k;        /* NEAREST: 1 to GPURT_MAX_NEAREST */
  uint32_t *counts;  /* uint32 [num_queries]: points found; NULL for LIST, may be NULL for SUM and NEAREST */
  float *sums;       /* SUM: float32 [num_queries][3]; else NULL */
  uint64_t *offsets; /* LIST: [num_queries + 1]; query i has ids offsets[i] .. offsets[i + 1]; else NULL */
  uint32_t
      *ids; /* NEAREST: [num_queries][k], the rest GPURT_INVALID_ID; LIST: [capacity], or NULL to count */
  float *distances;          /* as ids, the rest infinite; may be NULL */
  uint64_t capacity;         /* LIST: elements that ids and distances have room for */
  gpurt_coherence coherence; /* COHERENT: neighbours in the batch are neighbours in space, and not sorted */
  gpurt_gather_method method;
} gpurt_photon_query_desc;
#define GPURT_PHOTON_QUERY_DESC_INIT \
  {sizeof(gpurt_photon_query_desc), \
   GPURT_PHOTON_QUERY_COUNT, \
   GPURT_STORAGE_HOST, \
   GPURT_GATHER_KERNEL_CONSTANT, \
   0, \
   NULL, \
   NULL, \
   0, \
   0, \
   0, \
   0, \
   NULL, \
   NULL, \
   NULL, \
   NULL, \
   NULL, \
   0, \
   GPURT_COHERENCE_AUTO, \
   GPURT_GATHER_GRID}

/** Asks a map for the points near places and returns when it is done.
 *
 *  Errors: INVALID_ARGUMENT, also for LIST where capacity is too small (offsets are written: offsets[num_queries] is
 *  the capacity needed); OUT_OF_MEMORY; DEVICE.
 */
GPURT_API gpurt_result gpurt_photon_map_query(gpurt_photon_map map, const gpurt_photon_query_desc *desc);

/* ---- Frames and rendering ------------------------------------------------ */

typedef enum gpurt_output {
  GPURT_OUTPUT_COLOR = 0, /* float32 [h][w][3], radiance: mean over samples */
  GPURT_OUTPUT_ALPHA = 1, /* float32 [h][w]: share of samples whose eye ray hit something */
  GPURT_OUTPUT_DEPTH =
      2, /* float32 [h][w]: distance from the camera's plane, first sample; inf: nothing hit */
  GPURT_OUTPUT_NORMAL = 3,       /* float32 [h][w][3]: shading normal towards the viewer, mean over samples */
  GPURT_OUTPUT_ALBEDO = 4,       /* float32 [h][w][3]: reflectance of the first surface, mean over samples */
  GPURT_OUTPUT_POSITION = 5,     /* float32 [h][w][3]: world position, first sample; nothing hit: 0 */
  GPURT_OUTPUT_PRIMITIVE = 6,    /* uint32 [h][w], first sample; GPURT_INVALID_ID: nothing hit */
  GPURT_OUTPUT_INSTANCE = 7,     /* uint32 [h][w], first sample */
  GPURT_OUTPUT_SAMPLE_COUNT = 8, /* uint32 [h][w] */
  GPURT_OUTPUT_VARIANCE =
      9, /* float32 [h][w][3]: variance of the colour, from two independent halves; infinite while one is empty */
  GPURT_OUTPUT_TIME = 10, /* this version: UNSUPPORTED */
  /* Of GPURT_PIPELINE_PHOTON alone, without GPURT_PHOTON_ESTIMATOR_PER_PIXEL; else jobs are UNSUPPORTED. */
  GPURT_OUTPUT_BIAS = 11, /* float32 [h][w][3]: what blur adds to the colour, estimated; signed */
  GPURT_OUTPUT_ERROR =
      12, /* float32 [h][w][3]: what blur and noise move the colour by at most, with 95 % confidence, or infinite */
  GPURT_OUTPUT_COUNT = 13,
  GPURT_OUTPUT_FORCE32 = 0x7fffffff
} gpurt_output;

typedef struct gpurt_frame_desc {
  uint32_t struct_size; /* set by GPURT_FRAME_DESC_INIT */
  uint32_t width;       /* pixels; 0: what the camera says, else 512 */
  uint32_t height;
  uint32_t camera;      /* of the scene */
  uint32_t outputs;     /* bits 1 << gpurt_output; colour, alpha and sample count are always kept */
  uint32_t frame_index; /* of an animation: decorrelates the samples of different frames */
  uint64_t seed;
  uint64_t
      first_sample; /* the first sample index that this frame renders; frames with other ranges can be merged */
} gpurt_frame_desc;
#define GPURT_FRAME_DESC_INIT {sizeof(gpurt_frame_desc), 0, 0, 0, 0, 0, 0, 0}

/** Creates a frame of a committed scene: the film that renders add to. It keeps the scene alive.
 *
 *  Pixel (x, y) covers [x, x+1) x [y, y+1), row 0 is the top row; a value is the mean over that square.
 *  Errors: INVALID_ARGUMENT; OUT_OF_MEMORY; UNSUPPORTED.
 */
GPURT_API gpurt_result gpurt_frame_create(gpurt_scene scene, const gpurt_frame_desc *desc,
                                          gpurt_frame *out_frame);
GPURT_API gpurt_result gpurt_frame_retain(gpurt_frame frame);
GPURT_API gpurt_result gpurt_frame_release(gpurt_frame frame);

typedef struct gpurt_tile {
  uint32_t x0, y0; /* first pixel */
  uint32_t x1, y1; /* one past the last */
} gpurt_tile;

typedef enum gpurt_pipeline {
  GPURT_PIPELINE_AUTO = 0, /* path, until there is a planner */
  GPURT_PIPELINE_PATH = 1,
  GPURT_PIPELINE_PHOTON = 2,
  GPURT_PIPELINE_REYES = 3,  /* this version: max_depth at most 2; else UNSUPPORTED */
  GPURT_PIPELINE_HYBRID = 4, /* this version: UNSUPPORTED */
  GPURT_PIPELINE_FORCE32 = 0x7fffffff
} gpurt_pipeline;

/* How photons become radiance. Memoryless passes alone are independent of each other: only they can be merged, and shared
   by several devices; with the others both is UNSUPPORTED. */
typedef enum gpurt_photon_estimator {
  GPURT_PHOTON_ESTIMATOR_AUTO = 0, /* memoryless */
  GPURT_PHOTON_ESTIMATOR_MEMORYLESS =
      1, /* a radius that depends on the pass alone (Knaus and Zwicker 2011) */
  /* Each pixel keeps its radius, photons and flux (Hachisuka and Jensen 2009). With the constant kernel alone. */
  GPURT_PHOTON_ESTIMATOR_PER_PIXEL = 2,
  /* A radius for each pixel, by its blur and noise so far (Kaplanyan and Dachsbacher 2013). */
  GPURT_PHOTON_ESTIMATOR_ADAPTIVE = 3,
  GPURT_PHOTON_ESTIMATOR_FORCE32 = 0x7fffffff
} gpurt_photon_estimator;

typedef enum gpurt_photon_kernel {
  GPURT_PHOTON_KERNEL_AUTO = 0,     /* constant */
  GPURT_PHOTON_KERNEL_CONSTANT = 1, /* every photon within the radius counts alike */
  GPURT_PHOTON_KERNEL_CONE = 2,     /* falls linearly to 0 at the radius: sharper, noisier */
  GPURT_PHOTON_KERNEL_FORCE32 = 0x7fffffff
} gpurt_photon_kernel;

/* What is done about photons of other surfaces, and about surfaces that end, within the radius. */
typedef enum gpurt_photon_remedy {
  GPURT_PHOTON_REMEDY_NORMAL = 1, /* leave out photons on surfaces that are turned away: corners */
  GPURT_PHOTON_REMEDY_PLANE = 2, /* leave out photons off the plane of the visible point: steps, thin walls */
  GPURT_PHOTON_REMEDY_SIDE = 4,  /* leave out photons that came to the other side: leaks */
  GPURT_PHOTON_REMEDY_BOUNDARY =
      8, /* divide by the part of the disc that lies on a surface: dark rims. Costs rays */
  GPURT_PHOTON_REMEDY_NONE = 16, /* alone: none of them */
  /* follow paths past points that other surfaces are nearer to than the radius, and gather later: light under walls. Costs
   * 8 short rays a visible point, and noise there */
  GPURT_PHOTON_REMEDY_CONTINUE = 32,
  GPURT_PHOTON_REMEDY_FORCE32 = 0x7fffffff
} gpurt_photon_remedy;

/* Settings of GPURT_PIPELINE_PHOTON; other pipelines want them zero. Where a frame has samples, zero means what they were
   made with: settings cannot differ within a frame. */
typedef struct gpurt_photon_settings {
  /* emitted for each sample of the pixels; 0: about one a pixel of the frame, by trial passes with a time_limit_s */
  uint32_t photons_per_pass;
  float initial_radius; /* of pass 0, in metres; 0: by a pilot, by trial passes with a time_limit_s */
  gpurt_photon_estimator estimator;
  gpurt_photon_kernel kernel;
  uint32_t remedies; /* bits of gpurt_photon_remedy; 0: all but CONTINUE */
  uint32_t reserved; /* 0 */
} gpurt_photon_settings;
#define GPURT_PHOTON_SETTINGS_INIT {0, 0, GPURT_PHOTON_ESTIMATOR_AUTO, GPURT_PHOTON_KERNEL_AUTO, 0, 0}

/* What photon mapping did; totals over all jobs of a frame. */
typedef struct gpurt_photon_counters {
  uint64_t num_emitted;    /* photon paths */
  uint64_t num_rays;       /* of photons */
  uint64_t num_stored;     /* photons on surfaces that receive them */
  uint64_t num_gathered;   /* photons that counted at visible points */
  uint64_t num_visible;    /* visible points */
  uint64_t num_sub_passes; /* photon maps that were built: more than passes where memory held no whole pass */
  double trace_seconds;    /* per stage, summed over threads: photons from the lights to where they end */
  double build_seconds;
  double gather_seconds;
  double smallest_radius; /* of the last pass so far */
  double emit_seconds;    /* of trace_seconds: at the lights */
  double scatter_seconds; /* of trace_seconds: at surfaces; the rest is rays */
  uint64_t reserved[2];
} gpurt_photon_counters;
#define GPURT_PHOTON_COUNTERS_INIT {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, {0, 0}}

/* How samples become pixels. */
typedef enum gpurt_reyes_filter {
  GPURT_REYES_FILTER_AUTO = 0,     /* box */
  GPURT_REYES_FILTER_BOX = 1,      /* the mean over the pixel's square */
  GPURT_REYES_FILTER_GAUSSIAN = 2, /* radius 1.5 pixels */
  GPURT_REYES_FILTER_MITCHELL = 3, /* Mitchell and Netravali 1988, B = C = 1/3: sharper, may overshoot */
  GPURT_REYES_FILTER_FORCE32 = 0x7fffffff
} gpurt_reyes_filter;

/* Where light is computed. A micropolygon's own light is that of the surface in the middle of its (u, v); samples that see
   it have that light, where it takes no rays rounded without bias to 9 bits of red and green, 8 of blue and an exponent. It
   depends on the patch, the camera and the samples' numbers alone, not on tiles, threads or memory. Where there are shadows,
   meshes, lamps, environments, alpha masks or outputs other than COLOR, ALPHA, SAMPLE_COUNT and VARIANCE it is found after
   visibility, by rays: docs/reyes.md. Surfaces that blend are UNSUPPORTED. */
typedef enum gpurt_reyes_shading {
  GPURT_REYES_SHADING_AUTO = 0,          /* samples */
  GPURT_REYES_SHADING_SAMPLES = 1,       /* at every sample, once it is known what samples see */
  GPURT_REYES_SHADING_MICROPOLYGONS = 2, /* once for each micropolygon */
  GPURT_REYES_SHADING_BLOCKS = 3,        /* once for each 2 x 2 of them, in the middle of the four */
  GPURT_REYES_SHADING_FORCE32 = 0x7fffffff
} gpurt_reyes_shading;

/* Settings of GPURT_PIPELINE_REYES; other pipelines want them zero. Where a frame has samples, zero means what they were
   made with: settings cannot differ within a frame. */
typedef struct gpurt_reyes_settings {
  float shading_rate; /* area of a micropolygon in pixels; 0: 0.25, of GAUSSIAN 0.375. In [2^-8, 2^8] */
  gpurt_reyes_filter filter;
  gpurt_reyes_shading shading;
  uint32_t no_shadows; /* 1: nothing stands between a surface and a light */
  float flatness; /* pixels by which larger micropolygons, up to 2.8 long, may leave the surface; 0: none */
  /* 0: a sample keeps all fragments of surfaces that blend. Above 0, at most 64: a study variant, the fixed A-buffer: the
     nearest ones, so many of them; the others are lost, and counted. */
  uint32_t fragment_slots;
} gpurt_reyes_settings;
#define GPURT_REYES_SETTINGS_INIT {0, GPURT_REYES_FILTER_AUTO, GPURT_REYES_SHADING_AUTO, 0, 0, 0}

/* What REYES did; totals over all jobs of a frame. What several tiles see counts in each. */
typedef struct gpurt_reyes_counters {
  uint64_t num_patches;       /* that may be seen */
  uint64_t num_triangles;     /* of meshes, that may be seen */
  uint64_t num_splits;        /* pieces of patches that were cut in two */
  uint64_t num_culled;        /* pieces that cannot be seen */
  uint64_t num_grids;         /* pieces that were diced */
  uint64_t num_micropolygons; /* of these */
  uint64_t num_fragments; /* times that a sample took a surface; on CUDA devices, that one covered a sample */
  uint64_t num_shaded;    /* points where light was computed */
  uint64_t largest_queue; /* pieces that waited at a time */
  uint64_t largest_bucket; /* primitives that a bucket of the image, or a CUDA device, looked at at a time */
  uint64_t working_bytes;  /* memory of the pipeline at a time, beside the scene and the film */
  double bound_seconds;    /* per stage, summed over threads */
  double split_seconds;
  double dice_seconds; /* on CUDA devices 0: grids are diced and sampled by one kernel */
  double sample_seconds;
  uint64_t split_rounds;       /* CUDA devices: launches, or rounds of one, in which pieces were cut */
  uint64_t num_donated;        /* GPURT_LAUNCH_PERSISTENT: pieces that a block gave away for others to cut */
  uint64_t largest_fragments;  /* of surfaces that blend, kept at a time; a largest, not a sum */
  uint64_t num_lost_fragments; /* fragment_slots: that found no slot */
  uint64_t reserved[1];
} gpurt_reyes_counters;
#define GPURT_REYES_COUNTERS_INIT {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, {0}}

/** Called now and then from one thread at a time while a job runs; done and total are in samples. Must not call gpurt. */
typedef void (*gpurt_progress_fn)(void *user, double done, double total);

typedef struct gpurt_render_desc {
  uint32_t struct_size; /* set by GPURT_RENDER_DESC_INIT */
  gpurt_pipeline pipeline;
  uint32_t
      samples_per_pixel; /* until every pixel of the tiles has this many; 0: by error or time, else 64, of REYES 9 */
  float
      target_error; /* stop at the first whole-frame pass whose estimated error (relMSE) is below; 0: none */
  double time_limit_s; /* stop at the last whole-frame pass that fits; 0: none */
  uint32_t max_depth;  /* emission seen directly is 1, direct light 2; 0: 17, of REYES 2 */
  uint32_t
      tile_size; /* edge of the square work unit in pixels; 0: the library's choice; at most 256; changes no bits */
  gpurt_progress_fn progress; /* NULL: none */
  void *progress_user;
  gpurt_schedule schedule;
  gpurt_photon_settings photon;
  gpurt_reyes_settings reyes;
} gpurt_render_desc;
#define GPURT_RENDER_DESC_INIT \
  {sizeof(gpurt_render_desc),  GPURT_PIPELINE_AUTO,      0, 0, 0, 0, 0, NULL, NULL, GPURT_SCHEDULE_INIT, \
   GPURT_PHOTON_SETTINGS_INIT, GPURT_REYES_SETTINGS_INIT}

/** Starts rendering of tiles; returns at once.
 *
 *  @param desc       Settings, or NULL for defaults.
 *  @param tiles      Any rectangles of the frame in any order; NULL with num_tiles 0: the whole frame.
 *  @param out_job    Owned by the caller. Keeps the frame alive.
 *
 *  Samples are added to what the frame has: a job that was cancelled, or stopped early, goes on where it was, and
 *  the image has the same bits as if it had run at once. Jobs of one frame run one after another.
 *  Errors: INVALID_ARGUMENT; UNSUPPORTED; OUT_OF_MEMORY.
 */
GPURT_API gpurt_result gpurt_frame_submit(gpurt_frame frame, const gpurt_render_desc *desc,
                                          const gpurt_tile *tiles, size_t num_tiles, gpurt_job *out_job);

/** Waits for a job. Returns its result, CANCELLED if it was cancelled, or TIMEOUT if it still runs. timeout_ns 0 polls. */
GPURT_API gpurt_result gpurt_job_wait(gpurt_job job, uint64_t timeout_ns);

/** Asks a job to stop; it does so within half a second, keeping whole samples. Waiting then returns CANCELLED. */
GPURT_API gpurt_result gpurt_job_cancel(gpurt_job job);

/** Share of the job that is done, in [0, 1]. */
GPURT_API gpurt_result gpurt_job_get_progress(gpurt_job job, double *out_share);
GPURT_API gpurt_result gpurt_job_retain(gpurt_job job);

/** Gives a job back. One that still runs is cancelled. */
GPURT_API gpurt_result gpurt_job_release(gpurt_job job);

/** Copies an output of the frame to host memory, or to memory of the frame's CUDA device.
 *
 *  @param data        Room for the output's shape as gpurt_output states it, top row first. On a CUDA device page-locked host
 *                     memory is written by the device itself, and so is memory of the device: after what the legacy default
 *                     stream has then, and before the call returns.
 *  @param size_bytes  Size of data; must match exactly.
 *
 *  Pixels without samples are 0, their ids GPURT_INVALID_ID. May be called while a job runs: whole samples are seen.
 *  Errors: INVALID_ARGUMENT, also for an output that the frame was not created with, and for memory of another CUDA device;
 *  DEVICE once, where the device was lost with the frame's last samples: the frame goes on with those that the host has.
 */
GPURT_API gpurt_result gpurt_frame_read(gpurt_frame frame, gpurt_output output, void *data,
                                        uint64_t size_bytes);

/** Writes the frame to a file, by its extension.
 *
 *  .exr: float32, every output of the frame as a named layer, settings, seed and version in the header.
 *  .png: the colour, tonemapped with x / (1 + x) and the sRGB curve.
 *  .gpurt: the frame's sums, exact, for gpurt_frame_load_state and merging elsewhere.
 *  Written to a temporary name in the same folder, then renamed.
 *  Errors: INVALID_ARGUMENT for another extension; IO.
 */
GPURT_API gpurt_result gpurt_frame_save(gpurt_frame frame, const char *path);

/** Adds the samples of `other` to `frame`; any order of merging gives the same bits as rendering at once.
 *
 *  Errors: INVALID_ARGUMENT where scenes, sizes, seeds, outputs or settings differ, or samples would count twice.
 */
GPURT_API gpurt_result gpurt_frame_merge(gpurt_frame frame, gpurt_frame other);

/** Adds the samples of a .gpurt file to `frame`. Errors: as gpurt_frame_merge; IO for a damaged file. */
GPURT_API gpurt_result gpurt_frame_load_state(gpurt_frame frame, const char *path);

typedef struct gpurt_state_info {
  uint32_t struct_size; /* set by GPURT_STATE_INFO_INIT */
  /* of the frame's description */
  uint32_t width;
  uint32_t height;
  uint32_t camera;
  uint32_t outputs;
  uint32_t frame_index;
  uint64_t seed;
  uint64_t first_sample;
  /* of its samples */
  uint64_t num_samples; /* in all pixels together */
  uint64_t scene_hash;
  gpurt_pipeline pipeline; /* AUTO: no samples yet */
  gpurt_accel accel;
  gpurt_triangle_test triangle_test;
  uint32_t max_depth;           /* 0: no samples yet */
  gpurt_photon_settings photon; /* zero for other pipelines */
  gpurt_reyes_settings reyes;   /* zero for other pipelines */
} gpurt_state_info;
#define GPURT_STATE_INFO_INIT \
  {sizeof(gpurt_state_info), \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   GPURT_PIPELINE_AUTO, \
   GPURT_ACCEL_AUTO, \
   GPURT_TRIANGLE_WATERTIGHT, \
   0, \
   GPURT_PHOTON_SETTINGS_INIT, \
   GPURT_REYES_SETTINGS_INIT}

/** Reads what a .gpurt file is the state of: how to create and build a frame that can load it.
 *
 *  Reads the head of the file alone. Errors: INVALID_ARGUMENT; IO for a foreign or damaged file.
 */
GPURT_API gpurt_result gpurt_state_read_info(const char *path, gpurt_state_info *out_info);

typedef struct gpurt_statistics {
  uint32_t struct_size; /* set by GPURT_STATISTICS_INIT */
  /* resolved settings of the last job */
  gpurt_pipeline pipeline;
  gpurt_accel accel;
  gpurt_triangle_test triangle_test;
  uint32_t max_depth;
  uint32_t tile_size;
  uint32_t num_threads;
  uint32_t width;
  uint32_t height;
  uint64_t seed;
  uint64_t samples_per_pixel; /* the smallest number that a pixel of the frame has */
  /* totals over all jobs of the frame */
  uint64_t num_samples; /* camera paths */
  uint64_t num_camera_rays;
  uint64_t num_bounce_rays;
  uint64_t num_shadow_rays;
  uint64_t num_nonfinite; /* samples that were not finite and left out; 0 in a sound scene */
  uint64_t num_saturated; /* sums that left the film's range; not 0 makes the job fail */
  double render_seconds;
  double generate_seconds; /* per stage, summed over threads */
  double trace_seconds;
  double shade_seconds;
  double shadow_seconds;
  double film_seconds;
  double build_seconds;   /* of the scene's commit */
  double estimated_error; /* relMSE of the frame, noise and known bias; negative: not known */
  double largest_sample;  /* largest radiance of a single sample */
  uint64_t memory_peak_bytes;
  char reason[256];        /* why settings were chosen */
  gpurt_schedule schedule; /* of the last job, resolved */
  gpurt_schedule_counters
      schedule_counters;                 /* over all jobs of the frame; a saved state does not keep them */
  gpurt_photon_settings photon;          /* resolved; zero for other pipelines */
  gpurt_photon_counters photon_counters; /* over all jobs of the frame */
  gpurt_reyes_settings reyes;            /* resolved; zero for other pipelines */
  gpurt_reyes_counters reyes_counters;   /* over all jobs of the frame; a saved state does not keep them */
  /* The part of estimated_error that is bias; the rest is noise, from two independent halves. Of photon mapping it is known
     where the frame has GPURT_OUTPUT_BIAS or _ERROR, or its first job had a target_error; negative: not known. */
  double estimated_bias;
} gpurt_statistics;
#define GPURT_STATISTICS_INIT \
  {sizeof(gpurt_statistics), \
   GPURT_PIPELINE_AUTO, \
   GPURT_ACCEL_AUTO, \
   GPURT_TRIANGLE_WATERTIGHT, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   0, \
   {0}, \
   GPURT_SCHEDULE_INIT, \
   GPURT_SCHEDULE_COUNTERS_INIT, \
   GPURT_PHOTON_SETTINGS_INIT, \
   GPURT_PHOTON_COUNTERS_INIT, \
   GPURT_REYES_SETTINGS_INIT, \
   GPURT_REYES_COUNTERS_INIT, \
   0}

/** Reads the statistics of a frame; while a job runs, of what is done so far. */
GPURT_API gpurt_result gpurt_frame_get_statistics(gpurt_frame frame, gpurt_statistics *out_statistics);

#ifdef __cplusplus
}
#endif
#endif
