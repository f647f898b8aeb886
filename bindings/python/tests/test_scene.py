"""Descriptions, commits, facts, cameras, tree exchange."""

import math
import os

import numpy as np
import pytest
from conftest import box_quads, make_box, quad, sphere

import gpurt


def down_hits(scene, points):
    return scene.trace(origins=points, directions=(0, -1, 0))


def near(t):
    return pytest.approx(t, rel=1e-6)  # some roundings of float32


def test_facts_count_what_was_added(box):
    f = box.facts
    assert (f.num_geometries, f.num_instances, f.num_materials, f.num_cameras) == (6, 6, 4, 1)
    assert f.num_triangles == f.num_world_triangles == 12
    assert f.num_emissive_triangles == 2
    assert (f.bounds_min, f.bounds_max) == ((-1, -1, -1), (1, 1, 1))
    assert f.is_committed and f.accel == "kdtree" and f.triangle_test == "watertight"
    assert f.num_nodes >= 1 and f.accel_bytes > 0 and f.scene_bytes >= f.accel_bytes and f.build_seconds > 0


def test_before_the_first_commit(device):
    scene = gpurt.Scene(device)
    assert not scene.facts.is_committed and scene.facts.num_nodes == 0
    with pytest.raises(gpurt.InvalidArgument):
        scene.trace(np.zeros((1, 8), np.float32))
    with pytest.raises(gpurt.InvalidArgument):
        scene.render()


def test_an_empty_scene_is_legal(device):
    scene = gpurt.Scene(device).commit()
    assert scene.facts.bounds_min > scene.facts.bounds_max
    hits = down_hits(scene, [(0, 0, 0)])
    assert hits["primitive"][0] == gpurt.INVALID_ID and np.isinf(hits["t"][0])


def test_commit_returns_the_scene_and_is_repeatable(device):
    scene = gpurt.Scene(device)
    assert scene.commit() is scene
    scene.add_mesh(*quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)))
    assert np.isinf(down_hits(scene, [(0, 1, 0)])["t"][0]), "a mesh is not seen before the commit"
    scene.commit()
    assert down_hits(scene, [(0, 1, 0)])["t"][0] == near(1)


def test_a_mesh_can_be_placed_later_and_often(device):
    scene = gpurt.Scene(device)
    placed = scene.add_mesh(*quad((-0.5, 0, 0.5), (1, 0, 0), (0, 0, -1)), transform=False)
    assert placed == (0, None) and placed.instance is None
    for i in range(3):
        assert scene.add_instance(placed.geometry, np.array([[1, 0, 0, 2 * i], [0, 1, 0, i], [0, 0, 1, 0]])) == i
    scene.commit("kdtree")
    assert scene.facts.num_triangles == 2 and scene.facts.num_world_triangles == 6
    hits = down_hits(scene, [(0.1, 10, 0), (2.1, 10, 0), (4.1, 10, 0), (1.0, 10, 0)])
    assert hits["t"].tolist() == [near(10), near(9), near(8), math.inf]
    assert hits["instance"].tolist() == [0, 1, 2, gpurt.INVALID_ID]


@pytest.mark.parametrize("transform", [
    [[1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 1, 0]],
    [[1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]],
])
def test_transforms_have_three_or_four_rows(device, transform):
    scene = gpurt.Scene(device)
    assert scene.add_mesh(*quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), transform=transform) == (0, 0)
    assert down_hits(scene.commit(), [(0, 3, 0)])["t"][0] == near(1)


def soup(vertices, indices):
    return vertices[indices]


@pytest.mark.parametrize("convert", [
    lambda v: v,
    lambda v: v.astype(np.float64),
    lambda v: v.astype(">f4"),
    lambda v: np.asfortranarray(v),
    lambda v: v[::-1][::-1],
    lambda v: np.concatenate([v, v], 1)[:, :3],
    lambda v: np.repeat(v, 2, 0)[::2],
    lambda v: v.tolist(),
    lambda v: [tuple(map(float, row)) for row in v],
    lambda v: memoryview(np.ascontiguousarray(v)),
], ids=["float32", "float64", "big-endian", "fortran", "reversed", "columns", "rows", "lists", "tuples", "buffer"])
def test_any_array_gives_the_same_scene(device, convert):
    vertices, indices = sphere(2)
    rays = gpurt.make_rays(np.random.default_rng(1).normal(size=(200, 3)) * 3, (0, 0, 0.0001))
    rays[:, 4:7] = -rays[:, 0:3]
    expected = gpurt.Scene(device)
    expected.add_mesh(vertices, indices)
    scene = gpurt.Scene(device)
    scene.add_mesh(convert(vertices), indices.astype(np.int64))
    assert (scene.commit("kdtree").trace(rays) == expected.commit("kdtree").trace(rays)).all()


