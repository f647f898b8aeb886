"""Errors and charts."""

import csv
import dataclasses
import json
import re
import subprocess
import sys

import glb
import numpy as np
import pytest

import gpurt
from gpurt import metrics


def test_relmse_of_known_pictures():
    reference = np.full((10, 10, 3), 0.5, np.float32)
    test = reference.copy()
    assert metrics.relmse(test, reference) == 0
    test[0, 0] = 1.5
    one = 1.0 / (0.25 + 0.01)
    assert metrics.relmse(test, reference) == pytest.approx(one / 100)
    assert metrics.trimmed(test, reference, trim=0.01) == 0
    assert metrics.trimmed(test, reference, trim=0) == pytest.approx(one / 100)
    assert metrics.bias(test, reference) == pytest.approx(0.01 / 0.5)
    assert metrics.relmse(test, reference, noise=one / 200) == pytest.approx(one / 200)


def test_trimming_rounds_up_to_whole_pixels():
    errors = np.arange(1500, dtype=np.float64)
    assert metrics.trimmed_mean(errors, 0.001) == errors[:1498].mean()
    assert metrics.trimmed_mean(errors[:1], 0.5) == 0
    with pytest.raises(gpurt.InvalidArgument, match="trim"):
        metrics.trimmed_mean(errors, 1)


def test_pictures_that_cannot_be_compared():
    black = np.zeros((4, 6, 3))
    with pytest.raises(gpurt.InvalidArgument, match="test: is 6x4, the reference is 4x4"):
        metrics.relmse(black, black[:, :4])
    broken = black.copy()
    broken[1, 2, 0] = np.nan
    with pytest.raises(gpurt.InvalidArgument, match="test: 1 pixels are not finite, the first at x=2 y=1"):
        metrics.compare(broken, black)
    assert np.isnan(metrics.bias(black, black))


def test_files_that_cannot_be_read(tmp_path):
    pytest.importorskip("OpenEXR")
    with pytest.raises(gpurt.FileError, match="no such file"):
        metrics.read_exr(tmp_path / "none.exr")
    (tmp_path / "bad.exr").write_bytes(b"not a picture")
    with pytest.raises(gpurt.FileError, match="bad.exr"):
        metrics.read_exr(tmp_path / "bad.exr")


def make_curve(name, build, seconds_per_sample, error, slope, count=8):
    from gpurt.chart.measure import Curve, Run, Sample
    from gpurt.chart.settings import make_setting
    samples = [Sample(2 ** k, 2 ** k * seconds_per_sample, 1.5 * error * (2 ** k) ** slope,
                      error * (2 ** k) ** slope, 0.0) for k in range(count)]
    resolved = {k: name for k in ("pipeline", "accel", "triangle_test", "reason")}
    resolved.update({k: 1 for k in ("max_depth", "tile_size", "num_threads", "width", "height")})
    return Curve(make_setting(name, {}), [Run(1, 0.0, build, samples)] * 3, gpurt.devices()[0], resolved)


def test_slopes_fronts_and_tables():
    from gpurt.chart import analyse
    fast = analyse.summarise(make_curve("fast", 0.0, 0.01, 1.0, -1.0))
    slow_build = analyse.summarise(make_curve("slow build", 1.0, 0.001, 1.0, -1.0))
    biased = analyse.summarise(make_curve("biased", 0.0, 0.02, 0.8, -2 / 3))
    results = [fast, slow_build, biased]
    for result, slope in zip(results, (-1, -1, -2 / 3)):
        fit = result.fits["trimmed"]
        assert fit.slope == pytest.approx(slope) and fit.slope_error == pytest.approx(0, abs=1e-9)
    assert fast.fits["trimmed"].at_one_second == pytest.approx(0.01)

    # 1 / (100 t) falls below everything that the slow build has reached after its second and a little.
    assert analyse.error_at(fast, 0.5, "trimmed") == pytest.approx(0.02)
    assert analyse.seconds_to(fast, 0.02, "trimmed") == pytest.approx(0.5)
    assert analyse.error_at(fast, 50, "trimmed") is None and analyse.seconds_to(fast, 1e-9, "trimmed") is None
    front = analyse.pareto_front(results, "trimmed")
    assert [e for _, e, _ in front] == sorted((e for _, e, _ in front), reverse=True)
    assert [t for t, _, _ in front] == sorted(t for t, _, _ in front)
    # Biased starts 2.5 % above fast's doubled samples and never catches up; the slow build wins after its second.
    assert {n for _, _, n in front} == {"fast", "slow build"}
    tables = analyse.tables(results)
    for row in tables["equal_time"]:
        assert sum(v["trimmed"] is not None for v in row["errors"].values()) >= 2
    assert tables["equal_time"] and tables["equal_error"]["trimmed"]
    assert analyse.picture_seconds(results) == pytest.approx(1.128)


