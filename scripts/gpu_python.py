"""Builds the Python package for this machine's Python beside an installed library, and runs its tests of GPU arrays.

    python3 scripts/gpu_python.py [--tree DIR] [--build DIR] [PYTEST_OPTION...]

For machines with a GPU, where the library comes as .gpu/tree and cannot be compiled: the extension is one that any C++
compiler makes in seconds. Needs g++ (or $CXX), and of Python its headers, numpy, pybind11 and pytest; PyTorch, CuPy and JAX are
tested where they are there. From the repository's root. PYTEST_OPTIONs take the place of bindings/python/tests/test_interop.py.
Exit status: pytest's; 77 where something that is needed is missing, 1 where the extension cannot be compiled.
"""

import argparse
import concurrent.futures
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import sysconfig

BINDINGS = pathlib.Path("bindings/python")
TESTS = BINDINGS / "tests" / "test_interop.py"
MISSING = 77


def what_is_missing(tree, compiler):
    """The first thing without which nothing can be built or run; None: all is there."""
    if not (tree / "lib" / "libgpurt.so.0").exists():
        return f"no {tree}/lib/libgpurt.so.0: scripts/gpu pack and run put it there"
    if shutil.which(compiler) is None:
        return f"no C++ compiler: {compiler} is not on the PATH, and CXX names no other"
    if not (pathlib.Path(sysconfig.get_path("include")) / "Python.h").exists():
        return f"no Python.h in {sysconfig.get_path('include')}"
    for module in ("numpy", "pybind11", "pytest"):
        if importlib.util.find_spec(module) is None:
            return f"{sys.executable} has no {module}"
    return None


def build(tree, folder, compiler):
    """The package gpurt in folder/gpurt; returns what the compiler said where it failed, else ''."""
    import pybind11

    package, objects = folder / "gpurt", folder / "objects"
    shutil.rmtree(package, ignore_errors=True)
    shutil.copytree(BINDINGS / "src" / "gpurt", package, ignore=shutil.ignore_patterns("__pycache__"))
    objects.mkdir(parents=True, exist_ok=True)
    flags = ["-std=c++17", "-O0", "-fPIC", "-fvisibility=hidden", "-Iinclude", f"-I{sysconfig.get_path('include')}",
             f"-I{pybind11.get_include()}"]
    sources = sorted((BINDINGS / "src" / "_core").glob("*.cpp"))

    def run(command):
        return subprocess.run(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        done = list(pool.map(lambda s: run([compiler, *flags, "-c", s, "-o", objects / f"{s.stem}.o"]), sources))
    done.append(run([compiler, "-shared", *(objects / f"{s.stem}.o" for s in sources), f"-L{tree / 'lib'}", "-l:libgpurt.so.0",
                     f"-Wl,-rpath,{(tree / 'lib').resolve()}",
                     "-o", package / f"_core{sysconfig.get_config_var('EXT_SUFFIX')}"]))
    return "".join(d.stdout for d in done) if any(d.returncode for d in done) else ""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tree", type=pathlib.Path, default=".gpu/tree", help="the installed library (default: %(default)s)")
    parser.add_argument("--build", type=pathlib.Path, default=".gpu/python", help="where to build (default: %(default)s)")
    args, options = parser.parse_known_args()
    compiler = os.environ.get("CXX", "g++")
    missing = what_is_missing(args.tree, compiler)
    if missing is not None:
        print(missing)
        return MISSING
    errors = build(args.tree, args.build, compiler)
    if errors:
        print(f"the extension cannot be compiled:\n{errors}")
        return 1
    path = os.pathsep.join(filter(None, [str(args.build.resolve()), os.environ.get("PYTHONPATH")]))
    return subprocess.run([sys.executable, "-m", "pytest", *(options or [TESTS])],
                          env={**os.environ, "PYTHONPATH": path}).returncode


if __name__ == "__main__":
    sys.exit(main())
