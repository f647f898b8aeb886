"""What is compared: a setting is a named way of rendering, one curve of the chart."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any, Dict, List, Optional

from gpurt.device import Device, DeviceProperties

# Where each key goes, and what makes a value of its text.
DEVICE_KEYS = {"device": str, "threads": int}
COMMIT_KEYS = {"accel": str, "triangle_test": str, "patch_tolerance": float, "traversal_cost": float,
               "empty_bonus": float, "tree_cache": str}
RENDER_KEYS = {"pipeline": str, "max_depth": int, "tile_size": int}


@dataclasses.dataclass(frozen=True)
class Setting:
    name: str
    device: Dict[str, Any]
    commit: Dict[str, Any]
    render: Dict[str, Any]

    def make_device(self) -> Device:
        kind, _, ordinal = self.device.get("device", "auto").partition(":")
        return Device(kind, int(ordinal or 0), threads=self.device.get("threads", 0))


def make_setting(name: str, values: Dict[str, Any], device: str = "auto") -> Setting:
    groups: List[Dict[str, Any]] = [{"device": device}, {}, {}]
    for key, value in values.items():
        for group, known in zip(groups, (DEVICE_KEYS, COMMIT_KEYS, RENDER_KEYS)):
            if key in known:
                group[key] = known[key](value)
                break
        else:
            raise ValueError(f"unknown key {key!r}; known: {', '.join([*DEVICE_KEYS, *COMMIT_KEYS, *RENDER_KEYS])}")
    return Setting(name, *groups)


def parse_setting(text: str) -> Setting:
    """NAME:key=value,key=value"""
    name, _, rest = text.partition(":")
    if not name:
        raise argparse.ArgumentTypeError(f"{text!r}: expected NAME:key=value,...")
    values = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if not equals:
            raise argparse.ArgumentTypeError(f"{text!r}: {part!r} is no key=value")
        values[key.strip()] = value.strip()
    try:
        return make_setting(name, values)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}") from None


def default_settings(devices: List[DeviceProperties], wanted: str) -> List[Setting]:
    """Path tracing with every accelerator of the CPU, and of the first GPU if there is one."""
    kind, _, ordinal = wanted.partition(":")
    gpu: Optional[DeviceProperties] = next(
        (d for d in devices if d.type == "cuda" and d.ordinal == int(ordinal or 0)), None)
    settings = []
    if kind in ("auto", "cpu"):
        settings += [make_setting(f"path, {accel}, CPU", {"pipeline": "path", "accel": accel}, "cpu")
                     for accel in ("embree", "kdtree")]
    if kind == "cuda" or (kind == "auto" and gpu):
        name = f"cuda:{ordinal or 0}"
        settings.append(make_setting("path, kdtree, GPU", {"pipeline": "path", "accel": "kdtree"}, name))
    return settings
