"""Ctrl-C, callbacks, and Python's lock."""

import os
import pathlib
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest
from conftest import make_box, sphere

import gpurt

TESTS = str(pathlib.Path(__file__).parent)


def run_python(code, **options):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([TESTS, *filter(None, sys.path)])}
    return subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True, env=environment, **options)


@pytest.mark.parametrize("render", [
    "frame.submit(spp=20000).wait()",
    "with frame.submit(spp=20000): pass",
    "scene.render(width=512, height=512, spp=20000)",
], ids=["wait", "with", "render"])
def test_ctrl_c_ends_a_long_render(render):
    process = run_python(f"""
        import conftest, gpurt, signal, time
        # Where tests are run in the background, Ctrl-C is ignored.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        scene = conftest.make_box(gpurt.Device("cpu"))
        frame = gpurt.Frame(scene, width=512, height=512)
        print("ready", flush=True)
        try:
            {render}
        except KeyboardInterrupt:
            print("interrupted", frame.read().shape, flush=True)
            raise
    """)
    try:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        start = time.perf_counter()
        out, err = process.communicate(timeout=30)
        assert time.perf_counter() - start < 2
        assert out == "interrupted (512, 512, 3)\n"
        assert process.returncode == -signal.SIGINT and "KeyboardInterrupt" in err
    finally:
        process.kill()


@pytest.mark.parametrize("end", ["", "raise SystemExit(3)", "thread.join(0.1)"])
def test_the_interpreter_can_end_while_a_job_runs(end):
    process = run_python(f"""
        import conftest, gpurt, threading, time
        scene = conftest.make_box(gpurt.Device("cpu", log=print))
        frame = gpurt.Frame(scene, width=512, height=512)
        job = frame.submit(spp=20000, progress=lambda done, total: time.sleep(0.01))
        def wait():
            try: job.wait()
            except gpurt.Cancelled: pass
        thread = threading.Thread(target=wait, daemon=True)
        thread.start()
        time.sleep(0.2)
        {end}
    """)
    try:
        out, err = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == (3 if "SystemExit" in end else 0), err
    assert err == ""


def test_other_python_threads_run_while_rendering(box):
    counted = 0
    stop = threading.Event()

    def count():
        nonlocal counted
        while not stop.is_set():
            counted += 1
            time.sleep(0)

    thread = threading.Thread(target=count)
    thread.start()
    try:
        for work in (lambda: box.render(width=64, height=64, time=0.3),
                     lambda: box.trace(np.tile(np.array([[0, 0, 3, 0, 0, 0, -1, 9]], np.float32), (1 << 21, 1)))):
            before = counted
            work()
            assert counted - before > 50  # with the lock held it would be at most a few
    finally:
        stop.set()
        thread.join()


def test_the_lock_is_released_in_commit(device):
    scene = gpurt.Scene(device)
    scene.add_mesh(*sphere(7))
    ticks = []
    stop = threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    scene.commit("kdtree")
    end = time.perf_counter()
    stop.set()
    thread.join()
    inside = [t for t in ticks if start < t < end]
    # A thread that waited for the lock would tick at the ends alone.
    assert len(inside) > 5 and max(np.diff([start, *inside, end])) < 0.7 * (end - start)


def test_what_progress_raises_comes_out(box):
    class Enough(Exception):
        pass

    def progress(done, total):
        raise Enough(done)

    frame = gpurt.Frame(box, width=512, height=512)
    job = frame.submit(spp=20000, progress=progress)
    start = time.perf_counter()
    with pytest.raises(Enough):
        job.wait()
    assert time.perf_counter() - start < 5 and job.done
    with pytest.raises(Enough):
        job.wait()
    assert frame.read("sample_count").max() < 20000
    frame.submit(spp=1, tiles=[(0, 0, 8, 8)]).wait()
    with pytest.raises(Enough):
        box.render(width=512, height=512, spp=20000, progress=progress)
    with pytest.raises(TypeError, match="progress"):
        box.render(progress=7)


def test_gpurt_cannot_be_used_in_a_callback(box):
    frame = gpurt.Frame(box, width=256, height=256)
    job = frame.submit(spp=20000, progress=lambda done, total: frame.read())
    with pytest.raises(gpurt.InvalidArgument, match="callback"):
        job.wait()


def test_objects_may_die_in_a_callback(box):
    """What a callback drops is given back later, by a thread that may call the library."""
    dropped = [make_box(box.device) for _ in range(3)] + [gpurt.Frame(box, width=8, height=8) for _ in range(3)]

    def progress(done, total):
        dropped.clear()

    box.render(width=128, height=128, spp=32, progress=progress)
    assert not dropped


def test_one_frame_from_many_threads(box):
    import concurrent.futures
    frame = gpurt.Frame(box, width=32, height=32, seed=4)
    tiles = [(x, y, x + 8, y + 8) for y in range(0, 32, 8) for x in range(0, 32, 8)]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda tile: (frame.submit(spp=4, tiles=[tile]).wait(), frame.read())[1], tiles))
    assert (frame.read() == box.render(width=32, height=32, seed=4, spp=4).color).all()


def test_a_job_can_be_waited_for_and_cancelled_from_another_thread(box):
    job = gpurt.Frame(box, width=512, height=512).submit(spp=20000)
    timer = threading.Timer(0.2, job.cancel)
    timer.start()
    with pytest.raises(gpurt.Cancelled):
        job.wait(20)
    timer.join()
