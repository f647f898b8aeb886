"""Scenes: what there is to trace and to render."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable, Literal, Mapping, NamedTuple, NoReturn, Optional, Sequence, Tuple, Union, overload

import numpy as np
import numpy.typing as npt

from gpurt import _core
from gpurt._arrays import (IDENTITY, Array, FloatArray, PathLike, UIntArray, Vector, as_array, float_rows, optional_path,
                           shape_text, to_count, to_float32, to_number, to_path, to_transform, to_uint32, to_vec3)
from gpurt._foreign import mesh_rows, trace_foreign
from gpurt._libraries import library_of
from gpurt._names import (ACCEL, BUILD_QUALITY, CAMERA_TYPE, FILTER, HIT_FORMAT, LIGHT_TYPE, MATERIAL_TYPE, SUBDIVISION_SCHEME,
                          TRIANGLE_TEST, WRAP)
from gpurt._trace import hit_compact_dtype, hit_dtype, make_rays, trace
from gpurt.device import Device, default_device, refuse_pickling
from gpurt.errors import InvalidArgument
from gpurt.frame import Frame
from gpurt.image import Image
from gpurt.photons import PhotonMap

#: The primitive, geometry and instance of a ray that hits nothing.
INVALID_ID = 0xFFFFFFFF

#: A node of a kd-tree. Inner: word holds the bits of the float32 plane, tag is child << 2 | axis, the children are
#: child and child + 1. Leaf: word is the first reference, tag is count << 2 | 3.
kdtree_node_dtype = np.dtype([("word", "<u4"), ("tag", "<u4")])


#: Where a hit lies on its patch: the patch of its geometry (INVALID_ID for a miss) and the parameters u, v.
patch_point_dtype = np.dtype([("patch", "<u4"), ("u", "<f4"), ("v", "<f4")])


class Placed(NamedTuple):
    """What add_mesh and its like made."""

    geometry: int
    instance: Optional[int]  #: None with transform=False


@dataclasses.dataclass(frozen=True)
class SceneFacts:
    """Counts and facts of a scene; what the last commit built is zero before the first one."""

    num_geometries: int
    num_instances: int
    num_materials: int
    num_textures: int
    num_cameras: int
    num_point_lights: int  #: point and spot
    num_distant_lights: int
    num_patches: int  #: stored
    num_triangles: int  #: stored, tessellated patches included
    num_world_triangles: int  #: seen through all instances
    num_emissive_triangles: int
    bounds_min: Tuple[float, float, float]  #: world; an empty scene has min > max
    bounds_max: Tuple[float, float, float]
    has_environment: bool
    has_glass: bool
    has_alpha_masks: bool
    is_committed: bool
    accel: str
    triangle_test: str
    accel_bytes: int  #: acceleration structure, its copies of triangles included
    scene_bytes: int  #: everything that the commit holds
    num_nodes: int
    num_references: int  #: triangle references in leaves
    tree_depth: int
    tree_from_cache: bool  #: read from the cache file or imported
    build_seconds: float
    sah_cost: float
    accel_build_seconds: float  #: of build_seconds, to build the acceleration structure
    build_peak_bytes: int  #: device memory that its build held at a time; 0: it was not built on a GPU
    tree_refitted: bool  #: to vertices that have moved
    has_blending: bool  #: a material blends
    patch_error: float  #: no point of a patch is further from its triangles, in metres of the world
    patch_error_pixels: float  #: the same in pixels of patch_pixels' picture; inf: none is proven; 0: not asked for


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera of a scene."""

    type: str
    transform: FloatArray  #: [3][4], camera to world; looks along its -Z, +Y is up
    yfov: float  #: full vertical angle, radians
    width: int  #: the image size that the scene's author meant; 0: not said
    height: int


