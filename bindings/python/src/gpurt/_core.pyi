# Private: use the package gpurt. Enumerations are the C library's numbers, arrays are as its header states.
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

from gpurt._arrays import Array
from gpurt._callbacks import Callback

def version() -> str: ...
def stop() -> None: ...
def devices() -> List[Dict[str, Any]]: ...

class Device:
    def __init__(
        self, type: int, ordinals: Sequence[int], num_threads: int, memory_limit: int, log: Optional[Callback]
    ) -> None: ...
    def properties(self) -> Dict[str, Any]: ...
    def order_streams(self, ordinal: int, stream: int, after: int) -> None: ...
    def wait_for_stream(self, ordinal: int, stream: int) -> None: ...

class BorrowedTensor:
    def __init__(self, capsule: Any) -> None: ...
    def data(self) -> int: ...
    def device(self) -> Tuple[int, int]: ...
    def dtype(self) -> Tuple[int, int, int]: ...
    def shape(self) -> Tuple[int, ...]: ...
    def strides(self) -> Optional[Tuple[int, ...]]: ...
    def read_only(self) -> bool: ...

def lend_tensor(
    owner: Any,
    data: int,
    shape: Sequence[int],
    dtype_code: int,
    dtype_bits: int,
    device_type: int,
    device_id: int,
    versioned: bool,
) -> Any: ...

class Buffer:
    def __init__(self, device: Device, in_device_memory: bool, size_bytes: int, data: int, owner: Any) -> None: ...
    def data(self) -> int: ...
    def read(self, offset_bytes: int, size_bytes: int) -> bytes: ...

Rows = Union[Array, Tuple[Buffer, int, int, int]]

class Scene:
    def __init__(self, device: Device) -> None: ...
    @staticmethod
    def load(device: Device, path: bytes) -> Scene: ...
    def add_texture(
        self, format: int, width: int, height: int, wrap_u: int, wrap_v: int, filter: int, texels: Array
    ) -> int: ...
    def add_material(
        self,
        type: int,
        base_color: Sequence[float],
        roughness: float,
        ior: float,
        alpha: float,
        alpha_cutoff: float,
        emission: Sequence[float],
        base_color_texture: int,
        two_sided_emission: bool,
        blends: bool,
        emission_texture: int,
        attenuation_color: Sequence[float],
        attenuation_distance: float,
    ) -> int: ...
    def add_mesh(
        self,
        vertices: Rows,
        indices: Optional[Rows],
        normals: Optional[Rows],
        uvs: Optional[Rows],
        material: int,
    ) -> int: ...
    def set_vertices(self, geometry: int, vertices: Rows, normals: Optional[Rows]) -> None: ...
    def add_patches(self, control_points: Array, material: int) -> int: ...
    def add_subdivision(
        self, vertices: Array, face_counts: Array, indices: Array, scheme: int, material: int
    ) -> int: ...
    def add_instance(self, geometry: int, transform: Sequence[float]) -> int: ...
    def add_light(
        self,
        type: int,
        intensity: Sequence[float],
        position: Sequence[float],
        direction: Sequence[float],
        inner_cone_angle: float,
        outer_cone_angle: float,
    ) -> int: ...
    def set_environment(self, radiance: Sequence[float], texture: int) -> None: ...
    def add_camera(self, type: int, transform: Sequence[float], yfov: float, width: int, height: int) -> int: ...
    def camera(self, camera: int) -> Dict[str, Any]: ...
    def commit(
        self,
        accel: int,
        triangle_test: int,
        max_depth: int,
        traversal_cost: float,
        empty_bonus: float,
        patch_tolerance: float,
        tree_cache: Optional[bytes],
        quality: int,
        patch_pixels: float,
        patch_camera: int,
        patch_width: int,
        patch_height: int,
    ) -> None: ...
    def facts(self) -> Dict[str, Any]: ...
    def export_tree(self, tree: int, nodes: Optional[Array], references: Optional[Array]) -> Dict[str, Any]: ...
    def import_tree(
        self,
        tree: int,
        num_triangles: int,
        bounds_min: Sequence[float],
        bounds_max: Sequence[float],
        nodes: Array,
        references: Array,
    ) -> None: ...
    def trace(
        self,
        query: int,
        format: int,
        rays: Array,
        hits: Optional[Array],
        occluded: Optional[Array],
        offsets: Optional[Array],
        coherence: int,
        image_width: int,
    ) -> None: ...
    def trace_memory(
        self,
        query: int,
        format: int,
        in_device_memory: bool,
        num_rays: int,
        rays: int,
        hits: int,
        hit_capacity: int,
        occluded: int,
        offsets: int,
        stream: Optional[int],
        coherence: int,
        image_width: int,
    ) -> None: ...

    def locate(
        self,
        format: int,
        hits: Array,
        geometry: int,
        instance: int,
        points: Array,
        positions: Optional[Array],
        normals: Optional[Array],
    ) -> None: ...

class PhotonMap:
    def __init__(
        self,
        device: Device,
        in_device_memory: bool,
        num_points: int,
        positions: int,
        fluxes: int,
        normals: int,
        radius: float,
        num_levels: int,
    ) -> None: ...
    @staticmethod
    def trace(
        scene: Scene,
        num_paths: int,
        seed: int,
        pass_index: int,
        frame_index: int,
        max_depth: int,
        radius: float,
        num_levels: int,
    ) -> PhotonMap: ...
    def read(self, attribute: int, data: int, size_bytes: int) -> None: ...
    @staticmethod
    def load(device: Device, path: bytes) -> PhotonMap: ...
    def save(self, path: bytes) -> None: ...
    def info(self) -> Dict[str, Any]: ...
    def query(
        self,
        kind: int,
        method: int,
        kernel: int,
        in_device_memory: bool,
        num_queries: int,
        positions: int,
        normals: int,
        min_cosine: float,
        radius: float,
        radius_hint: float,
        k: int,
        counts: int,
        sums: int,
        offsets: int,
        ids: int,
        distances: int,
        capacity: int,
        stream: Optional[int],
    ) -> None: ...

class Frame:
    def __init__(
        self,
        scene: Scene,
        width: int,
        height: int,
        camera: int,
        outputs: int,
        frame_index: int,
        seed: int,
        first_sample: int,
    ) -> None: ...
    def submit(
        self,
        pipeline: int,
        samples_per_pixel: int,
        target_error: float,
        time_limit: float,
        max_depth: int,
        tile_size: int,
        tiles: Optional[Array],
        progress: Optional[Callback],
        schedule: Sequence[int],
        photon: Tuple[int, float, int, int, int],
        reyes: Tuple[float, int, int, int, float, int],
    ) -> Job: ...
    def read(self, output: int, data: Array) -> None: ...
    def save(self, path: bytes) -> None: ...
    def merge(self, other: Frame) -> None: ...
    def load_state(self, path: bytes) -> None: ...
    def statistics(self) -> Dict[str, Any]: ...

class Job:
    def wait(self, timeout_ns: int) -> bool: ...
    def cancel(self) -> None: ...
    def progress(self) -> float: ...
