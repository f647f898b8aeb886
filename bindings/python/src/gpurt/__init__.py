"""Casts rays at and renders 3D scenes, on any CPU and any CUDA GPU.

    import gpurt

    scene = gpurt.load("cornell.glb").commit()
    image = scene.render(spp=64)            # image.color: float32 [h][w][3]
    image.save("cornell.png")
    hits = scene.trace(origins=origins, directions=directions)
    ids, distances = gpurt.PhotonMap(points).nearest(places, 50)

Device, Scene, PhotonMap, Frame, Job and Image own what the C library gives out; errors are exceptions under gpurt.Error.
"""

import atexit as _atexit

from gpurt import _core
from gpurt._memory import DeviceArray
from gpurt._trace import hit_compact_dtype, hit_dtype, make_rays
from gpurt.device import Device, DeviceProperties, default_device, devices
from gpurt.errors import (Cancelled, DeviceError, Error, FileError, InternalError, InvalidArgument, OutOfMemory,
                          Timeout, Unsupported)
from gpurt.frame import Frame, Job, Statistics
from gpurt.hits import Hits
from gpurt.image import Image
from gpurt.photons import PhotonMap, PhotonMapInfo
from gpurt.scene import (INVALID_ID, Camera, KdTree, Placed, Scene, SceneFacts, kdtree_node_dtype, load, look_at,
                         patch_point_dtype)

__version__ = _core.version()

__all__ = [
    "INVALID_ID", "Camera", "Cancelled", "Device", "DeviceArray", "DeviceError", "DeviceProperties", "Error",
    "FileError", "Frame", "Hits", "Image", "InternalError", "InvalidArgument", "Job", "KdTree", "OutOfMemory", "PhotonMap", "PhotonMapInfo", "Placed", "Scene", "SceneFacts",
    "Statistics", "Timeout", "Unsupported", "default_device", "devices", "hit_compact_dtype", "hit_dtype",
    "kdtree_node_dtype", "load", "look_at", "make_rays", "patch_point_dtype",
]

# Before the interpreter ends: no callback may ask for its lock any more, and no job may run on.
_atexit.register(_core.stop)