def test_triangles_without_indices(device):
    vertices, indices = sphere(1)
    scene = gpurt.Scene(device)
    scene.add_mesh(soup(vertices, indices))
    scene.add_mesh(soup(vertices, indices).reshape(-1, 3), transform=np.eye(4) * [1, 1, 1, 1])
    assert scene.commit().facts.num_triangles == 2 * len(indices)


class ThroughDlpack:
    """Nothing but the protocol."""

    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **arguments):
        return self.array.__dlpack__(**arguments)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_dlpack_arrays_are_read(device):
    vertices, indices = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2))
    scene = gpurt.Scene(device)
    scene.add_mesh(ThroughDlpack(vertices), ThroughDlpack(indices.astype(np.int64)))
    assert down_hits(scene.commit(), ThroughDlpack(np.array([[0, 3, 0]], np.float32)))["t"][0] == near(3)


def test_arrays_of_another_device_are_refused(device):
    class OnGpu(ThroughDlpack):
        def __dlpack_device__(self):
            return (2, 0)

    with pytest.raises(gpurt.InvalidArgument, match="vertices: lies on CUDA device 0, but the scene on the CPU"):
        gpurt.Scene(device).add_mesh(OnGpu(np.zeros((3, 3), np.float32)))


def test_patches(device):
    """A flat bicubic patch over [0, 1]^2 at y = 0.5."""
    u, v = np.meshgrid(np.arange(4) / 3, np.arange(4) / 3)
    points = np.stack([u, np.full_like(u, 0.5), v], -1)
    for shaped in (points.reshape(1, 16, 3), points[None], points.reshape(16, 3)):
        scene = gpurt.Scene(device)
        assert scene.add_patches(shaped) == (0, 0)
        scene.commit()
        assert scene.facts.num_patches == 1 and scene.facts.num_triangles >= 2
        assert down_hits(scene, [(0.3, 1, 0.6)])["t"][0] == pytest.approx(0.5, abs=1e-6)  # a flat patch: rounding
    with pytest.raises(gpurt.InvalidArgument):
        gpurt.Scene(device).add_patches(points.reshape(16, 3)[:15])


def test_hits_on_patches(device):
    """A flat patch whose parameters are its x and z; a second one beside it."""
    u, v = np.meshgrid(np.arange(4) / 3, np.arange(4) / 3)
    points = np.stack([u, np.full_like(u, 0.5), v], -1).reshape(16, 3)
    scene = gpurt.Scene(device)
    scene.add_patches(np.stack([points, points + [1, 0, 0]]))
    scene.add_camera(look_at_down())
    scene.commit(patch_pixels=0.5, patch_width=64, patch_height=32)
    assert scene.facts.patch_error_pixels < 1e-5  # flat, but for rounding
    hits = down_hits(scene, [(0.25, 1, 0.75), (1.5, 1, 0.125), (5, 1, 5)])
    found, positions, normals = scene.locate(hits, surface=True)
    assert found.dtype == gpurt.patch_point_dtype
    assert found["patch"].tolist() == [0, 1, gpurt.INVALID_ID]
    # Weights are of single precision.
    np.testing.assert_allclose(found["u"], [0.25, 0.5, 0], atol=1e-6)
    np.testing.assert_allclose(found["v"], [0.75, 0.125, 0], atol=1e-6)
    np.testing.assert_allclose(positions[:2], [(0.25, 0.5, 0.75), (1.5, 0.5, 0.125)], atol=1e-6)
    np.testing.assert_allclose(np.abs(normals[:2, 1]), 1, atol=1e-6)
    compact = np.empty(3, gpurt.hit_compact_dtype)
    for name in compact.dtype.names:
        compact[name] = hits[name]
    assert (scene.locate(compact, geometry=0) == found).all()
    assert scene.locate(hits.reshape(3, 1)).shape == (3, 1)
    with pytest.raises(gpurt.InvalidArgument, match="hit 0 is of geometry 7"):
        scene.locate(compact, geometry=7)
    with pytest.raises(gpurt.InvalidArgument, match="hits: expected a numpy array of hit_dtype"):
        scene.locate(np.zeros((3, 8), np.float32))
    with pytest.raises(gpurt.InvalidArgument, match="patch_camera is 1, but the scene has 1 cameras"):
        scene.commit(patch_pixels=1, patch_camera=1)
    with pytest.raises(gpurt.InvalidArgument, match="patch_width is 3, but patch_pixels is 0"):
        scene.commit(patch_width=3)


def look_at_down():
    return gpurt.look_at((0.5, 5, 0.5), (0.5, 0, 0.5), up=(0, 0, 1))


def test_subdivision_is_unsupported(device):
    with pytest.raises(gpurt.Unsupported):
        gpurt.Scene(device).add_subdivision(np.zeros((4, 3)), [4], [0, 1, 2, 3])


