"""The package as such: names, types, pickling, leaks, the wheel, the documentation's code."""

import ast
import gc
import importlib.util
import inspect
import pathlib
import pickle
import re
import subprocess
import sys
import tarfile
import weakref

import numpy as np
import pytest
from conftest import make_box, sphere

import gpurt
from gpurt import _core

PACKAGE = pathlib.Path(gpurt.__file__).parent
ROOT = pathlib.Path(__file__).resolve().parents[3]


def test_version():
    assert re.fullmatch(r"\d+\.\d+\.\d+", gpurt.__version__)


def test_every_public_name_is_there_and_documented():
    for name in gpurt.__all__:
        value = getattr(gpurt, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            assert value.__doc__, name
            assert value.__module__.startswith("gpurt")
        if inspect.isclass(value):
            for attribute, member in vars(value).items():
                if not attribute.startswith("_") and inspect.isfunction(member):
                    assert member.__doc__, f"{name}.{attribute}"
    public = {n for n, v in vars(gpurt).items() if not n.startswith("_") and not inspect.ismodule(v)}
    assert public == set(gpurt.__all__)


def stub_functions(body, prefix=""):
    for node in body:
        if isinstance(node, ast.FunctionDef):
            yield prefix + node.name, [a.arg for a in node.args.args]
        elif isinstance(node, ast.ClassDef):
            yield prefix + node.name, None
            yield from stub_functions(node.body, f"{prefix}{node.name}.")


def runtime_functions(owner, prefix=""):
    """What pybind11 made; it puts the signature into the documentation."""
    for name, value in vars(owner).items():
        if name.startswith("_") and name != "__init__":
            continue
        if inspect.isclass(value):
            yield prefix + name, None
            yield from runtime_functions(value, f"{prefix}{name}.")
            continue
        signature = re.match(r"\w+\((.*)\) ->", getattr(getattr(owner, name), "__doc__", None) or "")
        if signature:
            yield prefix + name, re.findall(r"(\w+): ", re.sub(r"\[[^]]*\]", "", signature.group(1)))


def test_the_stubs_match_the_module():
    """Every function and class, with the names of the arguments."""
    stubs = dict(stub_functions(ast.parse((PACKAGE / "_core.pyi").read_text()).body))
    runtime = dict(runtime_functions(_core))
    assert stubs.keys() == runtime.keys()
    for name, arguments in runtime.items():
        assert stubs[name] == arguments, name


@pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy is not installed")
def test_types_are_strict(tmp_path):
    user = tmp_path / "user.py"
    user.write_text("import gpurt\n"
                    "hits, offsets = gpurt.load('a.glb').commit().trace([[0.0] * 8], query='all')\n"
                    "image: gpurt.Image = gpurt.Scene().render(spp=4)\n"
                    "reveal_type(image.color)\n")
    result = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--config-file", ROOT / "pyproject.toml",
                             "--cache-dir", ROOT / "build" / "mypy-cache" if (ROOT / "build").is_dir() else tmp_path,
                             "-p", "gpurt", "-m", "user"],
                            cwd=tmp_path, text=True, capture_output=True,
                            env={"MYPYPATH": f"{PACKAGE.parent}:{tmp_path}", "PATH": "/usr/bin:/bin"})
    assert result.returncode == 0, result.stdout + result.stderr
    assert "float" in result.stdout


def test_pickling_is_refused(box):
    image = box.render(width=4, height=4, spp=1)
    job = image.frame.submit(spp=1)
    job.wait()
    for value in (box, box.device, image, image.frame, job):
        with pytest.raises(TypeError, match=f"cannot pickle gpurt.{type(value).__name__}: .*; "):
            pickle.dumps(value)
    for value in (box.facts, image.statistics, box.device.properties, box.camera(), image.color, box.export_tree()):
        assert type(pickle.loads(pickle.dumps(value))) is type(value)


def test_objects_describe_themselves(box):
    frame = gpurt.Frame(box, width=4, height=3)
    assert "12 triangles" in repr(box) and "kdtree" in repr(box)
    assert "4x3" in repr(frame) and "4x3" in repr(frame.image())
    assert "cpu" in repr(box.device)
    job = frame.submit(spp=1)
    job.wait()
    assert "ended" in repr(job)


