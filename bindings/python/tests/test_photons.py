"""Photon maps: answers of numpy, arrays on a GPU, files, and what is refused."""

import pickle

import numpy as np
import pytest
from conftest import make_box
from test_interop import KINDS, Kind

import gpurt

rng = np.random.default_rng(1)
POINTS = rng.random((3000, 3), np.float32)
PLACES = rng.random((40, 5, 3), np.float32)


def distances_of(places, points=POINTS):
    return np.linalg.norm(places[..., None, :].astype(float) - points.astype(float), axis=-1)


@pytest.fixture(scope="module")
def device():
    return gpurt.Device("cpu")


@pytest.fixture(scope="module")
def photons(device):
    return gpurt.PhotonMap(POINTS, fluxes=np.full((3000, 3), (1, 0.5, 0), np.float32), normals=POINTS - 0.5, radius=0.1,
                           levels=2, device=device)


def test_counts_sums_and_lists_are_those_of_numpy(photons):
    inside = distances_of(PLACES) < 0.1
    counts = photons.count(PLACES)
    assert counts.dtype == np.uint32 and np.array_equal(counts, inside.sum(-1))
    assert np.array_equal(photons.count(PLACES, 0.2), (distances_of(PLACES) < 0.2).sum(-1))
    assert np.array_equal(photons.count(PLACES, method="node_lists"), counts)
    sums = photons.sum(PLACES)
    assert sums.shape == (40, 5, 3) and np.array_equal(sums, counts[..., None] * np.float32([1, 0.5, 0]))
    cone = photons.sum(PLACES, kernel="cone")
    expected = np.where(inside, 1 - distances_of(PLACES) / np.float32(0.1), 0).sum(-1)
    assert np.allclose(cone[..., 0], expected, rtol=1e-4, atol=1e-5)
    ids, distances, offsets = photons.within(PLACES)
    assert offsets.dtype == np.uint64 and offsets[-1] == counts.sum() == len(ids) == len(distances)
    flat = inside.reshape(-1, 3000)
    for i in range(len(flat)):
        part = slice(int(offsets[i]), int(offsets[i + 1]))
        assert np.array_equal(np.sort(ids[part]), np.nonzero(flat[i])[0])
        assert np.allclose(distances[part], distances_of(PLACES.reshape(-1, 3)[i])[ids[part]], rtol=1e-5)


def test_nearest_are_those_of_numpy(photons):
    ids, distances = photons.nearest(PLACES, 7)
    expected = np.sort(distances_of(PLACES), -1)[..., :7]
    assert ids.shape == (40, 5, 7) and np.allclose(distances, expected, rtol=1e-5)
    assert np.array_equal(ids, np.argsort(distances_of(PLACES), -1)[..., :7])
    ids, distances = photons.nearest(PLACES[0, 0], 5, radius=0.01, hint=0.02)
    assert ids.shape == (5,) and ids[-1] == gpurt.INVALID_ID and np.isinf(distances[-1])


def test_normals_and_sequences(photons):
    normals = np.ones_like(PLACES)
    like = (POINTS - 0.5) @ np.ones(3) > 0
    counts = photons.count(PLACES, normals=normals)
    expected = ((distances_of(PLACES) < 0.1) & like).sum(-1)
    assert np.abs(counts.astype(int) - expected).max() <= 1  # where normals are at a right angle
    assert photons.count([[0.5, 0.5, 0.5]]).shape == (1,)
    assert photons.count([0.5, 0.5, 0.5]).shape == ()
    assert photons.count(np.zeros((0, 3))).shape == (0,)
    assert photons.nearest([[np.nan, 0, 0]], 2)[0].tolist() == [[gpurt.INVALID_ID] * 2]


def test_a_radius_is_chosen_and_told(device):
    info = gpurt.PhotonMap(POINTS, device=device).info
    assert 0.02 < info.radius < 0.5 and info.num_points == 3000 and not info.has_fluxes
    assert info.bounds_min == tuple(POINTS.min(0).tolist()) and info.bounds_max == tuple(POINTS.max(0).tolist())
    assert "3000 points" in repr(gpurt.PhotonMap(POINTS, device=device))