def test_textures(device):
    """An emitter shows its texture's row 0 at v = 0."""
    texels = np.zeros((2, 2, 4), np.uint8)
    texels[0] = [255, 0, 0, 255]
    texels[1] = [0, 255, 0, 255]
    scene = gpurt.Scene(device)
    texture = scene.add_texture(texels, filter="nearest", wrap=("clamp", "repeat"))
    assert texture == 1
    assert scene.add_texture(texels[..., :3], srgb=False) == 2
    assert scene.add_texture(texels.astype(np.float64) * 4, wrap="mirror") == 3
    vertices, indices = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    scene.add_mesh(vertices, indices, uvs=[(0, 1), (1, 1), (1, 0), (0, 0)],
                   material=scene.add_material(base_color_texture=texture))
    scene.set_environment(1.0)
    scene.add_camera(position=(0, 0, 3), target=(0, 0, 0), yfov=0.6)
    albedo = scene.commit().render(width=8, height=8, spp=1, outputs=("albedo",)).albedo
    assert albedo[1, 4].tolist() == [1, 0, 0] and albedo[6, 4].tolist() == [0, 1, 0]


def test_lamps_with_textures_seen_through_glass_that_absorbs(device):
    texels = np.zeros((1, 2, 4), np.uint8)
    texels[0, 1] = 255
    scene = gpurt.Scene(device)
    texture = scene.add_texture(texels, filter="nearest", wrap="clamp", srgb=False)
    vertices, indices = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    scene.add_mesh(vertices, indices, uvs=[(0, 0), (1, 0), (1, 1), (0, 1)],
                   material=scene.add_material(base_color=0, emission=(1, 2, 3), emission_texture=texture))
    glass = scene.add_material("glass", attenuation_color=(0, 0.5, 1), attenuation_distance=0.5)
    for vertices, indices in (quad((-2, -2, 1.5), (4, 0, 0), (0, 4, 0)), quad((-2, -2, 1), (0, 4, 0), (4, 0, 0))):
        scene.add_mesh(vertices, indices, material=glass)
    scene.add_camera(position=(0, 0, 5), target=(0, 0, 0), yfov=0.05)
    color = scene.commit().render(width=8, height=8, spp=256, max_depth=3).color[..., :3]
    assert not color[:, :3].any()
    # Both sides pass 0.96 each; what is reflected comes from the black around.
    expected = 0.96 ** 2 * np.array([0, 2 * 0.5, 3])
    assert np.allclose(color[:, 5:].mean(axis=(0, 1)), expected, rtol=0.02)


def test_cameras_look_where_they_are_told(device):
    scene = gpurt.Scene(device)
    assert scene.add_camera(position=(1, 2, 3), target=(1, 2, 0), yfov=0.5, width=7, height=5) == 0
    assert scene.add_camera() == 1
    camera = scene.camera(0)
    assert camera.transform.tolist() == [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3]]
    assert (camera.type, camera.width, camera.height) == ("perspective", 7, 5)
    assert camera.yfov == pytest.approx(0.5)  # float32
    assert scene.camera(1).yfov == pytest.approx(math.pi / 4)
    with pytest.raises(gpurt.InvalidArgument):
        scene.camera(2)
    with pytest.raises(gpurt.Unsupported):
        scene.add_camera(type="orthographic")


def test_look_at():
    m = gpurt.look_at((0, 5, 0), (0, 0, 0), up=(0, 0, -1))
    assert np.allclose(m[:, :3] @ m[:, :3].T, np.eye(3), atol=1e-6)
    assert np.allclose(-m[:, 2], (0, -1, 0)) and np.allclose(m[:, 1], (0, 0, -1)) and np.allclose(m[:, 3], (0, 5, 0))
    with pytest.raises(gpurt.InvalidArgument, match="^up: "):
        gpurt.look_at((0, 5, 0), (0, 0, 0))
    with pytest.raises(gpurt.InvalidArgument, match="^target: "):
        gpurt.look_at((1, 1, 1), (1, 1, 1))


def test_lights_and_environment(device):
    scene = make_box(device)
    assert scene.add_light(intensity=3, position=(0, 0.5, 0)) == 0
    assert scene.add_light("spot", intensity=(1, 2, 3), position=(0, 0.5, 0), inner_cone_angle=0.1,
                           outer_cone_angle=0.4) == 1
    assert scene.add_light("distant", intensity=1, direction=(0, -1, -1)) == 2
    scene.set_environment((0.5, 0.5, 0.5))
    f = scene.commit().facts
    assert (f.num_point_lights, f.num_distant_lights, f.has_environment) == (2, 1, True)