def test_nothing_is_leaked():
    device = gpurt.Device("cpu", threads=2)
    vertices, indices = sphere(3)

    def once():
        scene = gpurt.Scene(device)
        scene.add_mesh(vertices, indices)
        scene.add_camera(position=(0, 0, 3), target=(0, 0, 0))
        scene.set_environment(1)
        scene.commit("kdtree")
        image = scene.render(width=8, height=8, spp=1, progress=lambda done, total: None)
        scene.trace(np.zeros((10, 8), np.float32), query="all")
        return [weakref.ref(o) for o in (scene, image, image.frame)]

    gone = once()
    gc.collect()
    assert all(r() is None for r in gone)
    held = device.properties.memory_used
    gc.collect()
    objects = len(gc.get_objects())
    resident = resident_bytes()
    for _ in range(200):
        once()
    gc.collect()
    assert device.properties.memory_used == held == 0
    assert len(gc.get_objects()) - objects < 100
    # 200 scenes of this size hold about 200 x 400 KB; the allocator keeps a little.
    assert resident_bytes() - resident < 20e6


def resident_bytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


def test_errors_do_not_leak_the_frame_that_failed(device):
    scene = make_box(device)
    gone = weakref.ref(scene)
    with pytest.raises(gpurt.Unsupported):
        scene.render("hybrid")
    del scene
    gc.collect()
    assert gone() is None


@pytest.mark.skipif(not (ROOT / "docs" / "python.md").exists(), reason="not beside the project's documentation")
@pytest.mark.parametrize("document", ["README.md", "docs/python.md"])
def test_the_code_in_the_documentation_runs(tmp_path, monkeypatch, document):
    """Every fenced Python block, one after the other."""
    import glb
    glb.write_box(tmp_path / "cornell.glb")
    monkeypatch.chdir(tmp_path)
    text = (ROOT / document).read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.M | re.S)
    assert blocks
    names = {}
    for block in blocks:
        exec(compile(block, document, "exec"), names)


def test_a_wheel_is_built_and_works(tmp_path):
    """From a source archive and an installation of the build that these tests run from, so that it is quick."""
    build = PACKAGE.parents[1]
    if not (build / "CMakeCache.txt").exists():
        pytest.skip("not run from a build folder")
    for module in ("scikit_build_core", "pybind11"):
        pytest.importorskip(module)
    cmake = re.search(r"^CMAKE_COMMAND:INTERNAL=(.*)$", (build / "CMakeCache.txt").read_text(), flags=re.M).group(1)
    subprocess.run([cmake, "--install", build, "--prefix", tmp_path / "prefix"], check=True, capture_output=True)
    (config,) = (tmp_path / "prefix").rglob("gpurt-config.cmake")
    subprocess.run([sys.executable, "-c", f"from scikit_build_core.build import build_sdist; build_sdist({str(tmp_path)!r})"],
                   check=True, capture_output=True, cwd=ROOT)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as sources:
        names = {name.partition("/")[2] for name in sources.getnames()}
    # All that compiles the library where there is none, and no more.
    assert {"CMakeLists.txt", "LICENSE", "include/gpurt.h", "lib/api/scene.cpp", "cmake/GpurtInstall.cmake",
            "tools/gpurt/CMakeLists.txt", "bindings/python/src/_core/module.cpp"} <= names
    assert not any(name.startswith(("tests/", "docs/", "build/", "out/", ".venv/")) for name in names)
    built = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--no-build-isolation", "--no-deps", "--no-index", "-w", tmp_path / "wheel",
         archive], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env={"PATH": f"{pathlib.Path(cmake).parent}:{pathlib.Path(sys.executable).parent}:/usr/bin:/bin",
             "HOME": str(pathlib.Path.home()), "CMAKE_ARGS": f"-Dgpurt_DIR={config.parent}",
             "CMAKE_CXX_COMPILER_LAUNCHER": "ccache"})
    assert built.returncode == 0, built.stdout
    (wheel,) = (tmp_path / "wheel").glob("*.whl")
    assert wheel.name.startswith(f"gpurt-{gpurt.__version__}-cp")
    import zipfile
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    names = {p.name for p in (tmp_path / "site" / "gpurt").iterdir()}
    assert {"__init__.py", "_core.pyi", "py.typed", "chart"} <= names
    code = ("import gpurt, numpy; s = gpurt.Scene(gpurt.Device('cpu')); s.add_mesh(numpy.eye(3)); "
            "print(gpurt.__file__, s.commit().trace(origins=(0, 0, 0), directions=(1, 1, 1))['primitive'])")
    ran = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, cwd=tmp_path,
                         env={"PYTHONPATH": str(tmp_path / "site")})
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.split() == [str(tmp_path / "site" / "gpurt" / "__init__.py"), "0"]
