"""Small scenes that tests make, and where the command-line tool is."""

from __future__ import annotations

import pathlib
import shutil
from typing import Any, List, Optional, Tuple

import numpy as np
import pytest

import gpurt


def quad(corner: Any, u: Any, v: Any) -> Tuple[np.ndarray, np.ndarray]:
    """A parallelogram whose front is the side from which u turns to v counter-clockwise."""
    corner, u, v = (np.asarray(x, np.float32) for x in (corner, u, v))
    return np.stack([corner, corner + u, corner + u + v, corner + v]), np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def box_quads() -> List[Tuple[str, Tuple[np.ndarray, np.ndarray]]]:
    """A room [-1, 1]^3 open towards +Z, with coloured side walls and a lamp under the ceiling."""
    return [
        ("white", quad((-1, -1, 1), (2, 0, 0), (0, 0, -2))),
        ("white", quad((-1, 1, -1), (2, 0, 0), (0, 0, 2))),
        ("white", quad((-1, -1, -1), (2, 0, 0), (0, 2, 0))),
        ("red", quad((-1, -1, 1), (0, 0, -2), (0, 2, 0))),
        ("green", quad((1, -1, -1), (0, 0, 2), (0, 2, 0))),
        ("lamp", quad((-0.4, 0.99, -0.4), (0.8, 0, 0), (0, 0, 0.8))),
    ]


MATERIALS = {"white": (0.8, 0.8, 0.8), "red": (0.8, 0.1, 0.1), "green": (0.1, 0.8, 0.1), "lamp": (0, 0, 0)}
LAMP_RADIANCE = (10.0, 9.0, 8.0)


def make_box(device: Optional[gpurt.Device] = None, accel: str = "auto", **commit: Any) -> gpurt.Scene:
    scene = gpurt.Scene(device)
    ids = {name: scene.add_material(base_color=color, emission=LAMP_RADIANCE if name == "lamp" else 0)
           for name, color in MATERIALS.items()}
    for name, (vertices, indices) in box_quads():
        scene.add_mesh(vertices, indices, material=ids[name])
    scene.add_camera(position=(0, 0, 3.4), target=(0, 0, 0), yfov=0.75, width=32, height=24)
    return scene.commit(accel, **commit)


def sphere(levels: int) -> Tuple[np.ndarray, np.ndarray]:
    """A closed unit sphere from an octahedron, 8 x 4^levels triangles, counter-clockwise from outside."""
    vertices = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    points = [np.array(v, float) for v in vertices]
    for _ in range(levels):
        middles: "dict[Tuple[int, int], int]" = {}

        def middle(a: int, b: int) -> int:
            key = (min(a, b), max(a, b))
            if key not in middles:
                middles[key] = len(points)
                p = points[a] + points[b]
                points.append(p / np.linalg.norm(p))
            return middles[key]

        split = []
        for a, b, c in faces:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            split += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = split
    return np.array(points, np.float32), np.array(faces, np.uint32)


def camera_rays(width: int, height: int) -> np.ndarray:
    """One ray through the centre of each pixel of the box's camera, float32 [h][w][8]."""
    k = np.tan(0.375)
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * k * width / height
    y = (1 - (np.arange(height) + 0.5) / height * 2) * k
    d = np.stack([*np.broadcast_arrays(x[None, :], y[:, None]), np.full((height, width), -1.0)], -1)
    return gpurt.make_rays((0, 0, 3.4), d)


@pytest.fixture(scope="session")
def device() -> gpurt.Device:
    return gpurt.Device("cpu", threads=2)


@pytest.fixture(scope="session")
def box(device: gpurt.Device) -> gpurt.Scene:
    """Shared by tests that do not change it; built for kdtree, whose bits are promised."""
    return make_box(device, "kdtree")


@pytest.fixture(scope="session")
def tool() -> pathlib.Path:
    """The command-line tool of the same build, or an installed one."""
    beside = pathlib.Path(gpurt.__file__).resolve().parents[2] / "bin" / "gpurt"
    found = str(beside) if beside.exists() else shutil.which("gpurt")
    if not found:
        pytest.skip("the command-line tool gpurt is neither beside the package nor on the PATH")
    return pathlib.Path(found)
