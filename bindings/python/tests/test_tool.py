"""The same bits as the command-line tool, which uses the C library without Python."""

import json
import subprocess

import glb
import numpy as np
import pytest

import gpurt


@pytest.fixture(scope="module")
def scene_path(tmp_path_factory):
    return glb.write_box(tmp_path_factory.mktemp("scene") / "box.glb")


def run(tool, *arguments):
    result = subprocess.run([tool, *map(str, arguments)], text=True, capture_output=True)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_hits(tool, device, scene_path, tmp_path):
    rng = np.random.default_rng(8)
    rays = gpurt.make_rays(rng.uniform(-1, 1, (5000, 3)), rng.normal(size=(5000, 3)))
    rays.tofile(tmp_path / "rays.bin")
    run(tool, "trace", scene_path, "--rays", tmp_path / "rays.bin", "-o", tmp_path / "hits.bin", "--device", "cpu",
        "--accel", "kdtree")
    hits = gpurt.load(scene_path, device).commit("kdtree").trace(rays)
    expected = np.fromfile(tmp_path / "hits.bin", gpurt.hit_dtype)
    assert (hits == expected).all()
    for name in ("t", "u", "v"):  # -0.0 == 0.0 above
        assert (hits[name].view(np.uint32) == expected[name].view(np.uint32)).all()


def test_pictures(tool, device, scene_path, tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    run(tool, "render", scene_path, "-o", tmp_path / "tool.exr", "--device", "cpu", "--accel", "kdtree", "--spp", 4,
        "--seed", 9, "--quiet", "--width", 40, "--height", 30, "--stats", tmp_path / "stats.json")
    image = gpurt.load(scene_path, device).commit("kdtree").render(width=40, height=30, spp=4, seed=9)
    image.save(tmp_path / "python.exr")
    tool_channels, python_channels = (
        {name: channel.pixels for name, channel in OpenEXR.File(str(tmp_path / file)).channels().items()}
        for file in ("tool.exr", "python.exr"))
    assert tool_channels.keys() == python_channels.keys()
    for name, pixels in tool_channels.items():
        assert pixels.tobytes() == python_channels[name].tobytes(), name
    from gpurt import metrics
    assert (metrics.read_exr(tmp_path / "tool.exr") == image.color).all()
    assert json.loads((tmp_path / "stats.json").read_text())
