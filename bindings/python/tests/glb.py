"""Writes the box of conftest.py as a .glb file, so that the command-line tool can read it too."""

from __future__ import annotations

import json
import pathlib
import struct
from typing import Any, Dict, List

import conftest
import numpy as np


def write_box(path: pathlib.Path) -> pathlib.Path:
    blob = b""
    views: List[Dict[str, Any]] = []
    accessors: List[Dict[str, Any]] = []

    def add(array: np.ndarray, kind: str, component: int, **more: Any) -> int:
        nonlocal blob
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        blob += array.tobytes()
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": array.size
                          if kind == "SCALAR" else len(array), "type": kind, **more})
        return len(accessors) - 1

    names = list(conftest.MATERIALS)
    meshes, nodes = [], []
    for name, (vertices, indices) in conftest.box_quads():
        position = add(vertices, "VEC3", 5126, min=vertices.min(0).tolist(), max=vertices.max(0).tolist())
        meshes.append({"primitives": [{"attributes": {"POSITION": position},
                                       "indices": add(indices.reshape(-1), "SCALAR", 5125),
                                       "material": names.index(name)}]})
        nodes.append({"mesh": len(meshes) - 1})
    materials: List[Dict[str, Any]] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [*color, 1], "metallicFactor": 0, "roughnessFactor": 1},
         "doubleSided": name != "lamp", "extensions": {"KHR_materials_specular": {"specularFactor": 0}}}
        for name, color in conftest.MATERIALS.items()]
    strength = max(conftest.LAMP_RADIANCE)
    lamp = materials[names.index("lamp")]
    lamp["emissiveFactor"] = [c / strength for c in conftest.LAMP_RADIANCE]
    lamp["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
    nodes.append({"camera": 0, "translation": [0, 0, 3.4]})
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
        "meshes": meshes, "materials": materials, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.75, "znear": 0.01},
                     "extras": {"width": 32, "height": 24}}],
        "extensionsUsed": ["KHR_materials_specular", "KHR_materials_emissive_strength"],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(blob))
                     + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob)
    return path
