"""The command line keeps its promises: exit codes, one clear line for what is wrong, files that are right.

    check_cli.py GPURT SCENES_FOLDER WORK_FOLDER [CASE...]

SCENES_FOLDER may be missing: cases that need a file of it say so and are skipped.
"""

import array
import json
import math
import os
import pathlib
import re
import shutil
import signal
import struct
import subprocess
import sys
import time

GPURT, SCENES, WORK = (pathlib.Path(a).resolve() for a in sys.argv[1:4])
CPU = ["--device", "cpu"]


def run(*args, expect=0, timeout=120):
    """Runs the tool in the work folder; checks its exit status and that failures are one line on stderr."""
    done = subprocess.run([GPURT, *map(str, args)], cwd=WORK, capture_output=True, text=True, timeout=timeout)
    text = f"gpurt {' '.join(map(str, args))}\n{done.stdout}{done.stderr}"
    assert done.returncode == expect, f"exit status {done.returncode}, not {expect}: {text}"
    if expect != 0:
        assert done.stderr.count("\n") == 1 and done.stderr.startswith("gpurt: "), f"not one clear line: {text}"
    return done


def refused(status, part, *args):
    line = run(*args, expect=status).stderr
    assert part in line, f"'{part}' is not in: {line}"


def scene(name="cornell", *args):
    path = WORK / f"{name}.glb"
    if not path.exists():
        run("scene", name, "-o", path, *args)
    return path


def case_help():
    assert "A first picture" in run("--help").stdout
    assert run("--version").stdout.startswith("gpurt ")
    for command in ("devices", "info", "render", "merge", "trace", "scene", "verify", "bench"):
        text = run(command, "--help").stdout
        assert "Usage" in text and ("Example" in text or command == "devices"), command
    refused(2, "subcommand is required")
    refused(2, "no command \"paint\"; the commands are devices", "paint")


def case_wrong_usage():
    cornell = scene()
    refused(2, "--nonsense", "devices", "--nonsense")
    refused(2, "file is required", "info")
    refused(2, "scene is required", "render")
    refused(2, "no output", "render", cornell)
    refused(2, ".jpg", "render", cornell, "-o", "a.jpg")
    refused(2, "excludes", "render", cornell, "-o", "a.png", "--spp", 4, "--error", 0.1)
    refused(2, "excludes", "render", cornell, "-o", "a.png", "--time", 4, "--error", 0.1)
    refused(2, "--error", "render", cornell, "-o", "a.png", "--error", "-1")
    for option, values in {"--spp": (0, -1, 1.5, "many"), "--seed": (-1, "9" * 20, "1e3"), "--first-sample": (-1,),
                           "--width": (0, 65536), "--tile": (257, -1), "--threads": (4097, -1),
                           "--time": ("nan", 0), "--max-depth": (-1,)}.items():
        for value in values:
            refused(2, option, "render", cornell, "-o", "a.png", option, value)
    refused(2, "--accel requires --build", "info", cornell, "--accel", "kdtree")
    refused(2, "--device", "render", cornell, "-o", "a.png", "--device", "tpu")
    refused(2, "--pipeline", "render", cornell, "-o", "a.png", "--pipeline", "raster")
    refused(2, '--patch-pixels: "-1" is not a number from 0 on', "render", cornell, "--patch-pixels", "-1")
    refused(2, "--patch-height requires --patch-pixels", "trace", cornell, "--rays", "rays.bin", "-o", "hits.bin",
            "--patch-height", 64)
    refused(2, "--fragment-slots", "render", cornell, "-o", "a.png", "--pipeline", "reyes", "--fragment-slots", 65)
    refused(2, "lots", "render", cornell, "-o", "a.png", "--memory-limit", "lots")
    refused(2, "depht", "render", cornell, "-o", "a.exr", "--aov", "normal,depht")
    refused(2, "parts is required", "merge", cornell)
    refused(2, "no output", "merge", cornell, "a.gpurt")
    refused(2, "--rays is required", "trace", cornell, "-o", "hits.bin")
    refused(2, "--offsets", "trace", cornell, "--rays", "rays.bin", "-o", "hits.bin", "--query", "all")
    refused(2, "teapot", "scene", "teapot", "-o", "teapot.glb")
    refused(2, ".obj", "scene", "cornell", "-o", "cornell.obj")
    refused(2, "--rays", "verify", cornell, "--rays", "many")
    refused(2, "--accel", "bench", cornell, "--accel", "octree")


