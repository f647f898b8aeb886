"""Arrays of PyTorch, CuPy, JAX and numpy in and out of queries, and as the memory of meshes, without copies.

Kinds whose library or GPU is missing are skipped. On a machine with a GPU: python3 scripts/gpu_python.py
"""

import ctypes
import gc
import importlib.util
import os
import time
import weakref

import numpy as np
import pytest
from conftest import sphere

import gpurt
from gpurt import _core, _foreign

os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")


def gpu_device():
    return next((d for d in gpurt.devices() if d.type == "cuda"), None)


class Kind:
    """A library's arrays on a device."""

    def __init__(self, library, on_gpu):
        self.library, self.on_gpu = library, on_gpu
        if importlib.util.find_spec(library) is None:
            pytest.skip(f"{library} is not installed")
        if on_gpu and gpu_device() is None:
            pytest.skip("no CUDA device")
        self.module = pytest.importorskip("jax.numpy" if library == "jax" else library)
        if library == "jax":
            import jax
            platforms = {d.platform for d in jax.devices()}
            if on_gpu and "gpu" not in platforms:
                pytest.skip("this JAX has no GPU")
            self.device = jax.devices("gpu" if on_gpu else "cpu")[0]

    def make(self, array):
        if self.library == "torch":
            return self.module.from_numpy(np.array(array)).to("cuda:0" if self.on_gpu else "cpu")
        if self.library == "jax":
            import jax
            return jax.device_put(array, self.device)
        return self.module.array(array)

    def to_numpy(self, array):
        if self.library == "torch":
            return array.cpu().numpy()
        return array.get() if self.library == "cupy" else np.asarray(array)

    def address(self, array):
        if self.library == "torch":
            return array.data_ptr()
        if self.library == "cupy":
            return array.data.ptr
        return array.unsafe_buffer_pointer() if self.library == "jax" else array.ctypes.data

    def is_mine(self, array):
        if type(array).__module__.partition(".")[0] not in (self.library, self.library + "lib"):
            return False
        if self.library == "torch":
            return array.is_cuda == self.on_gpu
        if self.library == "jax":
            return array.devices() == {self.device}
        return True


KINDS = {"torch": ("torch", False), "jax": ("jax", False), "torch-cuda": ("torch", True), "cupy-cuda": ("cupy", True),
         "jax-cuda": ("jax", True)}


@pytest.fixture(scope="module", params=KINDS)
def kind(request):
    return Kind(*KINDS[request.param])


@pytest.fixture(scope="module", params=[k for k in KINDS if k.endswith("cuda")])
def gpu_kind(request):
    return Kind(*KINDS[request.param])


def make_ball(device):
    scene = gpurt.Scene(device)
    scene.add_mesh(*sphere(4))
    return scene.commit("bvh")


@pytest.fixture(scope="module")
def ball(kind):
    return make_ball(gpurt.Device("cuda") if kind.on_gpu else gpurt.Device("cpu", threads=2))


@pytest.fixture(scope="module")
def rays():
    rng = np.random.default_rng(5)
    return gpurt.make_rays(rng.normal(size=(1000, 3)), rng.normal(size=(1000, 3)))


class Spy:
    """Notes what a scene is asked, by address."""

    def __init__(self, scene, monkeypatch):
        self.core, self.calls = scene._core, []
        monkeypatch.setattr(scene, "_core", self)

    def trace_memory(self, query, format, in_device_memory, num_rays, rays, hits, hit_capacity, occluded, offsets, stream,
                     *hints):
        self.calls.append({"gpu": in_device_memory, "rays": rays, "hits": hits, "occluded": occluded, "stream": stream})
        self.core.trace_memory(query, format, in_device_memory, num_rays, rays, hits, hit_capacity, occluded, offsets,
                               stream, *hints)

    def trace(self, query, format, rays, hits, occluded, offsets, *hints):
        address = [a is not None and a.ctypes.data for a in (rays, hits, occluded)]
        self.calls.append(dict(zip(("rays", "hits", "occluded"), address)))
        self.core.trace(query, format, rays, hits, occluded, offsets, *hints)

    def __getattr__(self, name):
        return getattr(self.core, name)


