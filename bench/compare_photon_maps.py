"""Photon maps of the CPU against scipy.spatial.cKDTree and nanoflann: building, and gathers that find about 50 points.

    python bench/compare_photon_maps.py [--points N] [--queries N] [--threads N] [--repeats N] [--nanoflann PROGRAM]

Needs the package gpurt and scipy, and bench_nanoflann, which is built where nanoflann.hpp is found (Debian: libnanoflann-dev).
All take the same points and places, in the same random order, and as many threads where they can have several; of repeats the
least time counts. What is asked is how many points are near; of gpurt the sum of their fluxes as well. One JSON line a set.
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


def least(repeats, run):
    """The least seconds of some calls, and what the last one returned."""
    best, result = float("inf"), None
    for _ in range(repeats):
        result = None
        start = time.perf_counter()
        result = run()
        best = min(best, time.perf_counter() - start)
    return best, result


def compare(name, make, arguments):
    rng = np.random.default_rng(1)
    points, radius_for = make(rng, arguments.points)
    places, _ = make(rng, arguments.queries)
    radius = float(np.float32(radius_for(arguments.points)))
    repeats, threads = arguments.repeats, arguments.threads
    device = gpurt.Device("cpu", threads=threads)
    fluxes = np.ones_like(points)
    result = {"bench": "photon_maps", "set": name, "points": arguments.points, "queries": arguments.queries,
              "threads": threads, "radius": radius, "device": device.properties.name}

    build, photons = least(repeats, lambda: gpurt.PhotonMap(points, radius=radius, device=device))
    gather, counts = least(repeats, lambda: photons.count(places, radius))
    result["gpurt"] = {"build_s": build, "gather_s": gather, "found": int(counts.sum())}
    build, photons = least(repeats, lambda: gpurt.PhotonMap(points, fluxes=fluxes, radius=radius, device=device))
    gather, sums = least(repeats, lambda: photons.sum(places, radius))
    result["gpurt_flux"] = {"build_s": build, "gather_s": gather, "found": int(sums[:, 0].sum(dtype=float))}
    del photons

    build, tree = least(repeats, lambda: cKDTree(points))
    gather, counts = least(repeats, lambda: tree.query_ball_point(places, radius, workers=threads, return_length=True))
    result["scipy"] = {"build_s": build, "gather_s": gather, "found": int(counts.sum())}
    del tree

    if arguments.nanoflann:
        with tempfile.TemporaryDirectory() as folder:
            paths = [pathlib.Path(folder) / "points", pathlib.Path(folder) / "places"]
            points.tofile(paths[0])
            places.tofile(paths[1])
            command = [arguments.nanoflann, *map(str, paths), repr(radius), str(threads), str(repeats)]
            result["nanoflann"] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)

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
