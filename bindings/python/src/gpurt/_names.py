"""The C library's enumerations by name."""

from __future__ import annotations

from typing import Any

from gpurt.errors import InvalidArgument


class Names:
    """The members of one enumeration, in the order of their values from 0."""

    def __init__(self, argument: str, *names: str) -> None:
        self.argument = argument
        self.names = names

    def value(self, name: Any, argument: str = "") -> int:
        if isinstance(name, str) and name in self.names:
            return self.names.index(name)
        raise InvalidArgument(f"{argument or self.argument}: {name!r} is none of {', '.join(map(repr, self.names))}")

    def name(self, value: int) -> str:
        return self.names[value] if 0 <= value < len(self.names) else f"unknown ({value})"


DEVICE_TYPE = Names("type", "auto", "cpu", "cuda")
LOG_LEVEL = Names("level", "none", "error", "warning", "info")
WRAP = Names("wrap", "repeat", "clamp", "mirror")
FILTER = Names("filter", "linear", "nearest")
MATERIAL_TYPE = Names("type", "lambert", "mirror", "glass", "metal")
SUBDIVISION_SCHEME = Names("scheme", "catmull-clark", "loop")
LIGHT_TYPE = Names("type", "point", "spot", "distant")
CAMERA_TYPE = Names("type", "perspective", "orthographic")
ACCEL = Names("accel", "auto", "kdtree", "embree", "bvh")
BUILD_QUALITY = Names("quality", "auto", "fast", "high")
TRIANGLE_TEST = Names("triangle_test", "watertight", "moller-trumbore", "double")
QUERY = Names("query", "closest", "any", "all")
PHOTON_QUERY = Names("query", "count", "sum", "list", "nearest")
PHOTON_ATTRIBUTE = Names("attribute", "position", "flux", "normal", "direction")
GATHER_KERNEL = Names("kernel", "constant", "cone", "quadratic")
GATHER_METHOD = Names("method", "grid", "node_lists")
COHERENCE = Names("coherence", "auto", "coherent", "incoherent")
HIT_FORMAT = Names("format", "full", "compact")
OUTPUT = Names("outputs", "color", "alpha", "depth", "normal", "albedo", "position", "primitive", "instance",
               "sample_count", "variance", "time", "bias", "error")
SCHEDULE = {
    "traversal": Names("traversal", "auto", "stack", "leaf_lists", "uber"),
    "launch": Names("launch", "auto", "regular", "persistent", "rounds"),
    "fetch": Names("fetch", "auto", "per_thread", "packets"),
    "compaction": Names("compaction", "auto", "block_scan", "pyramid", "naive_scan", "library_scan"),
    "shading": Names("shading", "auto", "immediate", "sorted"),
    "generation": Names("generation", "auto", "slots", "counted", "refilled"),
}
PHOTON_ESTIMATOR = Names("estimator", "auto", "memoryless", "per_pixel", "adaptive")
PHOTON_KERNEL = Names("kernel", "auto", "constant", "cone")
PHOTON_REMEDY = Names("remedies", "normal", "plane", "side", "boundary", "continue")
REYES_FILTER = Names("filter", "auto", "box", "gaussian", "mitchell")
REYES_SHADING = Names("shading", "auto", "samples", "micropolygons", "blocks")
PIPELINE = Names("pipeline", "auto", "path", "photon", "reyes", "hybrid")