def same_bits(kind, hits, expected):
    """Hits of a library against a structured array."""
    for name in hits.names:
        column = hits[name]
        assert kind.is_mine(column)
        found, wanted = kind.to_numpy(column), expected[name]
        assert found.shape == wanted.shape and found.dtype.itemsize == 4
        assert (np.ascontiguousarray(found).view(np.uint32) == np.ascontiguousarray(wanted).view(np.uint32)).all(), name


@pytest.mark.parametrize("format", ["full", "compact"])
def test_hits_are_of_the_rays_kind(kind, ball, rays, format):
    expected = ball.trace(rays, format=format)
    hits = ball.trace(kind.make(rays), format=format)
    assert isinstance(hits, gpurt.Hits) and kind.is_mine(hits.packed) and hits.shape == (1000,)
    same_bits(kind, hits, expected)
    assert (kind.to_numpy(hits.t) == expected["t"]).all()
    with pytest.raises(KeyError, match="'w' is none of 't', 'u', 'v'"):
        hits["w"]
    if format == "compact":
        with pytest.raises(AttributeError, match="use format='full'"):
            hits.instance


def test_shapes_are_kept(kind, ball, rays):
    shaped = rays.reshape(10, 20, 5, 8)
    same_bits(kind, ball.trace(kind.make(shaped)), ball.trace(shaped))
    assert tuple(ball.trace(kind.make(shaped), query="any").shape) == (10, 20, 5)
    assert ball.trace(kind.make(rays[0])).shape == ()
    assert ball.trace(kind.make(rays[:0])).shape == (0,)


def test_occlusion_is_bool(kind, ball, rays):
    occluded = ball.trace(kind.make(rays), query="any")
    assert kind.is_mine(occluded)
    found = kind.to_numpy(occluded)
    assert found.dtype == np.bool_ and (found == ball.trace(rays, query="any")).all()


def test_all_hits(kind, ball, rays):
    expected, expected_offsets = ball.trace(rays, query="all")
    hits, offsets = ball.trace(kind.make(rays), query="all")
    assert kind.is_mine(offsets)
    assert (kind.to_numpy(offsets).astype(np.uint64) == expected_offsets).all()
    same_bits(kind, hits, expected)
    hits, offsets = ball.trace(kind.make(gpurt.make_rays([(9, 9, 9)], (0, 1, 0))), query="all")
    assert hits.shape == (0,) and kind.to_numpy(offsets).tolist() == [0, 0]


def test_rays_are_packed_where_they_are(kind, ball, rays):
    origins, directions = kind.make(rays[:, 0:3]), kind.make(rays[:, 4:7])
    made = gpurt.make_rays(origins, directions, 0.5, kind.make(rays[:, 3] + 2))
    assert kind.is_mine(made)
    wanted = gpurt.make_rays(rays[:, 0:3], rays[:, 4:7], 0.5, 2)
    assert (kind.to_numpy(made) == wanted).all()
    same_bits(kind, ball.trace(origins=origins, directions=directions, tmin=0.5, tmax=2), ball.trace(wanted))
    with pytest.raises(gpurt.InvalidArgument, match=r"origins: expected \[...\]\[3\], got \[1000\]\[4\]"):
        gpurt.make_rays(kind.make(rays[:, :4]), directions)


def test_nothing_is_copied(kind, ball, rays, monkeypatch):
    """What the library reads and writes is where the caller's arrays are."""
    mine = kind.make(rays)
    spy = Spy(ball, monkeypatch)
    hits = ball.trace(mine)
    assert [c["rays"] for c in spy.calls] == [kind.address(mine)]
    # JAX may move an array in host memory that its alignment rules do not like; ours is made for them.
    assert [c["hits"] for c in spy.calls] == [kind.address(hits.packed)]
    assert spy.calls[0]["gpu"] == kind.on_gpu and (spy.calls[0]["stream"] is not None) == kind.on_gpu