@dataclasses.dataclass(eq=False)
class KdTree:
    """A kd-tree as arrays: to look at, to keep, or to let a tree built elsewhere drive the traversal."""

    nodes: Array  #: [num_nodes] of kdtree_node_dtype; 0 is the root, a child's index exceeds its parent's
    references: UIntArray  #: [num_references], triangles of leaves
    num_triangles: int
    bounds_min: Tuple[float, float, float]
    bounds_max: Tuple[float, float, float]
    tree: int = 0  #: 0: all geometries placed once, in world space; 1 + g: geometry g in object space


def look_at(position: Vector, target: Vector, up: Vector = (0, 1, 0)) -> FloatArray:
    """The transform [3][4] of a camera at `position` that looks at `target`; `up` points up in the picture."""
    p, t, u = (np.array(to_vec3(v, name), np.float64)
               for v, name in ((position, "position"), (target, "target"), (up, "up")))
    z = p - t
    x = np.cross(u, z)
    if not np.linalg.norm(z) > 0:
        raise InvalidArgument("target: is where the camera is; give a point in front of it")
    # Of unit-length vectors: the sine of the angle between them.
    if not np.linalg.norm(x) > 1e-12 * np.linalg.norm(z) * np.linalg.norm(u):
        raise InvalidArgument("up: is zero or along the line of sight; give another direction")
    x /= np.linalg.norm(x)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z, p], axis=1).astype(np.float32)


