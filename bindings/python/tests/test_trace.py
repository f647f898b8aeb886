"""Ray queries: shapes, layouts, formats, and the truth of what they say."""

import numpy as np
import pytest
from conftest import make_box, sphere

import gpurt


@pytest.fixture(scope="module")
def ball(device):
    scene = gpurt.Scene(device)
    scene.add_mesh(*sphere(4))
    return scene.commit("kdtree")


@pytest.fixture(scope="module")
def rays():
    rng = np.random.default_rng(5)
    return gpurt.make_rays(rng.normal(size=(1000, 3)), rng.normal(size=(1000, 3)))


def test_hits_lie_on_the_triangles(ball, rays):
    hits = ball.trace(rays)
    assert hits.dtype == gpurt.hit_dtype and hits.shape == (1000,)
    found = hits["primitive"] != gpurt.INVALID_ID
    assert 200 < found.sum() < 950
    vertices, indices = sphere(4)
    corners = vertices[indices[hits["primitive"][found]]].astype(np.float64)
    u, v = hits["u"][found, None], hits["v"][found, None]
    on_triangle = corners[:, 0] * (1 - u - v) + corners[:, 1] * u + corners[:, 2] * v
    on_ray = rays[found, 0:3] + hits["t"][found, None].astype(np.float64) * rays[found, 4:7]
    assert np.abs(on_triangle - on_ray).max() < 1e-5  # float32 at distances up to about 10
    assert np.isinf(hits["t"][~found]).all()
    assert (hits["geometry"][found] == 0).all() and (hits["instance"][~found] == gpurt.INVALID_ID).all()


def test_formats_agree(ball, rays):
    full, compact = ball.trace(rays), ball.trace(rays, format="compact")
    assert compact.dtype == gpurt.hit_compact_dtype
    for name in compact.dtype.names:
        assert (full[name] == compact[name]).all()


def test_queries_agree(ball, rays):
    closest = ball.trace(rays)
    found = closest["primitive"] != gpurt.INVALID_ID
    occluded = ball.trace(rays, query="any")
    assert occluded.dtype == np.bool_ and (occluded == found).all()

    hits, offsets = ball.trace(rays, query="all")
    assert offsets.dtype == np.uint64 and offsets.shape == (1001,) and offsets[0] == 0 and offsets[-1] == len(hits)
    counts = np.diff(offsets.astype(np.int64))
    assert ((counts > 0) == found).all()
    outside = np.linalg.norm(rays[:, :3], axis=1) > 1.01
    assert (counts[outside] % 2 == 0).all(), "a ray from outside crosses a closed surface an even number of times"
    first = hits[offsets[:-1][found].astype(np.int64)]
    assert (first == closest[found]).all()
    for i in np.flatnonzero(counts > 1):
        t = hits["t"][int(offsets[i]):int(offsets[i + 1])]
        assert (np.diff(t) >= 0).all()
    compact, _ = ball.trace(rays, query="all", format="compact")
    assert (compact["t"] == hits["t"]).all()


def test_no_rays_and_no_hits(ball):
    none = np.zeros((0, 8), np.float32)
    assert ball.trace(none).shape == (0,)
    assert ball.trace(none, query="any").shape == (0,)
    hits, offsets = ball.trace(none, query="all")
    assert hits.shape == (0,) and offsets.tolist() == [0]
    hits, offsets = ball.trace(gpurt.make_rays([(9, 9, 9)], (0, 1, 0)), query="all")
    assert hits.shape == (0,) and offsets.tolist() == [0, 0]


def test_shapes_are_kept(ball, rays):
    shaped = rays.reshape(10, 20, 5, 8)
    assert (ball.trace(shaped) == ball.trace(rays).reshape(10, 20, 5)).all()
    assert ball.trace(shaped, query="any").shape == (10, 20, 5)
    assert ball.trace(rays[0]).shape == ()


@pytest.mark.parametrize("convert", [
    lambda r: r.astype(np.float64), lambda r: np.asfortranarray(r), lambda r: np.repeat(r, 2, 0)[::2],
    lambda r: np.concatenate([r, r], 1)[:, :8], lambda r: r.tolist(), lambda r: r.astype(">f4")])