@pytest.mark.parametrize("where", ["cpu", "cuda"])
def test_numpy_arrays_are_used_where_they_are(where, rays, monkeypatch):
    """On a GPU too the library is handed the arrays themselves."""
    if where == "cuda" and gpu_device() is None:
        pytest.skip("no CUDA device")
    ball = make_ball(gpurt.Device(where))
    spy = Spy(ball, monkeypatch)
    hits, flags = ball.trace(rays), ball.trace(rays, query="any")
    again = np.zeros_like(hits)
    assert ball.trace(rays, out=again) is again and (again == hits).all()
    assert type(hits) is type(flags) is np.ndarray
    assert [c["rays"] for c in spy.calls] == 3 * [rays.ctypes.data]
    assert [c["hits"] or c["occluded"] for c in spy.calls] == [a.ctypes.data for a in (hits, flags, again)]


def test_results_go_where_they_are_wanted(kind, ball, rays):
    mine = kind.make(rays)
    hits = ball.trace(mine)
    if kind.library == "jax":
        with pytest.raises(gpurt.InvalidArgument, match="out: arrays of this library never change"):
            ball.trace(mine, out=hits)
        return
    again = kind.make(np.zeros((1000, 8), np.float32))
    found = ball.trace(mine, out=again)
    assert found.packed is again
    same_bits(kind, found, ball.trace(rays))
    assert ball.trace(mine, out=hits).packed is hits.packed
    flags = kind.make(np.zeros(1000, np.bool_))
    assert ball.trace(mine, query="any", out=flags) is flags
    assert (kind.to_numpy(flags) == ball.trace(rays, query="any")).all()
    with pytest.raises(gpurt.InvalidArgument, match=r"out: expected a writeable array without gaps of float32 "
                                                    r"\[1000\]\[4\], got float32 \[1000\]\[8\] in .*; make such a one"):
        ball.trace(mine, format="compact", out=again)


def test_long_batches_in_host_memory_are_cut(kind, ball, rays, monkeypatch):
    if kind.on_gpu:
        pytest.skip("queued at once")
    from gpurt import _trace
    monkeypatch.setattr(_trace, "RAYS_PER_CALL", 37)
    same_bits(kind, ball.trace(kind.make(rays)), ball.trace(rays))
    assert (kind.to_numpy(ball.trace(kind.make(rays), query="any")) == ball.trace(rays, query="any")).all()


def test_meshes_of_any_library(kind, ball, rays):
    vertices, indices = sphere(4)
    scene = gpurt.Scene(ball.device)
    scene.add_mesh(kind.make(vertices), kind.make(indices.astype(np.int32)), normals=kind.make(vertices),
                   uvs=kind.make(vertices[:, :2]))
    scene.commit("bvh")
    assert (scene.trace(rays) == ball.trace(rays)).all()
    flat = gpurt.Scene(ball.device)
    flat.add_mesh(kind.make(vertices[indices]))  # [m][3][3]
    assert (flat.commit("bvh").trace(rays)["t"] == ball.trace(rays)["t"]).all()