class Scene:
    """Geometry, materials, lights and cameras, described by arrays, then committed, then traced and rendered.

    :param device: where the scene lives; None: gpurt.default_device().

    Geometries, instances, lights and cameras count from 0 in the order of their creation; materials and textures
    count from 1, so that 0 means none. Metres, right-handed, Y up; radiance in linear Rec. 709.

    Arrays are numpy arrays or anything that offers DLPack, the buffer protocol or the CUDA array interface. In host
    memory float32 and uint32 arrays with packed rows are read where they lie, others are converted by a copy first.
    Arrays of vertices and rays may also lie on a GPU of the scene's device; they have the right type and layout then.
    Nothing of them is needed after the call, unless it says otherwise.

    A scene may be used from several threads; calls that change it exclude each other.
    """

    def __init__(self, device: Optional[Device] = None) -> None:
        self.device = default_device() if device is None else device
        if not isinstance(self.device, Device):
            raise TypeError(f"device: expected a gpurt.Device, got {type(device).__name__}")
        self._core = _core.Scene(self.device._core)

    # ---- description ----

    def add_texture(self, texels: Any, *, srgb: Optional[bool] = None,
                    wrap: Union[str, Tuple[str, str]] = "repeat", filter: str = "linear") -> int:
        """Adds a texture and returns its id, from 1.

        :param texels: [h][w][4] or [h][w][3] (opaque), row 0 is the top row and lies at v = 0. uint8 stands for
            [0, 1]; floating-point numbers are taken as they are. Copied.
        :param srgb: colours of uint8 texels are decoded from sRGB before filtering; None: yes for uint8.
        :param wrap: "repeat", "clamp" or "mirror", or one for u and one for v.
        :param filter: "linear" (texel centres at (i + 0.5) / size) or "nearest".

        Raises InvalidArgument, also for texels that are not finite.
        """
        array = as_array(texels, "texels")
        if array.ndim != 3 or array.shape[2] not in (3, 4):
            raise InvalidArgument(f"texels: expected [h][w][3] or [h][w][4], got {shape_text(array.shape)}")
        if array.dtype == np.uint8:
            texture_format, opaque = (1 if srgb is False else 0), 255
        elif array.dtype.kind == "f":
            if srgb:
                raise InvalidArgument("srgb: goes with uint8 texels; floating-point ones are linear")
            array = to_float32(array, "texels")
            texture_format, opaque = 2, 1
        else:
            raise InvalidArgument(f"texels: expected uint8 or floating-point numbers, got {array.dtype}")
        height, width, channels = array.shape
        if channels == 3:
            rgba = np.full((height, width, 4), opaque, array.dtype)
            rgba[..., :3] = array
            array = rgba
        wrap_u, wrap_v = (wrap, wrap) if isinstance(wrap, str) else wrap
        return self._core.add_texture(texture_format, to_count(width, "texels"), to_count(height, "texels"),
                                      WRAP.value(wrap_u), WRAP.value(wrap_v), FILTER.value(filter),
                                      np.ascontiguousarray(array))

    def add_material(self, type: str = "lambert", *, base_color: Union[float, Vector] = (1, 1, 1),
                     roughness: float = 1, ior: float = 1.5, alpha: float = 1, alpha_cutoff: float = 0,
                     emission: Union[float, Vector] = (0, 0, 0), base_color_texture: int = 0,
                     two_sided_emission: bool = False, blends: bool = False,
                     emission_texture: int = 0, attenuation_color: Union[float, Vector] = (1, 1, 1),
                     attenuation_distance: float = 0) -> int:
        """Adds a material and returns its id, from 1.

        :param type: "lambert", "mirror", "glass" (smooth dielectric; closed solids) or "metal" (GGX).
        :param base_color: linear, in [0, 1]: reflectance, or the tint of glass; three numbers or one.
        :param roughness: of metal, in (0, 1]; GGX's alpha is its square.
        :param ior: index of refraction of glass.
        :param alpha: multiplies the texture's alpha; used with alpha_cutoff or blends alone.
        :param alpha_cutoff: > 0: parts whose alpha is below it are holes.
        :param emission: radiance, W/(m^2 sr) up to the lights' scale.
        :param base_color_texture: multiplies base_color; 0: none.
        :param blends: alpha is opacity: of light, 1 - alpha passes straight on. With alpha_cutoff 0.
        :param two_sided_emission: emits from both sides, not from the counter-clockwise one alone.
        :param emission_texture: multiplies emission, at base_color_texture's coordinates; 0: none.
        :param attenuation_color: of glass: the share of light that is left after attenuation_distance within it,
            linear, in [0, 1]; three numbers or one.
        :param attenuation_distance: of glass, in metres of the world; 0: it does not absorb.
        """
        return self._core.add_material(
            MATERIAL_TYPE.value(type), to_vec3(base_color, "base_color", spread=True),
            to_number(roughness, "roughness"), to_number(ior, "ior"), to_number(alpha, "alpha"),
            to_number(alpha_cutoff, "alpha_cutoff"), to_vec3(emission, "emission", spread=True),
            to_count(base_color_texture, "base_color_texture"), bool(two_sided_emission), bool(blends),
            to_count(emission_texture, "emission_texture"),
            to_vec3(attenuation_color, "attenuation_color", spread=True),
            to_number(attenuation_distance, "attenuation_distance"))

    def add_mesh(self, vertices: Any, indices: Any = None, normals: Any = None, uvs: Any = None, *,
                 material: int = 0, transform: Any = None, share: bool = False) -> Placed:
        """Adds a triangle mesh, places it, and returns (geometry, instance).

        :param vertices: float32 [n][3], metres, or [m][3][3] without indices.
        :param indices: uint32 [m][3], each < n; None: vertices form triangles three by three.
        :param normals: float32 [n][3], of any length; None: flat.
        :param uvs: float32 [n][2]; None: (0, 0).
        :param material: id; 0: white Lambertian.
        :param transform: object to world, [3][4] or [4][4]; None: where it is; False: not placed, see add_instance.
        :param share: the scene reads arrays in host memory where they are for as long as it lives, in place of copying
            them; they must not change meanwhile. They must be arrays of the types above (indices also int32).

        Degenerate triangles are legal and never hit. The counter-clockwise side is the front.

        Raises InvalidArgument, naming the first index out of range or vertex that is not finite.
        """
        place = None if transform is False else to_transform(transform)
        geometry = self._core.add_mesh(
            mesh_rows(self.device, vertices, "vertices", 3, "[n][3]", share),
            None if indices is None else mesh_rows(self.device, indices, "indices", 3, "[m][3]", share),
            None if normals is None else mesh_rows(self.device, normals, "normals", 3, "[n][3]", share),
            None if uvs is None else mesh_rows(self.device, uvs, "uvs", 2, "[n][2]", share),
            to_count(material, "material"))
        return self._place(geometry, place)

    def set_vertices(self, geometry: int, vertices: Any, normals: Any = None, *, share: bool = False) -> None:
        """Moves the vertices of a mesh: the next commit sees them.

        :param vertices: as for add_mesh, as many as there are.
        :param normals: None, where the mesh has none; else as many.
        :param share: as for add_mesh.

        A commit of quality "fast" with a bvh on a GPU refits its tree in place of building it, where it can.

        Raises InvalidArgument; the scene is then as it was.
        """
        self._core.set_vertices(to_count(geometry, "geometry"),
                                mesh_rows(self.device, vertices, "vertices", 3, "[n][3]", share),
                                None if normals is None else mesh_rows(self.device, normals, "normals", 3, "[n][3]", share))

    def add_patches(self, control_points: Any, *, material: int = 0, transform: Any = None) -> Placed:
        """Adds bicubic Bezier patches, places them, and returns (geometry, instance).

        :param control_points: float32 [n][16][3], [n][4][4][3] or [16 n][3]: point 4*row + column, u along columns.

        For rays they are tessellated at commit, to its patch_tolerance. Other parameters as for add_mesh.
        """
        place = None if transform is False else to_transform(transform)
        points = float_rows(control_points, "control_points", 3, "[n][16][3]")
        return self._place(self._core.add_patches(points, to_count(material, "material")), place)

    def add_subdivision(self, vertices: Any, face_counts: Any, indices: Any, *, scheme: str = "catmull-clark",
                        material: int = 0, transform: Any = None) -> Placed:
        """Adds a subdivision surface: vertices [n][3], corners of each face [f], their vertices [sum].

        Raises Unsupported in this version.
        """
        place = None if transform is False else to_transform(transform)
        geometry = self._core.add_subdivision(
            float_rows(vertices, "vertices", 3, "[n][3]"),
            to_uint32(as_array(face_counts, "face_counts").reshape(-1, 1), "face_counts"),
            to_uint32(as_array(indices, "indices").reshape(-1, 1), "indices"),
            SUBDIVISION_SCHEME.value(scheme), to_count(material, "material"))
        return self._place(geometry, place)

    def _place(self, geometry: int, transform: Optional[Tuple[float, ...]]) -> Placed:
        return Placed(geometry, None if transform is None else self._core.add_instance(geometry, transform))

    def add_instance(self, geometry: int, transform: Any = None) -> int:
        """Places a geometry in the world and returns the instance's id, from 0.

        :param transform: object to world, [3][4] or [4][4], invertible; None: the identity.

        A geometry placed once is stored in world space; one placed more often is stored once and shared.
        """
        return self._core.add_instance(to_count(geometry, "geometry"), to_transform(transform))

    def add_light(self, type: str = "point", *, intensity: Union[float, Vector], position: Vector = (0, 0, 0),
                  direction: Vector = (0, -1, 0), inner_cone_angle: float = 0,
                  outer_cone_angle: float = math.pi / 4) -> int:
        """Adds a light without extent and returns its id, from 0. Lamps with extent are materials that emit.

        :param type: "point", "spot" or "distant".
        :param intensity: W/sr; of "distant" the irradiance on a facing surface, W/m^2; three numbers or one.
        :param position: of "point" and "spot".
        :param direction: where "spot" and "distant" shine; of any length.
        :param inner_cone_angle: of "spot": full intensity within, radians.
        :param outer_cone_angle: of "spot": none beyond; in (inner, pi/2]; falloff as glTF defines it.
        """
        kind = LIGHT_TYPE.value(type)
        spot = type == "spot"
        return self._core.add_light(
            kind, to_vec3(intensity, "intensity", spread=True), to_vec3(position, "position"),
            (0.0, 0.0, 0.0) if type == "point" else to_vec3(direction, "direction"),
            to_number(inner_cone_angle, "inner_cone_angle") if spot else 0.0,
            to_number(outer_cone_angle, "outer_cone_angle") if spot else 0.0)

    def set_environment(self, radiance: Union[float, Vector] = (1, 1, 1), texture: int = 0) -> None:
        """Sets the radiance that comes from infinity.

        :param radiance: constant radiance, or the factor of the texture; three numbers or one.
        :param texture: lat-long radiance image; 0: constant. World direction (x, y, z) is looked up at
            u = atan2(x, -z) / (2 pi) mod 1, v = acos(y) / pi.
        """
        self._core.set_environment(to_vec3(radiance, "radiance", spread=True), to_count(texture, "texture"))

    def add_camera(self, transform: Any = None, *, position: Optional[Vector] = None,
                   target: Optional[Vector] = None, up: Vector = (0, 1, 0), yfov: float = math.pi / 4,
                   width: int = 0, height: int = 0, type: str = "perspective") -> int:
        """Adds a camera and returns its id, from 0.

        :param transform: camera to world, [3][4] or [4][4]; it looks along its -Z, +Y is up, scale is ignored.
        :param position, target, up: in place of transform, as for look_at().
        :param yfov: full vertical angle, radians.
        :param width, height: the image size in pixels that is meant; 0: not said.
        """
        if (position is None) != (target is None):
            raise InvalidArgument("position, target: give both or none")
        if position is not None and target is not None:
            if transform is not None:
                raise InvalidArgument("transform: give it, or position and target, not both")
            transform = look_at(position, target, up)
        return self._core.add_camera(CAMERA_TYPE.value(type), to_transform(transform), to_number(yfov, "yfov"),
                                     to_count(width, "width"), to_count(height, "height"))

    def camera(self, camera: int = 0) -> Camera:
        """Reads a camera back. Raises InvalidArgument if there is no such camera."""
        values = self._core.camera(to_count(camera, "camera"))
        return Camera(CAMERA_TYPE.name(values["type"]), np.array(values["transform"], np.float32).reshape(3, 4),
                      values["yfov"], values["width"], values["height"])

    # ---- commit ----

    def commit(self, accel: str = "auto", *, triangle_test: str = "watertight", max_depth: int = 0,
               traversal_cost: float = 0, empty_bonus: float = 0, patch_tolerance: float = 0,
               tree_cache: Optional[PathLike] = None, quality: str = "auto", patch_pixels: float = 0,
               patch_camera: int = 0, patch_width: int = 0, patch_height: int = 0) -> "Scene":
        """Builds the acceleration structure and returns the scene; what starts later sees it.

        :param accel: "auto" (CPU: embree, GPU: bvh), "kdtree" (the same bits on every device), "embree" (CPU
            alone) or "bvh" (2-wide; the same bits on every device).
        :param triangle_test: "watertight", "moller-trumbore" (leaks at edges) or "double" (not embree).
        :param max_depth: of a kd-tree, at most 48; 0: 8 + 1.3 log2 N.
        :param traversal_cost: of a kd-tree: a step in units of a triangle test; 0: the library's choice.
        :param empty_bonus: of a kd-tree: factor on the cost of splits that cut off empty space; 0: the library's.
        :param patch_tolerance: largest distance in metres of the world between a patch and its triangles; 0:
            1e-4 of the diagonal of the patches' bounds, or none with patch_pixels.
        :param tree_cache: file of a kd-tree: reused if it fits the scene, else written.
        :param quality: "fast" (GPU: large trees are built on the device, in milliseconds a million triangles; hits are the
            same, but by "moller-trumbore", by which a ray that grazes triangles may meet another one of them) or "high"
            (the tree that traces fastest, built on the host's threads); "auto": "high".
        :param patch_pixels: > 0: largest distance between a patch and its triangles in pixels of the picture of
            patch_camera, as far as it shows them directly: patches have fewer triangles the further away they are. With
            patch_tolerance too, the smaller one holds.
        :param patch_width, patch_height: of that picture; 0: what the camera says, else 512.

        A failed commit leaves the previous one in force; work in flight keeps the commit that it started with.
        Python's lock is released; Ctrl-C is noticed when the build is done.

        Raises InvalidArgument, OutOfMemory, Unsupported, FileError.
        """
        with self.device._log_errors():
            self._core.commit(ACCEL.value(accel), TRIANGLE_TEST.value(triangle_test), to_count(max_depth, "max_depth"),
                              to_number(traversal_cost, "traversal_cost"), to_number(empty_bonus, "empty_bonus"),
                              to_number(patch_tolerance, "patch_tolerance"), optional_path(tree_cache),
                              BUILD_QUALITY.value(quality), to_number(patch_pixels, "patch_pixels"),
                              to_count(patch_camera, "patch_camera"), to_count(patch_width, "patch_width"),
                              to_count(patch_height, "patch_height"))
        return self

    @property
    def facts(self) -> SceneFacts:
        """Counts and facts; before the first commit what the commit adds is zero."""
        values = self._core.facts()
        return SceneFacts(**{**values, "accel": ACCEL.name(values["accel"]),
                             "triangle_test": TRIANGLE_TEST.name(values["triangle_test"])})

    def export_tree(self, tree: int = 0) -> KdTree:
        """Copies a kd-tree of the last commit out.

        :param tree: 0: all geometries placed once, in world space; 1 + g: geometry g in object space.

        Raises InvalidArgument where there is no such tree.
        """
        index = to_count(tree, "tree")
        sizes = self._core.export_tree(index, None, None)
        nodes = np.empty(sizes["num_nodes"], kdtree_node_dtype)
        references = np.empty(sizes["num_references"], np.uint32)
        values = self._core.export_tree(index, nodes, references)
        return KdTree(nodes, references, values["num_triangles"], values["bounds_min"], values["bounds_max"], index)

    def import_tree(self, tree: KdTree) -> None:
        """Hands in a kd-tree that the next commits use in place of building one, until the geometry changes.

        Its triangles are numbered as export_tree's; every triangle must be in the leaves that it touches, else hits
        are lost: that alone cannot be checked. Raises InvalidArgument for a tree that is not sound.
        """
        nodes = np.asarray(tree.nodes)
        if nodes.dtype != kdtree_node_dtype or nodes.ndim != 1:
            raise InvalidArgument(f"tree.nodes: expected kdtree_node_dtype [n], got {nodes.dtype} "
                                  f"{shape_text(nodes.shape)}")
        references = to_uint32(as_array(tree.references, "tree.references"), "tree.references")
        if references.ndim != 1:
            raise InvalidArgument(f"tree.references: expected [n], got {shape_text(references.shape)}")
        self._core.import_tree(to_count(tree.tree, "tree.tree"), to_count(tree.num_triangles, "tree.num_triangles", 64),
                               to_vec3(tree.bounds_min, "tree.bounds_min"),
                               to_vec3(tree.bounds_max, "tree.bounds_max"),
                               np.ascontiguousarray(nodes), np.ascontiguousarray(references))

    # ---- queries ----

    @overload
    def trace(self, rays: Any = None, *, origins: Any = None, directions: Any = None, tmin: Any = None,
              tmax: Any = None, query: Literal["closest", "any"] = "closest", format: str = "full",
              out: Any = None, coherence: str = "auto") -> Any: ...

    @overload
    def trace(self, rays: Any = None, *, origins: Any = None, directions: Any = None, tmin: Any = None,
              tmax: Any = None, query: Literal["all"], format: str = "full",
              out: None = None, coherence: str = "auto") -> Tuple[Any, Any]: ...

    def trace(self, rays: Any = None, *, origins: Any = None, directions: Any = None, tmin: Any = None,
              tmax: Any = None, query: str = "closest", format: str = "full",
              out: Any = None, coherence: str = "auto") -> Any:
        """Traces a batch of rays on all threads of the device.

        :param rays: float32 [...][8] = ox oy oz tmin dx dy dz tmax. Read where they lie if C-contiguous float32, which
            rays on a GPU must be.
        :param origins, directions, tmin, tmax: in place of rays: [...][3], [...][3], [...], [...], broadcast
            against each other; tmin is 0 and tmax infinity if not given. Copied into one array.
        :param query: "closest": one hit a ray; of equal t the smaller (instance, primitive).
            "any": whether something is hit.
            "all": every crossing, sorted by (t, instance, primitive); the rays are traced twice, first to count.
        :param format: "full" (hit_dtype, 32 bytes) or "compact" (hit_compact_dtype, 16 bytes).
        :param out: C-contiguous array of the result's shape and type to write to, for "closest" and "any".
        :param coherence: whether neighbours among the rays go nearly the same way: "coherent", "incoherent", or "auto",
            which looks at some of them. It chooses kernels of a GPU and changes no bits. Coherent rays of shape
            [height][width][8] go by tiles of the image.

        Returns for "closest" an array of hits and for "any" of bool, shaped [...] as the rays; for "all" (hits,
        offsets): ray i, of the rays in order, has hits[offsets[i]:offsets[i + 1]].

        Results are of the rays' kind. Hits in numpy arrays are structured. For PyTorch, CuPy and JAX arrays they are
        gpurt.Hits of that library's arrays, on the same device; for other arrays on a GPU gpurt.DeviceArray. Closest
        and any hits of rays on a GPU are queued on the current stream of PyTorch or CuPy, or where the arrays' stream
        protocol says: the call returns at once, and nothing travels through host memory. Rays, scene and commit must
        stay as they are until that work is done.

        A miss has t = tmax and the ids INVALID_ID. Directions need not be of unit length, t is in their units; hits
        outside [tmin, tmax] do not count. Rays with a zero or non-finite direction, a non-finite origin or
        tmin > tmax miss. Python's lock is released; Ctrl-C is noticed every few million rays.

        Raises InvalidArgument, also for a scene that was never committed; OutOfMemory; DeviceError; Unsupported.
        """
        if rays is None:
            if origins is None or directions is None:
                raise InvalidArgument("rays: give them, or origins and directions")
            rays = make_rays(origins, directions, 0.0 if tmin is None else tmin, math.inf if tmax is None else tmax)
        elif not (origins is None and directions is None and tmin is None and tmax is None):
            raise InvalidArgument("rays: hold origins, directions, tmin and tmax already; give either")
        library = library_of(rays)
        with self.device._log_errors():
            if library is not None:
                return trace_foreign(self.device, self._core, library, rays, query, format, out, coherence)
            return trace(self._core, rays, query, format, out, coherence)

    def locate(self, hits: Any, *, geometry: int = 0, instance: int = 0, surface: bool = False) -> Any:
        """Finds the patches that hits lie on, and where on them.

        :param hits: what trace() gave of the last commit: an array of hit_dtype or hit_compact_dtype.
        :param geometry, instance: of compact hits, which do not say theirs; instance only with surface.
        :param surface: also the patch's own position and normal there, in the world.

        Returns an array of patch_point_dtype, shaped as hits: the patch of its geometry and u, v in [0, 1], u along columns of
        control points. A miss has the patch INVALID_ID. With surface (points, positions, normals), float32 [...][3].

        Raises InvalidArgument naming the first hit that is on a mesh or not of the last commit.
        """
        array = np.ascontiguousarray(hits) if isinstance(hits, np.ndarray) else None
        if array is None or array.dtype not in (hit_dtype, hit_compact_dtype):
            raise InvalidArgument("hits: expected a numpy array of hit_dtype or hit_compact_dtype, as trace() gives for "
                                  f"numpy rays, got {type(hits).__name__ if array is None else array.dtype}")
        shape = hits.shape
        points = np.empty(shape, patch_point_dtype)
        positions, normals = (np.empty((*shape, 3), np.float32) for _ in range(2)) if surface else (None, None)
        with self.device._log_errors():
            self._core.locate(HIT_FORMAT.value("full" if array.dtype == hit_dtype else "compact"), array,
                              to_count(geometry, "geometry"), to_count(instance, "instance"), points, positions, normals)
        return (points, positions, normals) if surface else points

    # ---- rendering ----

    def trace_photons(self, num_paths: int = 0, *, seed: int = 0, pass_index: int = 0, frame_index: int = 0,
                      max_depth: int = 0, radius: Optional[float] = None, levels: int = 1) -> PhotonMap:
        """Photons from the lights of the last commit, as photon mapping traces and keeps them, in a map on the device.

        Points are where a photon comes to a diffuse or rough surface, but for the first surface after the light. They have
        fluxes in watts, normals and directions; a sum of fluxes over a disc divided by its area is irradiance.

        :param num_paths: photons that leave the lights; 0: 1048576.
        :param pass_index: which of the passes of a frame; with a frame's seed, frame_index and max_depth, and its
            photons_per_pass for num_paths, the map holds the photons that the sample of this index gathers.
        :param max_depth: of paths from the eye, as for render(); 0: 17.
        :param radius: that queries will mostly have; None: one that holds about 50 points where they lie densely.
        :param levels: grids, each with cells 4 times larger than the one before.

        Raises InvalidArgument where nothing shines; OutOfMemory where fewer num_paths would fit.
        """
        return PhotonMap._trace(self, num_paths, seed, pass_index, frame_index, max_depth, radius, levels)

    def render(self, pipeline: str = "auto", *, width: int = 0, height: int = 0, spp: int = 0, error: float = 0,
               time: float = 0, seed: int = 0, camera: int = 0, outputs: Sequence[str] = ("color",),
               max_depth: int = 0, tile_size: int = 0, frame_index: int = 0, first_sample: int = 0,
               progress: Optional[Callable[[float, float], Any]] = None,
               photon: Optional[Mapping[str, Any]] = None,
               reyes: Optional[Mapping[str, Any]] = None) -> Image:
        """Renders a picture and waits for it.

        Parameters as for gpurt.Frame and Frame.submit. Ctrl-C, and an exception of progress, cancel the rendering.
        To keep what is done then, or to go on later, use a gpurt.Frame.
        """
        frame = Frame(self, width=width, height=height, camera=camera, outputs=outputs, seed=seed,
                      frame_index=frame_index, first_sample=first_sample)
        with frame.submit(pipeline, spp=spp, error=error, time=time, max_depth=max_depth, tile_size=tile_size,
                          progress=progress, photon=photon, reyes=reyes) as job:
            job.wait()
        return frame.image()

    def __repr__(self) -> str:
        f = self.facts
        state = f"committed for {f.accel}" if f.is_committed else "not committed"
        return (f"<gpurt.Scene {f.num_instances} instances of {f.num_geometries} geometries, {f.num_triangles} "
                f"triangles, {state}>")

    def __reduce__(self) -> NoReturn:
        refuse_pickling("gpurt.Scene", "send the path of its file, or the arrays that it is made of")


def load(path: PathLike, device: Optional[Device] = None) -> Scene:
    """Loads a scene from a glTF 2.0 file (.glb or .gltf), ready to commit.

    Reads meshes, node hierarchies with instancing kept, materials, textures, alpha masks, KHR_lights_punctual,
    cameras, the environment of the scene's `extras` and GPURT_bezier_patches. What has no exact counterpart is
    named in a warning through the device's log. Python's lock is released.

    Raises FileError, whose text names the file and its defect; OutOfMemory.
    """
    scene = Scene.__new__(Scene)
    scene.device = default_device() if device is None else device
    if not isinstance(scene.device, Device):
        raise TypeError(f"device: expected a gpurt.Device, got {type(device).__name__}")
    with scene.device._log_errors():
        scene._core = _core.Scene.load(scene.device._core, to_path(path))
    return scene