def test_files(photons, device, tmp_path):
    path = tmp_path / "map.gpurt"
    photons.save(path)
    loaded = gpurt.PhotonMap.load(path, device)
    assert len(loaded) == 3000 and np.array_equal(loaded.sum(PLACES), photons.sum(PLACES))
    with pytest.raises(gpurt.FileError):
        gpurt.PhotonMap.load(tmp_path / "none", device)
    with pytest.raises(TypeError, match="save it"):
        pickle.dumps(photons)


def test_photons_of_a_scene(device):
    box = make_box(device)
    traced = box.trace_photons(20000, seed=3, max_depth=9, levels=2)
    info = traced.info
    assert info.num_paths == 20000 and info.has_directions and info.num_levels == 2 and len(traced) > 5000
    fluxes, directions = traced.read("flux"), traced.read("direction")
    assert fluxes.shape == (len(traced), 3) and np.allclose(np.linalg.norm(directions, axis=-1), 1, atol=1e-6)
    assert (np.sum(traced.read("normal") * directions, -1) < 0).all()
    inside = distances_of(np.zeros(3), traced.read()) < 1.1
    assert np.allclose(traced.sum([0, 0, 0], 1.1), fluxes[inside].sum(0, dtype=float), rtol=1e-4)
    # 0.64 m^2 shine with pi times the radiance; the room is open, and no wall keeps more than 0.8.
    power = np.pi * 0.64 * np.array([10, 9, 8])
    assert (fluxes.sum(0, dtype=float) < 4 * power).all() and fluxes.sum() > 0.5 * power.sum()
    other = box.trace_photons(20000, seed=3, pass_index=1, frame_index=1, max_depth=9)
    assert not np.array_equal(other.read()[:100], traced.read()[:100])
    with pytest.raises(gpurt.InvalidArgument, match="no light"):
        dark = gpurt.Scene(device)
        dark.add_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
        dark.commit().trace_photons(100)


def test_refusals(photons, device):
    for call, text in (
        (lambda: gpurt.PhotonMap(np.zeros((3, 2)), device=device), "positions"),
        (lambda: gpurt.PhotonMap([[0, 0, np.inf]], device=device), r"positions\[0\]"),
        (lambda: gpurt.PhotonMap(POINTS, fluxes=POINTS[1:], device=device), "fluxes"),
        (lambda: gpurt.PhotonMap(POINTS, fluxes=-POINTS, device=device), r"fluxes\[0\]"),
        (lambda: gpurt.PhotonMap(POINTS, radius=0, device=device), "radius"),
        (lambda: gpurt.PhotonMap(POINTS, levels=9, device=device), "num_levels"),
        (lambda: photons.count(PLACES, 0), "radius"),
        (lambda: photons.count(PLACES, -1), "radius"),
        (lambda: photons.count(PLACES, normals=PLACES[0]), "normals"),
        (lambda: photons.nearest(PLACES, 0), "k is 0"),
        (lambda: photons.sum(PLACES, kernel="box"), "kernel"),
        (lambda: photons.read("direction"), "gpurt_photon_map_trace"),
        (lambda: photons.read("colour"), "attribute"),
        (lambda: gpurt.PhotonMap(POINTS, device=device).sum(PLACES), "fluxes"),
    ):
        with pytest.raises(gpurt.InvalidArgument, match=text):
            call()


@pytest.mark.parametrize("name", KINDS)
def test_arrays_of_other_libraries(name, photons, device):
    kind = Kind(*KINDS[name])
    mine = gpurt.Device("cuda") if kind.on_gpu else device
    points = gpurt.PhotonMap(kind.make(POINTS), fluxes=kind.make(np.full((3000, 3), (1, 0.5, 0), np.float32)),
                             normals=kind.make(POINTS - 0.5), radius=0.1, levels=2, device=mine)
    places = kind.make(PLACES)
    normals = kind.make(np.ones_like(PLACES))
    to_numpy = kind.to_numpy if kind.on_gpu else np.asarray
    assert np.array_equal(to_numpy(points.count(places)), photons.count(PLACES))
    assert np.array_equal(to_numpy(points.sum(places, kernel="cone", normals=normals)),
                          photons.sum(PLACES, kernel="cone", normals=np.ones_like(PLACES)))
    for mine_part, part in zip(points.within(places), photons.within(PLACES)):
        assert np.array_equal(to_numpy(mine_part), part)
    for mine_part, part in zip(points.nearest(places, 9), photons.nearest(PLACES, 9)):
        assert np.array_equal(to_numpy(mine_part), part)
    if kind.on_gpu:
        assert kind.is_mine(points.count(places))