def test_what_a_gpu_cannot_read_is_refused_with_the_remedy(gpu_kind, rays):
    kind = gpu_kind
    ball = make_ball(gpurt.Device("cuda"))
    place = r"in the memory of CUDA device 0; "
    with pytest.raises(gpurt.InvalidArgument, match=r"rays: expected float32, got float16 \[1000\]\[8\] " + place):
        ball.trace(kind.make(rays.astype(np.float16)))
    with pytest.raises(gpurt.InvalidArgument, match=r"rays: expected \[...\]\[8\] .*, got float32 \[1000\]\[7\] " + place):
        ball.trace(kind.make(np.ascontiguousarray(rays[:, :7])))
    if kind.library != "jax":
        with pytest.raises(gpurt.InvalidArgument, match=r"rays: expected rays without gaps, not strides \(16, 1\)"):
            ball.trace(kind.make(np.concatenate([rays, rays], 1))[:, :8])
    with pytest.raises(gpurt.InvalidArgument, match=r"rays: lies on CUDA device 0, but the scene on the CPU; .* or make"):
        make_ball(gpurt.Device("cpu", threads=1)).trace(kind.make(rays))
    vertices, indices = sphere(0)
    scene = gpurt.Scene(ball.device)
    with pytest.raises(gpurt.InvalidArgument, match=r"indices: expected uint32 or int32, .*got int16 \[8\]\[3\] " + place):
        scene.add_mesh(kind.make(vertices), kind.make(indices.astype(np.int16)))
    with pytest.raises(gpurt.InvalidArgument, match=r"vertices: expected \[n\]\[3\], got float32 \[6\] " + place):
        scene.add_mesh(kind.make(vertices[:, 0]))
    with pytest.raises(gpurt.InvalidArgument, match="texels: lies on another device .* copy it there first"):
        scene.add_texture(kind.make(np.zeros((2, 2, 4), np.uint8)))


def test_memory_of_other_gpus_is_refused_with_the_remedy(rays):
    class Elsewhere:
        def __init__(self, kind):
            self.kind = kind

        def __dlpack__(self, **keywords):
            pytest.fail("it is not asked for")

        def __dlpack_device__(self):
            return self.kind, 7

    if gpu_device() is None:
        pytest.skip("no CUDA device")
    ball = make_ball(gpurt.Device("cuda"))
    scene = gpurt.Scene(ball.device)
    for call, name in ((lambda array: ball.trace(array), "rays"), (lambda array: scene.add_mesh(array), "vertices")):
        with pytest.raises(gpurt.InvalidArgument,
                           match=f"{name}: lies on CUDA device 7, but the scene on 0; copy it to CUDA device 0"):
            call(Elsewhere(2))
        with pytest.raises(gpurt.InvalidArgument, match=f"{name}: lies .*DLPack type 10.*copy it .*"):  # of ROCm
            call(Elsewhere(10))


def test_gradients_are_refused(rays):
    kind = Kind("torch", False)
    ball = make_ball(gpurt.Device("cpu", threads=2))
    with pytest.raises(gpurt.InvalidArgument, match="rays: .*detach"):
        ball.trace(kind.make(rays).requires_grad_())


# ---- the GPU's queues ----

def many_rays():
    rng = np.random.default_rng(7)
    return gpurt.make_rays(rng.normal(size=(1 << 20, 3)), rng.normal(size=(1 << 20, 3)))


def test_torch_streams_are_not_waited_for():
    """Rays that arrive late on the current stream are traced after they are there, and the call does not wait."""
    kind = Kind("torch", True)
    torch = kind.module
    ball, rays = make_ball(gpurt.Device("cuda")), many_rays()
    expected = ball.trace(rays)
    source, mine = kind.make(rays), kind.make(np.zeros_like(rays))
    # Warms up: CUDA loads a kernel when it is first started, and waits for what runs meanwhile.
    ball.trace(source), ball.trace(source, query="any"), torch.cuda.synchronize()
    for stream in (torch.cuda.default_stream(), torch.cuda.Stream()):
        mine.zero_()
        torch.cuda.synchronize()
        with torch.cuda.stream(stream):
            torch.cuda._sleep(int(1e9))  # cycles: about half a second
            mine.copy_(source)
            start = time.perf_counter()
            hits = ball.trace(mine)
            occluded = ball.trace(mine, query="any")
            seconds = time.perf_counter() - start
            assert not stream.query(), "the stream was waited for"
            count = (hits.primitive != -1).sum()  # queued behind the trace
        assert seconds < 0.1
        stream.synchronize()
        same_bits(kind, hits, expected)
        assert int(count) == int(occluded.sum()) == (expected["primitive"] != gpurt.INVALID_ID).sum()


