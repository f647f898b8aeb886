"""Rendering: frames, jobs, images, files, merging."""

import os
import threading
import time

import numpy as np
import pytest
from conftest import camera_rays, make_box

import gpurt

OUTPUTS = ("color", "alpha", "depth", "normal", "albedo", "position", "primitive", "instance", "sample_count",
           "variance")


def long_job(scene, **more):
    """Minutes of work."""
    frame = gpurt.Frame(scene, width=512, height=512)
    return frame.submit(spp=20000, **more)


def test_an_image_has_what_was_asked_for(box):
    image = box.render(width=16, height=12, spp=4, outputs=OUTPUTS)
    assert set(image.outputs) == set(OUTPUTS)
    for name in OUTPUTS:
        array = getattr(image, name)
        channels = (3,) if name in ("color", "normal", "albedo", "position", "variance") else ()
        assert array.shape == (12, 16, *channels)
        assert array.dtype == (np.uint32 if name in ("primitive", "instance", "sample_count") else np.float32)
        assert array is image[name]
    assert (image.sample_count == 4).all()
    assert image.color.max() > 0.1 and np.isfinite(image.color).all()
    assert image.alpha[6, 8] == 1
    assert (image.width, image.height) == (16, 12)
    assert np.asarray(image).shape == (12, 16, 3) and np.asarray(image, np.float64).dtype == np.float64
    assert np.mean(image) == image.color.mean()
    with pytest.raises(KeyError, match="depth"):
        box.render(width=4, height=4, spp=1).depth


def test_first_hits_are_what_rays_hit(box):
    """The first sample of a pixel lies within it: where a 3x3 neighbourhood of centres agrees, so does the sample."""
    width, height = 64, 48
    image = box.render(width=width, height=height, spp=1, outputs=("instance", "depth"))
    hits = box.trace(camera_rays(width, height))
    same = np.zeros((height, width), bool)
    inner = np.stack([hits["instance"][1 + y:height - 1 + y, 1 + x:width - 1 + x] for y in (-1, 0, 1)
                      for x in (-1, 0, 1)])
    same[1:-1, 1:-1] = (inner == inner[0]).all(0)
    assert same.mean() > 0.5
    assert (image.instance[same] == hits["instance"][same]).all()
    # The back wall is a plane at a fixed depth; the rays' directions have z = -1, so their t is that depth.
    wall = same & (hits["instance"] == 2)
    assert np.allclose(image.depth[wall], hits["t"][wall], rtol=1e-5)


def test_sizes_come_from_the_camera_or_512(device, box):
    assert box.render(spp=1).color.shape == (24, 32, 3)
    scene = gpurt.Scene(device)
    scene.add_camera()
    frame = gpurt.Frame(scene.commit())
    assert (frame.width, frame.height) == (512, 512)


def test_schedules_are_resolved_and_refused_by_name(box):
    plain = {"traversal": "stack", "launch": "regular", "generation": "slots"}
    image = box.render(width=8, height=8, spp=1)
    with gpurt.Frame(box, width=8, height=8).submit(spp=1, schedule=plain) as job:
        job.wait()
        statistics = job.frame.statistics
    assert statistics.schedule.items() >= plain.items() and "auto" not in statistics.schedule.values()
    assert statistics.schedule == image.statistics.schedule
    assert not any(statistics.schedule_counters.values())
    assert (job.frame.read("color") == image.color).all()
    for schedule, text in (({"fetch": "photons"}, "fetch: 'photons' is none of 'auto', 'per_thread', 'packets'"),
                           ({"stack": True}, "schedule: 'stack' is none of 'traversal'"),
                           ({"ray_budget": -1}, "ray_budget")):
        with pytest.raises(gpurt.InvalidArgument, match=text):
            gpurt.Frame(box, width=8, height=8).submit(spp=1, schedule=schedule)
    if box.device.properties.type == "cpu":
        with pytest.raises(gpurt.Unsupported, match="schedule.traversal"):
            gpurt.Frame(box, width=8, height=8).submit(spp=1, schedule={"traversal": "uber"})


def test_statistics_tell_what_happened(box):
    s = box.render("path", width=20, height=10, spp=3, seed=7, max_depth=5, tile_size=8).statistics
    assert (s.pipeline, s.accel, s.triangle_test, s.max_depth, s.tile_size) == ("path", "kdtree", "watertight", 5, 8)
    assert (s.width, s.height, s.seed, s.samples_per_pixel) == (20, 10, 7, 3)
    assert s.num_samples == 600 == s.num_camera_rays
    assert s.num_bounce_rays > 0 and s.num_shadow_rays > 0 and s.num_nonfinite == 0 and s.num_saturated == 0
    assert s.render_seconds > 0 and s.largest_sample > 0 and s.reason