def test_crossings():
    from gpurt.chart import analyse
    from gpurt.chart.report import crossing_text
    # 0.01 / t against 0.004 t^(-1/2) over times from 0.01: equal at t = 6.25.
    path = analyse.summarise(make_curve("path", 0.0, 0.01, 1.0, -1.0, count=12))
    blurred = analyse.summarise(make_curve("photon", 0.0, 0.01, 0.04, -0.5, count=12))
    for results in ([path, blurred], [blurred, path]):
        crossing, = analyse.crossings(results, "trimmed")
        assert (crossing.below, crossing.above) == ("path", "photon")
        assert crossing.seconds == pytest.approx(6.25) and crossing.error == pytest.approx(0.0016)
    assert crossing_text(crossing) == "from 6.25 s on, at 1.60e-3, path has less error than photon"
    short = [dataclasses.replace(r, points=r.points[:6]) for r in (path, blurred)]
    crossing, = analyse.crossings(short, "trimmed")
    assert not crossing.measured and crossing.seconds == pytest.approx(6.25) and crossing.below == "path"
    assert "by their slopes, from about 6.25 s on" in crossing_text(crossing)
    ahead = analyse.summarise(make_curve("photon", 0.0, 0.01, 0.5, -1.0, count=12))
    assert analyse.crossings([path, ahead], "trimmed") == []
    # Accelerators of one pipeline on one device are not compared: noise would cross them.
    assert analyse.crossings([path, dataclasses.replace(path, name="again", points=blurred.points, fits=blurred.fits)], "trimmed") == []


def test_one_point_has_no_slope_and_noise_below_zero_is_left_out():
    from gpurt.chart import analyse
    assert analyse.summarise(make_curve("one", 0, 1, 1, -1, count=1)).fits["relmse"] is None
    assert analyse.fit([(1, 0.1), (2, -0.1), (4, 0)]) is None


def test_labels_do_not_overlap():
    from gpurt.chart.draw import spread_labels
    heights = [0.5, 0.51, 0.52, 0.1, 0.9, 0.53]
    placed = spread_labels(heights, 0.1)
    ordered = sorted(placed)
    assert all(b - a > 0.1 - 1e-9 for a, b in zip(ordered, ordered[1:]))
    assert np.argsort(placed).tolist() == np.argsort(heights).tolist()
    assert placed[3] == 0.1 and placed[4] == 0.9


def test_settings_are_parsed():
    import argparse

    from gpurt.chart.settings import default_settings, parse_setting
    s = parse_setting("my name:accel=kdtree,max_depth=3,device=cpu,pipeline=path,threads=2")
    assert (s.name, s.commit, s.render) == ("my name", {"accel": "kdtree"}, {"max_depth": 3, "pipeline": "path"})
    assert s.device == {"device": "cpu", "threads": 2}
    s = parse_setting("few:pipeline=photon,photons_per_pass=4096,initial_radius=0.5,kernel=cone")
    assert s.render == {"pipeline": "photon", "photon": {"photons_per_pass": 4096, "initial_radius": 0.5, "kernel": "cone"}}
    s = parse_setting("leaky:pipeline=photon,estimator=per_pixel,remedies=normal+side")
    assert s.render == {"pipeline": "photon", "photon": {"estimator": "per_pixel", "remedies": ("normal", "side")}}
    assert parse_setting("bare:remedies=none").render["photon"] == {"remedies": ()}
    s = parse_setting("coarse:pipeline=reyes,shading_rate=4,shadows=0,flatness=0.25")
    assert s.render == {"pipeline": "reyes", "reyes": {"shading_rate": 4.0, "shadows": False, "flatness": 0.25}}
    for wrong in (":accel=kdtree", "a:accel", "a:colour=red", "a:max_depth=many"):
        with pytest.raises(argparse.ArgumentTypeError, match=re.escape(wrong)):
            parse_setting(wrong)
    cpu = gpurt.devices()[0]
    gpu = gpurt.DeviceProperties("cuda", 0, 1, 0, 0, 0, 0, 90, "GPU", "sm_90")
    on_cpu = ["path, embree, CPU", "path, kdtree, CPU", "photon, CPU"]
    assert [s.name for s in default_settings([cpu], "auto")] == on_cpu
    assert [s.name for s in default_settings([cpu, gpu], "auto")] == [*on_cpu, "path, GPU", "photon, GPU"]
    assert [s.device["device"] for s in default_settings([cpu, gpu], "cuda")] == ["cuda:0"] * 2
    assert [s.name for s in default_settings([cpu, gpu], "cpu")] == on_cpu