def test_nothing_travels_through_the_host():
    kind = Kind("torch", True)
    torch = kind.module
    ball, mine = make_ball(gpurt.Device("cuda")), kind.make(many_rays())
    ball.trace(mine), ball.trace(mine, query="any"), torch.cuda.synchronize()
    activities = [torch.profiler.ProfilerActivity.CUDA, torch.profiler.ProfilerActivity.CPU]
    with torch.profiler.profile(activities=activities) as profile:
        hits = ball.trace(mine)
        ball.trace(mine, query="any")
        torch.cuda.synchronize()
    names = [e.name for e in profile.events() if e.device_type == torch.autograd.DeviceType.CUDA]
    assert names, "the profiler saw no work on the device"
    assert not [n for n in names if "memcpy" in n.lower() or "HtoD" in n or "DtoH" in n], names
    assert kind.is_mine(hits.packed)


def test_page_locked_memory_is_host_memory():
    kind = Kind("torch", True)
    ball, rays = make_ball(gpurt.Device("cuda")), many_rays()
    expected = ball.trace(rays)
    pinned = kind.module.from_numpy(rays).pin_memory()
    hits = ball.trace(pinned)
    assert not hits.packed.is_cuda
    same_bits(Kind("torch", False), hits, expected)
    vertices, indices = sphere(4)
    scene = gpurt.Scene(ball.device)
    scene.add_mesh(kind.module.from_numpy(vertices).pin_memory(), indices)
    assert (scene.commit("bvh").trace(rays) == expected).all()


def test_managed_memory_is_the_gpus():
    kind = Kind("cupy", True)
    cupy = kind.module
    ball, rays = make_ball(gpurt.Device("cuda")), many_rays()
    expected = ball.trace(rays)
    with cupy.cuda.using_allocator(cupy.cuda.malloc_managed):
        hits = ball.trace(kind.make(rays))
        same_bits(kind, hits, expected)


def test_cupy_streams_are_kept():
    kind = Kind("cupy", True)
    cupy = kind.module
    spin = cupy.RawKernel(r"""extern "C" __global__ void spin(long long cycles)
        { const long long start = clock64(); while (clock64() - start < cycles) {} }""", "spin")
    ball, rays = make_ball(gpurt.Device("cuda")), many_rays()
    expected = ball.trace(rays)
    source, mine = kind.make(rays), kind.make(np.zeros_like(rays))
    spin((1,), (1,), (1,))
    ball.trace(source)
    stream = cupy.cuda.Stream(non_blocking=True)
    cupy.cuda.Device().synchronize()
    with stream:
        spin((1,), (1,), (500_000_000,))
        mine[...] = source
        start = time.perf_counter()
        hits = ball.trace(mine)
        seconds = time.perf_counter() - start
        assert not stream.done, "the stream was waited for"
        assert seconds < 0.1
    stream.synchronize()
    same_bits(kind, hits, expected)


def test_jax_computes_on_hits_in_order():
    """Rays that JAX still computes, hits that it computes with at once, and arrays that are dropped meanwhile."""
    kind = Kind("jax", True)
    import jax
    jnp = kind.module
    ball, rays = make_ball(gpurt.Device("cuda")), many_rays()
    expected = ball.trace(rays)
    found = int((expected["primitive"] != gpurt.INVALID_ID).sum())

    @jax.jit
    def slow_identity(r):
        big = jnp.ones((4096, 4096))
        for _ in range(20):
            big = big @ big * 1e-4
        return r + 0 * jnp.nan_to_num(big[0, 0], posinf=0, neginf=0)

    mine = kind.make(rays)
    slow_identity(mine).block_until_ready()
    for _ in range(5):
        hits = ball.trace(slow_identity(mine))
        assert int((hits.primitive != jnp.uint32(gpurt.INVALID_ID)).sum()) == found
        same_bits(kind, hits, expected)
    for _ in range(20):
        ball.trace(slow_identity(mine))  # dropped at once
    gc.collect()
    same_bits(kind, ball.trace(mine), expected)


