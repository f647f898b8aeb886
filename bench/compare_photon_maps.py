"""Photon maps of the CPU against scipy.spatial.cKDTree and nanoflann: building, and gathers that find about 50 points.

    python bench/compare_photon_maps.py [--points N] [--queries N] [--threads N] [--repeats N] [--nanoflann PROGRAM]

Needs the package gpurt and scipy, and bench_nanoflann, which is built where nanoflann.hpp is found (Debian: libnanoflann-dev).
All take the same points and places, in the same random order, and as many threads where they can have several. They take turns,
so that a disturbance of the machine hits all of them, and of repeats the least time counts. What is asked is how many points are near; of gpurt the sum of their fluxes as well. One JSON line a set.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

import numpy as np
from scipy.spatial import cKDTree

import gpurt


def uniform(rng, n):
    """Of the unit cube, and the radius of a ball that holds 50 of them."""
    return rng.random((n, 3), np.float32), lambda count: (50 / (count * 4 / 3 * np.pi)) ** (1 / 3)


def surface(rng, n):
    """Of 64 spheres, even by area, as bench_photons has them."""
    spheres = np.random.default_rng(77)
    centers, radii = spheres.random((64, 3)), 0.03 + 0.12 * spheres.random(64)
    of = rng.choice(64, n, p=radii**2 / (radii**2).sum())
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = (centers[of] + radii[of, None] * normals).astype(np.float32)
    return points, lambda count: (50 * 4 * (radii**2).sum() / count) ** 0.5


def timed(run):
    start = time.perf_counter()
    result = run()
    return time.perf_counter() - start, result


def run_gpurt(points, places, radius, threads, fluxes=None):
    device = gpurt.Device("cpu", threads=threads)
    build, photons = timed(lambda: gpurt.PhotonMap(points, fluxes=fluxes, radius=radius, device=device))
    gather, found = timed(lambda: photons.count(places, radius) if fluxes is None else photons.sum(places, radius)[:, 0])
    return {"build_s": build, "gather_s": gather, "found": int(found.sum(dtype=float))}


def run_scipy(points, places, radius, threads):
    build, tree = timed(lambda: cKDTree(points))
    gather, counts = timed(lambda: tree.query_ball_point(places, radius, workers=threads, return_length=True))
    return {"build_s": build, "gather_s": gather, "found": int(counts.sum())}


def run_nanoflann(program, paths, radius, threads):
    command = [program, *map(str, paths), repr(radius), str(threads), "1"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def compare(name, make, arguments):
    rng = np.random.default_rng(1)
    points, radius_for = make(rng, arguments.points)
    places, _ = make(rng, arguments.queries)
    radius, threads = float(np.float32(radius_for(arguments.points))), arguments.threads
    fluxes = np.ones_like(points)
    result = {"bench": "photon_maps", "set": name, "points": arguments.points, "queries": arguments.queries,
              "threads": threads, "radius": radius, "device": gpurt.Device("cpu").properties.name}
    with tempfile.TemporaryDirectory() as folder:
        paths = [pathlib.Path(folder) / "points", pathlib.Path(folder) / "places"]
        points.tofile(paths[0])
        places.tofile(paths[1])
        runs = {"gpurt": lambda: run_gpurt(points, places, radius, threads),
                "gpurt_flux": lambda: run_gpurt(points, places, radius, threads, fluxes),
                "scipy": lambda: run_scipy(points, places, radius, threads)}
        if arguments.nanoflann:
            runs["nanoflann"] = lambda: run_nanoflann(arguments.nanoflann, paths, radius, threads)
        for _ in range(arguments.repeats):
            for key, run in runs.items():
                last = run()
                best = result.setdefault(key, last)
                for time_s in ("build_s", "gather_s"):
                    best[time_s] = min(best[time_s], last[time_s])

    own = result["gpurt"]
    for peer in ("scipy", "nanoflann"):
        if peer in result:
            other = result[peer]
            # What lies on the radius is counted by some and not by others.
            assert abs(other["found"] - own["found"]) < 1e-4 * own["found"], (peer, other["found"], own["found"])
            other["times_build"] = other["build_s"] / own["build_s"]
            other["times_gather"] = other["gather_s"] / own["gather_s"]
            other["times_both"] = (other["build_s"] + other["gather_s"]) / (own["build_s"] + own["gather_s"])
    print(json.dumps(result), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--queries", type=int, default=1_000_000)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--nanoflann", help="the program bench_nanoflann; none: it is left out")
    arguments = parser.parse_args()
    for name, make in (("uniform", uniform), ("surface", surface)):
        compare(name, make, arguments)


if __name__ == "__main__":
    main()