def test_reference_noise(tmp_path):
    from gpurt.chart.__main__ import parse_noise
    (tmp_path / "references.json").write_text('{"box": {"relmse": 2e-5, "relmse_trimmed": 1e-5}}')
    noise = parse_noise(str(tmp_path / "references.json"), "some/box.exr")
    assert (noise.relmse, noise.trimmed) == (2e-5, 1e-5)
    assert parse_noise("3e-5", "x").trimmed == 3e-5 and parse_noise("3e-5,2e-5", "x").trimmed == 2e-5
    for wrong in ("-1", "1,2,3", "much", str(tmp_path / "references.json")):
        with pytest.raises(ValueError):
            parse_noise(wrong, "other.exr")


def test_a_chart(tmp_path):
    """From the command line, of a small picture: every file is there and tells the same."""
    pytest.importorskip("matplotlib")
    pytest.importorskip("OpenEXR")
    scene = glb.write_box(tmp_path / "box.glb")
    gpurt.load(scene, gpurt.Device("cpu")).commit().render(width=32, height=24, spp=512, seed=99).save(
        tmp_path / "box.exr")
    out = tmp_path / "chart"
    result = subprocess.run(
        [sys.executable, "-m", "gpurt.chart", scene, "--reference", tmp_path / "box.exr", "-o", out, "--device", "cpu",
         "--seconds", "2", "--max-spp", "16", "--repeats", "3"], text=True, capture_output=True)
    assert result.returncode == 0, result.stderr
    assert "slope" in result.stdout

    document = json.loads((out / "chart.json").read_text())
    assert [s["name"] for s in document["settings"]] == ["path, embree, CPU", "path, kdtree, CPU", "photon, CPU"]
    assert set(document["crossings"]) == {"relmse", "trimmed"}
    for setting in document["settings"][:2]:
        assert [p["spp"] for p in setting["points"]] == [1, 2, 4, 8, 16]
        assert len(setting["runs"]) == 3 and len({r["seed"] for r in setting["runs"]}) == 3
        errors = [p["trimmed"]["median"] for p in setting["points"]]
        # Error falls as 1 / spp: a sixteenth, within a factor of 2 for the noise of 768 pixels.
        assert 1 / 32 < errors[-1] / errors[0] < 1 / 8
        assert all(p["seconds"] >= p["render_seconds"] + setting["build_seconds"] for p in setting["points"])
        assert all(p["trimmed"]["low"] <= p["trimmed"]["median"] <= p["trimmed"]["high"] for p in setting["points"])
    with open(out / "chart.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 10 + len(document["settings"][2]["points"]) and {r["accel"] for r in rows} == {"embree", "kdtree"}
    assert float(rows[0]["relmse"]) == document["settings"][0]["points"][0]["relmse"]["median"]
    assert any(r["pareto_trimmed"] == "1" for r in rows)
    assert (out / "chart.png").read_bytes()[:4] == b"\x89PNG"
    assert "path, kdtree, CPU" in (out / "chart.svg").read_text()
    page = (out / "index.html").read_text()
    assert page.count("data:image/png;base64,") == 1 + 3 + 3 and "<svg" in page and "<?xml" not in page
    assert not re.search(r'(src|href)="(?!data:|#)', page), "the page needs no other file"
    assert len(document["pictures"]) == 3


def test_failures_are_one_line(tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("OpenEXR")

    def run(*arguments):
        return subprocess.run([sys.executable, "-m", "gpurt.chart", *arguments], text=True, capture_output=True)

    result = run("none.glb", "--reference", "none.exr", "-o", str(tmp_path))
    assert result.returncode == 1 and result.stderr == "error: none.exr: no such file\n"
    assert run("none.glb").returncode == 2
    code = ("import sys, runpy; sys.modules['matplotlib'] = None; sys.argv[1:] = ['a.glb', '--reference', 'r', '-o', "
            "'d']; runpy.run_module('gpurt.chart', run_name='__main__')")
    missing = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
    assert missing.returncode == 1 and "pip install 'gpurt[chart]'" in missing.stderr