class CudaArray:
    """An array that has the CUDA array interface alone."""

    def __init__(self, array, stream=None):
        self.array, self.stream = array, stream

    @property
    def __cuda_array_interface__(self):
        return {**self.array.__cuda_array_interface__, "version": 3, "stream": self.stream}


def test_the_cuda_array_interface(monkeypatch):
    kind = Kind("cupy", True)
    cupy = kind.module
    ball, rays = make_ball(gpurt.Device("cuda")), many_rays()
    expected = ball.trace(rays)
    side = cupy.cuda.Stream(non_blocking=True)
    spy = Spy(ball, monkeypatch)
    for stream in (None, side.ptr):
        mine = kind.make(rays)
        hits = ball.trace(CudaArray(mine, stream))
        assert isinstance(hits.packed, gpurt.DeviceArray)
        assert spy.calls[-1]["rays"] == kind.address(mine) and spy.calls[-1]["hits"] == hits.packed.data
        assert cupy.asarray(hits.packed).data.ptr == cupy.from_dlpack(hits.packed).data.ptr == hits.packed.data
        same_bits(kind, gpurt.Hits(_foreign.library_of(kind.make(rays)), cupy.asarray(hits.packed)), expected)
        assert (np.asarray(hits.packed).view(np.uint32)[:, 3] == expected["primitive"]).all()
        assert (cupy.from_dlpack(hits.packed).view(cupy.uint32).get() == np.asarray(hits.packed).view(np.uint32)).all()
    occluded = ball.trace(CudaArray(kind.make(rays)), query="any")
    assert (cupy.asarray(occluded).get() == ball.trace(rays, query="any")).all()
    again, offsets = ball.trace(CudaArray(kind.make(rays)), query="all")
    assert int(np.asarray(offsets)[-1]) == again.shape[0] == len(ball.trace(rays, query="all")[0])
    scene = gpurt.Scene(ball.device)
    vertices, indices = sphere(4)
    scene.add_mesh(CudaArray(kind.make(vertices)), CudaArray(kind.make(indices)))
    assert (scene.commit("bvh").trace(rays) == expected).all()


# ---- shared host memory ----

class Watched(np.ndarray):
    """An array whose end can be seen."""


def test_shared_arrays_are_read_where_they_are_and_given_back(device, rays):
    vertices, indices = sphere(3)
    kept = vertices.copy().view(Watched)
    watch = weakref.ref(kept)
    scene = gpurt.Scene(device)
    scene.add_mesh(kept, indices, share=True)
    first = scene.commit("kdtree").trace(rays)
    kept *= 2
    assert (scene.trace(rays) == first).all(), "a commit is not disturbed"
    second = scene.commit("kdtree").trace(rays)
    expected = gpurt.Scene(device)
    expected.add_mesh(vertices * 2, indices)
    assert (second == expected.commit("kdtree").trace(rays)).all(), "the scene reads the array itself"
    with pytest.raises(gpurt.InvalidArgument, match="vertex"):
        kept[3] = np.nan
        scene.commit()
    del kept
    gc.collect()
    assert watch() is not None, "the scene needs it"
    del scene
    gc.collect()
    device.properties  # what the library gave back goes at the next call
    assert watch() is None


def test_shared_arrays_may_be_strided(device, rays):
    vertices, indices = sphere(3)
    wide = np.zeros((len(vertices), 5), np.float32)
    wide[:, 1:4] = vertices
    scenes = [gpurt.Scene(device) for _ in range(2)]
    scenes[0].add_mesh(wide[:, 1:4], indices.astype(np.int32), normals=wide[:, 1:4], uvs=wide[:, :2], share=True)
    scenes[1].add_mesh(vertices, indices)
    a, b = (s.commit("kdtree").trace(rays) for s in scenes)
    assert (a == b).all()
    empty = gpurt.Scene(device)
    empty.add_mesh(vertices, indices[:0], share=True)
    assert (empty.commit().trace(rays)["primitive"] == gpurt.INVALID_ID).all()