def case_failures():
    cornell = scene()
    refused(1, "absent.glb", "info", "absent.glb")
    refused(1, "absent.glb", "render", "absent.glb", "-o", "a.png", *CPU)
    refused(1, "no/such/folder", "render", cornell, "-o", "no/such/folder/a.png")
    refused(1, "--pipeline hybrid is not supported", "render", cornell, "-o", "a.png", "--pipeline", "hybrid", *CPU)
    refused(1, "--max-depth is 5", "render", cornell, "-o", "a.png", "--pipeline", "reyes", "--max-depth", "5", *CPU)
    refused(1, "use --accel kdtree", "render", cornell, "-o", "a.png", "--accel", "embree", "--triangle-test", "double",
            *CPU)
    refused(1, "gpurt devices", "render", cornell, "-o", "a.png", "--device", "cuda:99")
    (WORK / "folder.png").mkdir()
    refused(1, "is a folder", "render", cornell, "-o", "folder.png")
    refused(1, "is a folder", "trace", cornell, "--rays", "folder.png", "-o", "hits.bin", *CPU)
    refused(1, "--camera 3", "render", cornell, "-o", "a.png", "--camera", 3, *CPU)
    refused(1, "memory", "render", cornell, "-o", "a.png", "--memory-limit", "64K", *CPU)
    (WORK / "text.glb").write_text("this is no scene")
    refused(1, "text.glb", "render", "text.glb", "-o", "a.png", *CPU)
    refused(1, "absent.gpurt", "merge", cornell, "absent.gpurt", "-o", "a.exr")
    (WORK / "odd.bin").write_bytes(bytes(33))
    (WORK / "ray.bin").write_bytes(bytes(32))
    refused(1, "--patch-camera is 3, but the scene has 1 cameras", "trace", cornell, "--rays", "ray.bin", "-o", "hits.bin",
            "--patch-pixels", 1, "--patch-camera", 3, *CPU)
    refused(1, "no multiple of 32", "trace", cornell, "--rays", "odd.bin", "-o", "hits.bin", *CPU)
    refused(1, "absent.bin", "trace", cornell, "--rays", "absent.bin", "-o", "hits.bin", *CPU)
    refused(1, "nowhere", "scene", "cornell", "-o", "nowhere/cornell.glb")
    refused(1, "absent.glb", "verify", "absent.glb")
    refused(1, "absent.glb", "bench", "absent.glb", *CPU)
    assert not (WORK / "a.png").exists() and not (WORK / "hits.bin").exists()
    assert not list(WORK.glob("*.tmp*")), "temporary files are left"