def test_seeds_and_frames_differ_and_repeat(box):
    def render(**more):
        return box.render(width=16, height=16, spp=2, **more).color

    assert (render(seed=1) == render(seed=1)).all()
    assert (render(seed=1) != render(seed=2)).any()
    assert (render(frame_index=1) != render(frame_index=2)).any()


def test_any_way_of_cutting_the_work_gives_the_same_bits(device, box, tmp_path):
    size = {"width": 24, "height": 16, "seed": 3}
    expected = box.render(**size, spp=8).color

    frame = gpurt.Frame(box, **size)
    for spp in (1, 3, 8):
        frame.submit(spp=spp).wait()
    assert (frame.read() == expected).all(), "continued"

    frame = gpurt.Frame(box, **size)
    for tiles in ([(12, 0, 24, 16)], np.array([(0, 0, 12, 5), (0, 5, 12, 16)], np.int64)):
        frame.submit(spp=8, tiles=tiles).wait()
    assert (frame.image().color == expected).all(), "in tiles"

    first = gpurt.Frame(box, **size)
    second = gpurt.Frame(box, **size, first_sample=5)
    first.submit(spp=5).wait()
    second.submit(spp=3).wait()
    second.save(tmp_path / "second.gpurt")
    third = gpurt.Frame(box, **size, first_sample=5)
    third.load_state(tmp_path / "second.gpurt")
    assert (third.read() == second.read()).all(), "loaded"
    first.merge(third)
    assert (first.read() == expected).all(), "merged"
    assert (first.read("sample_count") == 8).all()
    with pytest.raises(gpurt.InvalidArgument):
        first.merge(second)
    with pytest.raises(gpurt.InvalidArgument):
        first.merge(gpurt.Frame(box, width=7, height=7))
    assert (first.read() == expected).all(), "a failed merge changes nothing"


def test_targets_of_error_and_time(box):
    image = box.render(width=32, height=24, error=0.05)
    assert 0 <= image.statistics.estimated_error <= 0.05
    start = time.perf_counter()
    s = box.render(width=32, height=24, time=0.3).statistics
    assert time.perf_counter() - start < 3 and s.samples_per_pixel > 0