@pytest.mark.parametrize("accel, triangle_test", [
    ("kdtree", "watertight"), ("kdtree", "moller-trumbore"), ("kdtree", "double"), ("embree", "watertight"),
    ("bvh", "watertight"), ("bvh", "double"), ("auto", "watertight")])
def test_accelerators_find_the_same_walls(device, accel, triangle_test):
    scene = make_box(device, accel, triangle_test=triangle_test)
    hits = scene.trace(origins=(0, 0, 0), directions=[(1, 0.3, 0.2), (-1, 0.1, 0.2), (0.1, -1, 0.3), (0.1, 0.3, -1)])
    assert hits["geometry"].tolist() == [4, 3, 0, 2]
    assert np.allclose(hits["t"], 1, rtol=1e-6)


def test_vertices_move(device):
    scene = gpurt.Scene(device)
    vertices = np.array([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], np.float32)
    geometry, _ = scene.add_mesh(vertices)
    ray = {"origins": (0, 0, 5), "directions": [(0, 0, -1)]}
    assert scene.commit("bvh", quality="fast").trace(**ray)["t"][0] == 5
    scene.set_vertices(geometry, vertices + np.array((0, 0, 2), np.float32))
    assert scene.trace(**ray)["t"][0] == 5, "before the commit"
    assert scene.commit("bvh", quality="fast").trace(**ray)["t"][0] == 3
    assert scene.facts.accel_build_seconds > 0
    with pytest.raises(gpurt.InvalidArgument):
        scene.set_vertices(geometry, vertices[:2])


def test_unsupported_accelerators(device):
    scene = make_box(device, "kdtree")
    with pytest.raises(gpurt.Unsupported):
        scene.commit("embree", triangle_test="double")
    assert scene.facts.accel == "kdtree", "a failed commit leaves the previous one in force"


def test_trees_go_out_and_in(device):
    vertices, indices = sphere(3)
    rays = gpurt.make_rays(np.random.default_rng(2).normal(size=(500, 3)), (0.3, 0.5, 0.8))
    scene = gpurt.Scene(device)
    scene.add_mesh(vertices, indices)
    expected = scene.commit("kdtree").trace(rays)
    tree = scene.export_tree()
    assert tree.nodes.dtype == gpurt.kdtree_node_dtype and tree.nodes.shape == (scene.facts.num_nodes,)
    assert tree.references.dtype == np.uint32 and tree.references.max() < tree.num_triangles == len(indices)

    other = gpurt.Scene(device)
    other.add_mesh(vertices, indices)
    other.import_tree(tree)
    other.commit("kdtree")
    assert other.facts.tree_from_cache
    assert other.export_tree().nodes.tobytes() == tree.nodes.tobytes()
    assert (other.trace(rays) == expected).all()

    tree.references[0] = len(indices)
    with pytest.raises(gpurt.InvalidArgument):
        other.import_tree(tree)
    with pytest.raises(gpurt.InvalidArgument, match="tree.nodes: "):
        other.import_tree(gpurt.KdTree(np.zeros(3), tree.references, 1, (0, 0, 0), (1, 1, 1)))
    with pytest.raises(gpurt.InvalidArgument):
        scene.export_tree(7)


def test_trees_are_cached_in_files(device, tmp_path):
    vertices, indices = sphere(3)

    def build():
        scene = gpurt.Scene(device)
        scene.add_mesh(vertices, indices)
        return scene.commit("kdtree", tree_cache=tmp_path / "tree").facts.tree_from_cache

    assert [build(), build()] == [False, True]
    vertices[0] *= 1.5
    assert not build(), "another scene's tree is not used"
    with pytest.raises(gpurt.FileError) as caught:
        make_box(device, "kdtree", tree_cache=tmp_path / "missing" / "tree")
    assert isinstance(caught.value, OSError)


def test_files_that_cannot_be_loaded(device, tmp_path):
    with pytest.raises(gpurt.FileError, match="nowhere.glb"):
        gpurt.load(tmp_path / "nowhere.glb", device)
    (tmp_path / "bad.glb").write_bytes(b"glXF" + bytes(60))
    with pytest.raises(gpurt.FileError, match="bad.glb"):
        gpurt.load(os.fsencode(tmp_path / "bad.glb"), device)
    with pytest.raises(gpurt.InvalidArgument, match="null"):
        gpurt.load("a\0b", device)


def test_loaded_scenes_equal_described_ones(device, box, tmp_path):
    import glb
    scene = gpurt.load(glb.write_box(tmp_path / "box.glb"), device).commit("kdtree")
    assert scene.facts.num_triangles == 12 and scene.facts.num_cameras == 1
    rays = gpurt.make_rays((0.1, 0.2, 0.3), np.random.default_rng(3).normal(size=(300, 3)))
    assert (scene.trace(rays) == box.trace(rays)).all()
    assert len(box_quads()) == scene.facts.num_geometries