def case_render():
    cornell = scene()
    done = run("render", cornell, "-o", "a.exr", "-o", "a.png", "--width", 48, "--spp", 4, "--aov", "all",
               "--stats", "a.json", "--seed", 5, *CPU)
    assert "48 x 48 pixels, 4 samples each" in done.stdout and "wrote a.exr, a.png" in done.stdout, done.stdout
    assert (WORK / "a.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    exr = (WORK / "a.exr").read_bytes()
    assert exr[:4] == b"\x76\x2f\x31\x01"
    for name in (b"normal.X", b"albedo.R", b"position.Z", b"variance.B", b"sampleCount", b"primitive", b"gpurt:sceneHash"):
        assert name in exr, name
    stats = json.loads((WORK / "a.json").read_text())
    s = stats["statistics"]
    assert s["samples_per_pixel"] == 4 and s["width"] == 48 and s["seed"] == 5 and s["num_samples"] == 48 * 48 * 4
    assert s["num_nonfinite"] == 0 and s["estimated_error"] > 0 and stats["facts"]["triangles"] == 32
    quiet = run("render", cornell, "-o", "quiet.exr", "--width", 48, "--spp", 4, "--aov", "all", "--seed", 5, "-q", *CPU)
    assert quiet.stdout == "" and quiet.stderr == ""
    assert (WORK / "quiet.exr").read_bytes() == exr, "the same command gave another file"
    run("render", cornell, "-o", "tiles.exr", "--width", 48, "--spp", 4, "--aov", "all", "--seed", 5, "--tile", 7,
        "--threads", 1, *CPU)
    assert (WORK / "tiles.exr").read_bytes() == exr, "tile size or threads changed the picture"
    run("render", cornell, "-o", "dark.png", "-o", "b.exr", "--width", 48, "--spp", 4, "--aov", "all", "--seed", 5,
        "--exposure", -3, "-q", *CPU)
    assert (WORK / "b.exr").read_bytes() == exr, "exposure changed radiance"
    # Fewer grey levels take fewer bytes.
    assert (WORK / "dark.png").stat().st_size < (WORK / "a.png").stat().st_size
    refused(2, "--exposure", "render", cornell, "-o", "a.png", "--exposure", "nan")
    assert not list(WORK.glob("*.tmp*")), "temporary files are left"


def case_error_and_time():
    cornell = scene()
    run("render", cornell, "-o", "e.png", "--width", 32, "--error", 0.05, "--stats", "e.json", *CPU)
    s = json.loads((WORK / "e.json").read_text())["statistics"]
    assert 0 < s["estimated_error"] <= 0.05 and s["samples_per_pixel"] >= 32 and "below 0.05" in s["reason"], s
    start = time.monotonic()
    run("render", cornell, "-o", "t.png", "--width", 32, "--time", 1, "--stats", "t.json", *CPU)
    s = json.loads((WORK / "t.json").read_text())["statistics"]
    assert 0 < s["render_seconds"] <= 1.2 and time.monotonic() - start < 5, s


def case_state_and_merge():
    cornell = scene()
    options = ["--width", 40, "--height", 24, "--seed", 9, "--aov", "normal,depth"]
    run("render", cornell, "-o", "once.exr", "--spp", 12, *options, *CPU)
    run("render", cornell, "--state", "s.gpurt", "--spp", 5, *options, *CPU)
    run("render", cornell, "--state", "s.gpurt", "--spp", 12, "-o", "twice.exr", *CPU)  # settings come from the file
    assert (WORK / "once.exr").read_bytes() == (WORK / "twice.exr").read_bytes()
    assert json.loads(run("info", "s.gpurt", "--json").stdout)["num_samples"] == 40 * 24 * 12
    assert "40" in run("info", "s.gpurt").stdout
    refused(1, "seed", "render", cornell, "--state", "s.gpurt", "--seed", 3, "--spp", 13, *CPU)
    for first, count in ((0, 4), (4, 5), (9, 3)):
        run("render", cornell, "-o", f"part{first}.gpurt", "--spp", count, "--first-sample", first, *options, *CPU)
    run("merge", cornell, "part9.gpurt", "part0.gpurt", "part4.gpurt", "-o", "merged.exr", "-o", "merged.gpurt")
    merged = json.loads(run("info", "merged.gpurt", "--json").stdout)
    assert merged["num_samples"] == 40 * 24 * 12
    # The header says where the first part began; all else is the same.
    pixels = lambda name: (WORK / name).read_bytes().replace(b"first_sample=9", b"first_sample=0")
    assert pixels("merged.exr") == pixels("once.exr"), "merging changed bits"
    refused(1, "twice", "merge", cornell, "part0.gpurt", "part4.gpurt", "part0.gpurt", "-o", "x.exr")
    damaged = bytearray((WORK / "part4.gpurt").read_bytes())
    damaged[len(damaged) // 2] ^= 1
    (WORK / "damaged.gpurt").write_bytes(damaged)
    refused(1, "damaged", "merge", cornell, "part0.gpurt", "damaged.gpurt", "-o", "x.exr")
    assert not (WORK / "x.exr").exists()


def case_interrupt():
    cornell = scene()
    args = [GPURT, "render", cornell, "-o", "i.png", "--state", "i.gpurt", "--spp", "1000000", *CPU]
    process = subprocess.Popen(args, cwd=WORK, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(2)
    process.send_signal(signal.SIGINT)
    start = time.monotonic()
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, (process.returncode, err)
    assert time.monotonic() - start < 5 and "interrupted" in err, err
    assert (WORK / "i.png").exists()
    assert json.loads(run("info", "i.gpurt", "--json").stdout)["num_samples"] > 0


def case_trace():
    ball = scene("icosphere")
    rays, n = array.array("f"), 1000
    for i in range(n):  # from the middle outwards, evenly spread
        z = 1 - 2 * (i + 0.5) / n
        r, phi = math.sqrt(1 - z * z), 2.399963 * i
        rays.extend((0, 0, 0, 0, r * math.cos(phi), r * math.sin(phi), z, math.inf if i % 2 else 0.5))
    (WORK / "rays.bin").write_bytes(rays.tobytes())
    for accel in ("kdtree", "embree"):
        done = run("trace", ball, "--rays", "rays.bin", "-o", "hits.bin", "--accel", accel, *CPU)
        assert "1000 rays, 500 hits" in done.stdout, done.stdout
        data = (WORK / "hits.bin").read_bytes()
        assert len(data) == 32 * n
        for i in range(n):
            t, u, v, primitive, geometry, instance, pad0, pad1 = struct.unpack_from("<3f5I", data, 32 * i)
            if i % 2 == 0:
                assert primitive == 0xFFFFFFFF and t == 0.5, (i, t, primitive)
                continue
            # The flat faces lie a little inside the unit sphere.
            assert 0.99 < t <= 1.00001 and primitive < 5120 and geometry == 0 and instance == 0, (i, t, primitive)
            assert u >= -1e-6 and v >= -1e-6 and u + v <= 1.000001 and pad0 == pad1 == 0
    run("trace", ball, "--rays", "rays.bin", "-o", "any.bin", "--query", "any", *CPU)
    assert (WORK / "any.bin").read_bytes() == bytes(i % 2 for i in range(n))
    run("trace", ball, "--rays", "rays.bin", "-o", "all.bin", "--query", "all", "--offsets", "offsets.bin", *CPU)
    offsets = struct.unpack(f"<{n + 1}Q", (WORK / "offsets.bin").read_bytes())
    assert offsets[-1] == 500 and len((WORK / "all.bin").read_bytes()) == 500 * 32
    assert [offsets[i + 1] - offsets[i] for i in range(n)] == [i % 2 for i in range(n)]


def case_info_and_devices():
    devices = json.loads(run("devices", "--json").stdout)
    assert devices[0]["type"] == "cpu" and devices[0]["num_threads"] >= 1
    assert run("devices").stdout.startswith("cpu")
    facts = json.loads(run("info", scene(), "--json", "--build", "--accel", "kdtree", *CPU).stdout)
    assert facts["triangles"] == 32 and facts["emissive_triangles"] == 2 and facts["accel"] == "kdtree", facts
    assert "32 stored" in run("info", scene()).stdout


def case_verify_and_bench():
    ball = scene("icosphere")
    assert "agree" in run("verify", ball, "--rays", 20000).stdout
    lines = run("bench", ball, "--width", 64, "--repeats", 3, *CPU).stdout.splitlines()
    cases = [json.loads(line) for line in lines]
    assert {(c["accel"], c["rays"]) for c in cases} == {(a, r) for a in ("kdtree", "bvh", "embree")
                                                       for r in ("primary", "diffuse", "ao", "random")}
    for c in cases:
        assert c["mrays_per_second_min"] <= c["mrays_per_second"] <= c["mrays_per_second_max"] and c["num_rays"] > 0
    hits = {r: {c["num_hits"] for c in cases if c["rays"] == r} for r in ("primary", "diffuse", "ao", "random")}
    assert all(max(h) - min(h) <= 2 for h in hits.values()), hits  # edges may fall either way


def case_scenes():
    for name in ("cornell", "glass", "outdoor", "furnace", "icosphere"):
        path = WORK / f"little_{name}.glb"
        run("scene", name, "-o", path, "--detail", 0.1, "--width", 24)
        done = run("render", path, "-o", f"little_{name}.png", "--spp", 1, *CPU)
        assert "24 x " in done.stdout, done.stdout
    assert (WORK / "little_outdoor_sky.hdr").exists()
    assert run("scene", "cornell", "-o", "q.glb", "--quiet").stdout == ""


def case_readme():
    """The commands that README.md shows, on a small picture. The chart's tests are those of the Python package."""
    readme = pathlib.Path(__file__).resolve().parents[2] / "README.md"
    blocks = re.findall(r"^```sh\n(.*?)^```$", readme.read_text(encoding="utf-8"), flags=re.M | re.S)
    commands = [line.split("#")[0].split() for block in blocks for line in block.splitlines() if line.startswith("gpurt ")]
    (WORK / "cornell.glb").unlink(missing_ok=True)
    (WORK / "rays.bin").write_bytes(struct.pack("<8f", 0.3, 0.3, -1, 0, 0, 0, 1, 100) * 10)
    shown = set()
    for command in commands:
        shown.add(command[1])
        if command[1] != "chart":
            run(*command[1:], *(["--width", 48] if command[1] in ("scene", "bench") else []))
    assert shown == {"scene", "info", "render", "trace", "verify", "bench", "chart"}, shown
    assert (WORK / "cornell.exr").exists() and (WORK / "cornell.png").exists() and (WORK / "hits.bin").exists()


def case_chart():
    env = dict(os.environ, GPURT_PYTHON="/nonexistent/python3")
    done = subprocess.run([GPURT, "chart"], cwd=WORK, env=env, capture_output=True, text=True)
    assert done.returncode == 1 and "needs Python 3" in done.stderr, done
    fake = WORK / "python"  # has no package gpurt
    fake.write_text("#!/bin/sh\nexit 3\n")
    fake.chmod(0o755)
    done = subprocess.run([GPURT, "chart", "--help"], cwd=WORK, env=dict(env, GPURT_PYTHON=str(fake)), capture_output=True, text=True)
    assert done.returncode == 1 and "pip install 'gpurt[chart]'" in done.stderr, done
    fake.write_text('#!/bin/sh\nif [ "$1" = -c ]; then exit 0; fi\necho "$@"\nexit 7\n')
    done = subprocess.run([GPURT, "chart", "a.glb", "--error", "x"], cwd=WORK, env=dict(env, GPURT_PYTHON=str(fake)), capture_output=True, text=True)
    assert done.returncode == 7 and done.stdout == "-m gpurt.chart a.glb --error x\n", done


def main():
    cases = {name[5:]: function for name, function in globals().items() if name.startswith("case_")}
    chosen = sys.argv[4:] or list(cases)
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    for name in chosen:
        try:
            cases[name]()
        except AssertionError as error:
            sys.exit(f"{name}: {error}")
        print(f"{name}: ok")


if __name__ == "__main__":
    main()