def test_files(box, tmp_path):
    image = box.render(width=16, height=12, spp=2, outputs=("depth",))
    for name in ("a.exr", "a.png", "a.gpurt"):
        image.save(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 0
    image.save(str(tmp_path / "b.png"))
    image.save(os.fsencode(tmp_path / "c.png"))
    assert image._repr_png_() == (tmp_path / "a.png").read_bytes()
    assert image._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    with pytest.raises(gpurt.InvalidArgument, match="jpg"):
        image.save(tmp_path / "a.jpg")
    with pytest.raises(gpurt.FileError):
        image.save(tmp_path / "missing" / "a.png")
    with pytest.raises(gpurt.FileError):
        gpurt.Frame(box).load_state(tmp_path / "a.png")
    OpenEXR = pytest.importorskip("OpenEXR")
    assert OpenEXR.File(str(tmp_path / "a.exr")).channels()
    from gpurt import metrics
    assert (metrics.read_exr(tmp_path / "a.exr") == image.color).all()


def test_png_is_tonemapped_as_stated(box, tmp_path):
    Image = pytest.importorskip("PIL.Image")
    from gpurt import metrics
    image = box.render(width=16, height=12, spp=2)
    image.save(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as file:
        pixels = np.asarray(file.convert("RGB"))
    # Two implementations of the curve round alike but where a value lies within rounding of the middle.
    assert np.abs(pixels.astype(int) - metrics.tonemap(image.color)).max() <= 1


def test_progress_goes_up_to_all(box):
    calls = []
    threads = set()

    def progress(done, total):
        calls.append((done, total))
        threads.add(threading.get_ident())

    image = box.render(width=128, height=96, spp=64, progress=progress)
    assert calls and calls[-1][0] == calls[-1][1] == image.statistics.num_samples
    assert all(a[0] <= b[0] for a, b in zip(calls, calls[1:]))
    assert threading.get_ident() not in threads


def test_a_job_tells_how_far_it_is(box):
    job = long_job(box)
    assert not job.done and 0 <= job.progress < 1
    with pytest.raises(gpurt.Timeout) as caught:
        job.wait(0.05)
    assert isinstance(caught.value, TimeoutError)
    assert not job.done, "a timeout does not end the job"
    job.cancel()
    start = time.perf_counter()
    with pytest.raises(gpurt.Cancelled):
        job.wait()
    assert time.perf_counter() - start < 1  # half a second is promised, on a busy machine
    assert job.done
    with pytest.raises(gpurt.Cancelled):
        job.wait(0)
    quick = gpurt.Frame(box, width=8, height=8).submit(spp=1)
    quick.wait(60)
    assert quick.done and quick.progress == 1


def test_a_cancelled_frame_goes_on_where_it_was(box):
    size = {"width": 64, "height": 64, "seed": 1}
    frame = gpurt.Frame(box, **size)
    job = frame.submit(spp=20000)
    while frame.statistics.num_samples == 0:
        time.sleep(0.01)
    job.cancel()
    with pytest.raises(gpurt.Cancelled):
        job.wait()
    reached = int(frame.read("sample_count").max())
    assert 0 < reached < 20000
    frame.submit(spp=reached).wait()
    assert (frame.read() == box.render(**size, spp=reached).color).all()


def test_jobs_as_context_managers(box):
    with gpurt.Frame(box, width=16, height=16).submit(spp=2) as job:
        pass
    assert job.done and job.progress == 1
    with pytest.raises(ZeroDivisionError):
        with long_job(box) as job:
            1 / 0
    assert job.done


def test_a_dropped_job_is_cancelled(box):
    frame = gpurt.Frame(box, width=512, height=512)
    job = frame.submit(spp=20000)
    del job
    start = time.perf_counter()
    with pytest.raises(gpurt.Error):
        frame.submit(pipeline="hybrid")
    frame.submit(spp=1, tiles=[(0, 0, 1, 1)]).wait()
    assert time.perf_counter() - start < 5


def test_pipelines_that_do_not_exist_yet(box):
    for pipeline in ("hybrid",):
        with pytest.raises(gpurt.Unsupported):
            box.render(pipeline, width=8, height=8, spp=1)


def test_reyes(box):
    frame = gpurt.Frame(box, width=16, height=16)
    frame.submit("reyes", spp=4, reyes={"filter": "mitchell", "shadows": False, "fragment_slots": 3}).wait()
    statistics = frame.statistics
    assert statistics.pipeline == "reyes"
    assert statistics.reyes == {"shading_rate": 0.25, "filter": "mitchell", "shading": "samples", "shadows": False,
                                "flatness": 0, "fragment_slots": 3}
    assert statistics.reyes_counters["num_lost_fragments"] == 0
    assert statistics.reyes_counters["num_triangles"] > 0
    assert statistics.photon == {}
    with pytest.raises(gpurt.InvalidArgument, match="filter"):
        frame.submit("reyes", spp=8, reyes={"filter": "gaussian"})
    with pytest.raises(gpurt.InvalidArgument, match="'rate' is none of 'shading_rate'"):
        frame.submit("reyes", reyes={"rate": 1})


def test_photon_mapping(box):
    photon = {"photons_per_pass": 4096, "initial_radius": 0.1, "estimator": "memoryless", "kernel": "cone",
              "remedies": ("normal", "continue")}
    frame = gpurt.Frame(box, width=16, height=16)
    frame.submit("photon", spp=2, photon=photon).wait()
    statistics = frame.statistics
    assert statistics.pipeline == "photon"
    assert statistics.photon == {**photon, "initial_radius": np.float32(0.1)}
    assert statistics.photon_counters["num_emitted"] == 2 * 4096
    assert np.isfinite(frame.read("color")).all()
    with pytest.raises(gpurt.InvalidArgument, match="initial_radius"):
        frame.submit("photon", spp=3, photon={"initial_radius": 0.2})
    with pytest.raises(gpurt.InvalidArgument, match="gather"):
        frame.submit("photon", photon={"gather": 1})
    frame.submit("photon", spp=3).wait()
    assert box.render("path", width=8, height=8, spp=1).frame.statistics.photon == {}


def test_photon_mapping_states_its_error(box):
    frame = gpurt.Frame(box, width=16, height=16, outputs=("bias", "error"))
    frame.submit("photon", spp=4, photon={"photons_per_pass": 4096, "estimator": "adaptive"}).wait()
    image = frame.image()
    assert image.bias.shape == (16, 16, 3) and np.isfinite(image.error).all() and (image.error >= 0).all()
    assert 0 <= frame.statistics.estimated_bias <= frame.statistics.estimated_error
    assert frame.statistics.photon["estimator"] == "adaptive"
    with pytest.raises(gpurt.Unsupported, match="GPURT_OUTPUT_BIAS"):
        gpurt.Frame(box, width=8, height=8, outputs="bias").submit("path", spp=1)


def test_an_image_outlives_its_makers(device):
    image = make_box(device).render(width=8, height=8, spp=1)
    assert image.frame.scene.facts.is_committed
    image.frame.submit(spp=4).wait()
    assert (image.sample_count == 1).all() and (image.frame.image().sample_count == 4).all()
