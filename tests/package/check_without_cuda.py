"""What works where there is no CUDA: a build that never asks for its compiler, and any build where no driver shows a GPU."""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys


def run(*command, expect=0):
    """Runs a command that finds no GPU, whatever the machine has; returns what it printed."""
    done = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          env={**os.environ, "CUDA_VISIBLE_DEVICES": "-1"})
    if done.returncode != expect:
        sys.exit(f"{' '.join(map(str, command))}: exit status {done.returncode}, not {expect}\n{done.stdout}")
    return done.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--library", required=True)
    parser.add_argument("--cache", required=True, type=pathlib.Path)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    args = parser.parse_args()

    # The CUDA runtime is part of the library, and the driver is looked for when it is needed.
    needed = re.findall(r"\(NEEDED\).*\[(.*)\]", run("readelf", "-d", args.library))
    if not needed or any(re.match(r"lib(cuda|nv)", name) for name in needed):
        sys.exit(f"{args.library} needs {', '.join(needed)}")

    cache = args.cache.read_text()
    has_cuda = re.search(r"^GPURT_CUDA:BOOL=(\w+)$", cache, flags=re.M).group(1) in ("ON", "1", "TRUE", "YES")
    if not has_cuda and "CMAKE_CUDA_COMPILER:" in cache:
        sys.exit("GPURT_CUDA is off, but CMake looked for a CUDA compiler")

    args.work.mkdir(parents=True, exist_ok=True)
    devices = json.loads(run(args.tool, "devices", "--json"))
    if [device["type"] for device in devices] != ["cpu"]:
        sys.exit(f"not the CPU alone: {devices}")
    scene, image = args.work / "cornell.glb", args.work / "image.png"
    run(args.tool, "scene", "cornell", "-o", scene, "--width", "32")
    for device in ("auto", "cpu"):
        image.unlink(missing_ok=True)
        run(args.tool, "render", scene, "-o", image, "--device", device, "--spp", "1")
        if not image.stat().st_size:
            sys.exit(f"--device {device} rendered nothing")
    for device in ("cuda", "cuda:0", "cuda:0,1"):
        text = run(args.tool, "render", scene, "-o", image, "--device", device, "--spp", "1", expect=1)
        if f"--device {device}: " not in text or "gpurt devices lists what there is" not in text:
            sys.exit(f"--device {device} does not say what to do: {text}")
    print(f"the CPU works without a GPU; {'with' if has_cuda else 'without'} a CUDA backend; needs {', '.join(needed)}")


if __name__ == "__main__":
    main()
