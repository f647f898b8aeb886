"""What is compared: a setting is a named way of rendering, one curve of the chart."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from gpurt.device import Device, DeviceProperties

Keys = Mapping[str, Callable[[Any], Any]]


def flag(text: str) -> bool:
    """"0" or "1"."""
    return bool(int(text))


def names(text: str) -> Tuple[str, ...]:
    """"normal+side"; "none" for none of them."""
    return () if text == "none" else tuple(text.split("+"))


# Where each key goes, and what makes a value of its text.
DEVICE_KEYS: Keys = {"device": str, "threads": int}
COMMIT_KEYS: Keys = {"accel": str, "triangle_test": str, "patch_tolerance": float, "patch_pixels": float, "traversal_cost": float,
               "empty_bonus": float, "tree_cache": str}
RENDER_KEYS: Keys = {"pipeline": str, "max_depth": int, "tile_size": int}
# Of these two pipelines; the names are those that Frame.submit takes.
PHOTON_KEYS: Keys = {"photons_per_pass": int, "initial_radius": float, "estimator": str, "kernel": str,
                     "remedies": names}
REYES_KEYS: Keys = {"shading_rate": float, "filter": str, "shading": str, "shadows": flag,
                    "flatness": float}
KNOWN_KEYS: Tuple[Keys, Keys, Keys, Keys, Keys] = (DEVICE_KEYS, COMMIT_KEYS, RENDER_KEYS, PHOTON_KEYS, REYES_KEYS)
KEY_NAMES = ", ".join(key for known in KNOWN_KEYS for key in known)


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
    groups: List[Dict[str, Any]] = [{"device": device}, {}, {}, {}, {}]
    for key, value in values.items():
        for group, known in zip(groups, KNOWN_KEYS):
            if key in known:
                group[key] = known[key](value)
                break
        else:
            raise ValueError(f"unknown key {key!r}; known: {KEY_NAMES}")
    on, commit, render, photon, reyes = groups
    if photon:
        render["photon"] = photon
    if reyes:
        render["reyes"] = reyes
    return Setting(name, on, commit, render)


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
    """Path tracing and photon mapping on the CPU, and on the first GPU if there is one."""
    kind, _, ordinal = wanted.partition(":")
    gpu: Optional[DeviceProperties] = next(
        (d for d in devices if d.type == "cuda" and d.ordinal == int(ordinal or 0)), None)
    settings = []
    if kind in ("auto", "cpu"):
        settings += [make_setting(f"path, {accel}, CPU", {"pipeline": "path", "accel": accel}, "cpu")
                     for accel in ("embree", "kdtree")]
        settings.append(make_setting("photon, CPU", {"pipeline": "photon"}, "cpu"))
    if kind == "cuda" or (kind == "auto" and gpu):
        name = f"cuda:{ordinal or 0}"
        settings += [make_setting(f"{pipeline}, GPU", {"pipeline": pipeline}, name) for pipeline in ("path", "photon")]
    return settings