@pytest.mark.parametrize("vertices, text", [
    ([[0, 0, 0]], None),
    (np.zeros((3, 3)), r"vertices: expected float32, .*got float64 \[3\]\[3\] in host memory; convert it to float32"),
    (np.zeros((3, 4), np.float32), r"vertices: expected \[n\]\[3\], got float32 \[3\]\[4\]"),
    (np.zeros((3, 3), np.float32)[::-1], r"vertices: expected packed rows, not strides \(-3, 1\)"),
    (np.zeros((3, 3), np.float32).T, r"vertices: expected packed rows, not strides \(1, 3\)"),
])
def test_what_cannot_be_shared_is_refused(device, vertices, text):
    scene = gpurt.Scene(device)
    with pytest.raises(gpurt.InvalidArgument if text else TypeError, match=text or "share=True needs an array"):
        scene.add_mesh(vertices, share=True)
    assert scene.facts.num_geometries == 0


# ---- DLPack itself ----

def test_own_arrays_go_to_anyone(device):
    array = gpurt.DeviceArray(device._core, (1, 0), (2, 3), "float32")
    as_numpy = np.from_dlpack(array)
    assert as_numpy.shape == (2, 3) and as_numpy.dtype == np.float32 and (as_numpy == 0).all()
    assert as_numpy.ctypes.data == array.data and array.data % 64 == 0
    watch = weakref.ref(array)
    del array
    gc.collect()
    assert watch() is not None, "the numpy array needs it"
    del as_numpy
    gc.collect()
    assert watch() is None
    for dtype in ("bool", "uint8", "int64", "uint32"):
        one = gpurt.DeviceArray(device._core, (1, 0), (4,), dtype)
        assert np.from_dlpack(one).dtype == dtype
    with pytest.raises(BufferError, match="handed out elsewhere"):
        one.__dlpack__(dl_device=(2, 0))


@pytest.mark.parametrize("versioned", [False, True])
def test_capsules_are_taken_once(device, versioned):
    array = gpurt.DeviceArray(device._core, (1, 0), (5, 8), "float32")
    capsule = array.__dlpack__(max_version=(1, 0) if versioned else None)
    watch = weakref.ref(array)
    tensor = _core.BorrowedTensor(capsule)
    assert tensor.shape() == (5, 8) and tensor.strides() == (8, 1) and tensor.dtype() == (2, 32, 1)
    assert tensor.device() == (1, 0) and tensor.data() == array.data and not tensor.read_only()
    with pytest.raises(BufferError, match="taken before"):
        _core.BorrowedTensor(capsule)
    del array, capsule
    gc.collect()
    assert watch() is not None
    del tensor
    gc.collect()
    assert watch() is None
    unused = gpurt.DeviceArray(device._core, (1, 0), (1,), "float32")
    watch = weakref.ref(unused)
    unused.__dlpack__()
    del unused
    gc.collect()
    assert watch() is None, "a capsule that nobody takes holds nothing"


def test_later_versions_are_refused(device):
    array = gpurt.DeviceArray(device._core, (1, 0), (1,), "float32")
    capsule = array.__dlpack__(max_version=(1, 0))
    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.restype, get_pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    version = ctypes.cast(get_pointer(capsule, b"dltensor_versioned"), ctypes.POINTER(ctypes.c_uint32))
    assert version[0] == 1
    version[0] = 2
    with pytest.raises(BufferError, match="version 2; versions 0 and 1"):
        _core.BorrowedTensor(capsule)
    version[0] = 1


def test_an_array_that_only_has_dlpack_gives_numpy_hits(device, rays):
    class Plain:
        def __dlpack__(self, **keywords):
            return rays.__dlpack__(**keywords)

        def __dlpack_device__(self):
            return rays.__dlpack_device__()

    ball = make_ball(device)
    hits = ball.trace(Plain())
    assert isinstance(hits, np.ndarray) and (hits == ball.trace(rays)).all()