def test_any_layout_gives_the_same_hits(ball, rays, convert):
    assert (ball.trace(convert(rays[:100])) == ball.trace(rays[:100])).all()


def test_packed_float32_rays_are_not_copied(rays):
    from gpurt._trace import check_rays
    assert np.shares_memory(check_rays(rays), rays)
    read_only = rays.copy()
    read_only.flags.writeable = False
    assert np.shares_memory(check_rays(read_only), read_only)
    assert not np.shares_memory(check_rays(rays[::2]), rays)


def test_origins_and_directions(ball, rays):
    o, d = rays[:, 0:3], rays[:, 4:7]
    assert (ball.trace(origins=o, directions=d) == ball.trace(rays)).all()
    limited = rays.copy()
    limited[:, 3], limited[:, 7] = 0.5, 1.5
    assert (ball.trace(origins=o, directions=d, tmin=0.5, tmax=1.5) == ball.trace(limited)).all()
    assert ball.trace(origins=(0, 0, 3), directions=d.reshape(10, 100, 3)).shape == (10, 100)
    made = gpurt.make_rays((1, 2, 3), d, tmin=np.arange(1000), tmax=7)
    assert made.shape == (1000, 8) and (made[:, 3] == np.arange(1000)).all() and (made[:, 7] == 7).all()


def test_results_go_where_they_are_wanted(ball, rays):
    hits = np.empty(1000, gpurt.hit_dtype)
    assert ball.trace(rays, out=hits) is hits and (hits == ball.trace(rays)).all()
    flags = np.empty(1000, np.bool_)
    assert ball.trace(rays, query="any", out=flags) is flags and (flags == ball.trace(rays, query="any")).all()


def test_long_batches_are_cut(ball, rays, monkeypatch):
    from gpurt import _trace
    expected = ball.trace(rays), ball.trace(rays, query="any"), *ball.trace(rays, query="all")
    monkeypatch.setattr(_trace, "RAYS_PER_CALL", 37)
    found = ball.trace(rays), ball.trace(rays, query="any"), *ball.trace(rays, query="all")
    for a, b in zip(expected, found):
        assert (a == b).all()


def test_hints_change_no_bits(ball, rays):
    expected, occluded = ball.trace(rays), ball.trace(rays, query="any")
    for coherence in ("auto", "coherent", "incoherent"):
        assert (ball.trace(rays.reshape(50, 20, 8), coherence=coherence).reshape(-1) == expected).all()
        assert (ball.trace(rays, query="any", coherence=coherence) == occluded).all()
    with pytest.raises(gpurt.InvalidArgument, match="coherence"):
        ball.trace(rays, coherence="sorted")


def test_rays_that_miss_by_definition(ball):
    nan, inf = np.nan, np.inf
    odd = np.array([
        [0, 0, 0, 0, 0, 0, 0, inf], [0, 0, 0, 0, nan, 0, 1, inf], [nan, 0, 0, 0, 0, 0, 1, inf],
        [0, 0, 0, 2, 0, 0, 1, 1], [0, 0, inf, 0, 0, 0, 1, inf]], np.float32)
    assert (ball.trace(odd)["primitive"] == gpurt.INVALID_ID).all()
    assert not ball.trace(odd, query="any").any()


def test_hit_layout_is_the_c_librarys():
    assert gpurt.hit_dtype.itemsize == 32 and gpurt.hit_compact_dtype.itemsize == 16
    assert gpurt.kdtree_node_dtype.itemsize == 8
    assert [gpurt.hit_dtype.fields[n][1] for n in gpurt.hit_dtype.names] == [0, 4, 8, 12, 16, 20]


def test_the_same_bits_from_many_threads(ball, rays):
    import concurrent.futures
    expected = ball.trace(rays)
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        for hits in pool.map(lambda _: ball.trace(rays), range(64)):
            assert (hits == expected).all()


def test_one_device_many_scenes_in_threads(device, rays):
    import concurrent.futures

    def work(i):
        scene = make_box(device, ("kdtree", "embree")[i % 2])
        return scene.trace(rays, query="any").sum()

    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(work, range(16)))) == 1
