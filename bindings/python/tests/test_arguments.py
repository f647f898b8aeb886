"""Wrong arguments: the right exception, and a text that names the culprit."""

import numpy as np
import pytest
from conftest import quad

import gpurt

V, I = quad((-1, 0, 1), (2, 0, 0), (0, 0, -2))
MASKED = np.ma.masked_array(V, mask=V > 0)


@pytest.fixture()
def scene(device):
    return gpurt.Scene(device)


CASES = {
    "vertices: expected [n][3], got [4][2]": lambda s: s.add_mesh(V[:, :2], I),
    "vertices: expected [n][3], got [3]": lambda s: s.add_mesh([1, 2, 3], I),
    "vertices: is no array": lambda s: s.add_mesh([[1, 2, 3], [1, 2]], I),
    "vertices: has masked elements": lambda s: s.add_mesh(MASKED, I),
    "vertices: 1e+300 at [0][0] is beyond the range of float32":
        lambda s: s.add_mesh(np.array([[1e300, 0, 0]] * 3)),
    "indices: expected [m][3], got [2][4]": lambda s: s.add_mesh(V, np.zeros((2, 4), int)),
    "indices: expected integers, got float64": lambda s: s.add_mesh(V, I.astype(float)),
    "indices: -1 at [0][1] does not fit into uint32": lambda s: s.add_mesh(V, [[0, -1, 2]]),
    "indices: 4294967296 at [1][2] does not fit into uint32": lambda s: s.add_mesh(V, [[0, 1, 2], [0, 1, 2**32]]),
    "normals: expected [n][3], got [4][2]": lambda s: s.add_mesh(V, I, V[:, :2]),
    "uvs: expected [n][2], got [4][3]": lambda s: s.add_mesh(V, I, uvs=V),
    "transform: expected [3][4] or [4][4], got [3][3]": lambda s: s.add_mesh(V, I, transform=np.eye(3)),
    "transform: the last row must be 0 0 0 1": lambda s: s.add_mesh(V, I, transform=np.eye(4) * 2),
    "material: -1 is outside": lambda s: s.add_mesh(V, I, material=-1),
    "control_points: expected [n][16][3]": lambda s: s.add_patches(np.zeros((16, 2))),
    "texels: expected [h][w][3] or [h][w][4], got [4][4]": lambda s: s.add_texture(np.zeros((4, 4), np.uint8)),
    "texels: expected uint8 or floating-point numbers, got int64": lambda s: s.add_texture(np.zeros((4, 4, 3), int)),
    "srgb: ": lambda s: s.add_texture(np.zeros((4, 4, 3)), srgb=True),
    "wrap: 'tile' is none of 'repeat', 'clamp', 'mirror'":
        lambda s: s.add_texture(np.zeros((4, 4, 3), np.uint8), wrap="tile"),
    "type: 'plastic' is none of": lambda s: s.add_material("plastic"),
    "base_color: expected a number or 3 numbers, got [2]": lambda s: s.add_material(base_color=(1, 2)),
    "attenuation_color: expected a number or 3 numbers, got [2]":
        lambda s: s.add_material("glass", attenuation_color=(1, 2)),
    "position: expected 3 numbers, got [2]": lambda s: s.add_light(intensity=1, position=(1, 2)),
    "position, target: give both or none": lambda s: s.add_camera(position=(1, 2, 3)),
    "transform: give it, or position and target": lambda s: s.add_camera(np.eye(4), position=(1, 2, 3),
                                                                         target=(0, 0, 0)),
    "accel: 'octree' is none of": lambda s: s.commit("octree"),
    "max_depth: 4294967296 is outside": lambda s: s.commit(max_depth=2**32),
    "rays: give them, or origins and directions": lambda s: s.trace(origins=(0, 0, 0)),
    "rays: hold origins": lambda s: s.trace(np.zeros((1, 8)), tmin=0),
    "rays: expected [...][8] = ox oy oz tmin dx dy dz tmax, got [2][6]": lambda s: s.trace(np.zeros((2, 6))),
    "directions: expected [...][3], got [2][2]": lambda s: s.trace(origins=(0, 0, 0), directions=np.zeros((2, 2))),
    "origins, directions, tmin, tmax: shapes do not fit together: [2][3], [3][3]":
        lambda s: s.trace(origins=np.zeros((2, 3)), directions=np.zeros((3, 3))),
    "query: 'nearest' is none of": lambda s: s.trace(np.zeros((1, 8)), query="nearest"),
    "format: 'tiny' is none of": lambda s: s.trace(np.zeros((1, 8)), format="tiny"),
    "out: expected a writeable C-contiguous array of bool [2], got float64 [2]":
        lambda s: s.trace(np.zeros((2, 8)), query="any", out=np.zeros(2)),
    "out: not with query='all'": lambda s: s.trace(np.zeros((2, 8)), query="all", out=np.zeros(2)),
    "outputs: 'beauty' is none of": lambda s: s.commit().render(outputs=["beauty"]),
    "pipeline: 'magic' is none of": lambda s: with_camera(s).render("magic"),
    "seed: -1 is outside [0, 2^64)": lambda s: s.commit().render(seed=-1),
    "tiles: expected [n][4] = x0 y0 x1 y1, got [4]": lambda s: gpurt.Frame(with_camera(s)).submit(tiles=[0, 0, 1, 1]),
    "output: 'beauty' is none of": lambda s: gpurt.Frame(with_camera(s)).read("beauty"),
}


def with_camera(scene):
    scene.add_camera()
    return scene.commit()


@pytest.mark.parametrize("text", CASES)
def test_the_culprit_is_named(scene, text):
    with pytest.raises(gpurt.InvalidArgument) as caught:
        CASES[text](scene)
    assert str(caught.value).startswith(text)
    assert isinstance(caught.value, ValueError) and isinstance(caught.value, gpurt.Error)


TYPE_CASES = {
    "vertices: expected an array, got NoneType": lambda s: s.add_mesh(None),
    "vertices: expected an array, got str": lambda s: s.add_mesh("vertices"),
    "vertices: expected an array of numbers, got elements of type complex64": lambda s: s.add_mesh(V * 1j),
    "material: expected an integer, got float": lambda s: s.add_mesh(V, I, material=1.0),
    "roughness: expected a number, got list": lambda s: s.add_material("metal", roughness=[1]),
    "attenuation_distance: expected a number, got list":
        lambda s: s.add_material("glass", attenuation_distance=[1]),
    "width: expected an integer, got str": lambda s: s.commit().render(width="512"),
    "out: expected a numpy array, got list": lambda s: s.trace(np.zeros((1, 8)), out=[1]),
    "log: expected a function or None, got int": lambda s: gpurt.Device(log=3),
    "device: expected a gpurt.Device, got str": lambda s: gpurt.Scene("cpu"),
    "other: expected a gpurt.Frame, got str": lambda s: gpurt.Frame(with_camera(s)).merge("frame"),
}


@pytest.mark.parametrize("text", TYPE_CASES)
def test_wrong_types_are_type_errors(scene, text):
    with pytest.raises(TypeError) as caught:
        TYPE_CASES[text](scene)
    assert str(caught.value).startswith(text)


def test_the_library_names_what_only_it_can_see(scene):
    with pytest.raises(gpurt.InvalidArgument, match="4"):
        scene.add_mesh(V, [[0, 1, 2], [0, 2, 4]])
    wrong = V.copy()
    wrong[2, 1] = np.nan
    with pytest.raises(gpurt.InvalidArgument, match="2"):
        scene.add_mesh(wrong, I)
    with pytest.raises(gpurt.InvalidArgument):
        scene.add_mesh(V, I, material=9)
    with pytest.raises(gpurt.InvalidArgument):
        scene.add_instance(0)
    with pytest.raises(gpurt.InvalidArgument):
        scene.add_mesh(V, I, normals=V[:3])
    with pytest.raises(gpurt.InvalidArgument):
        scene.add_material("metal", roughness=2)


def test_a_failed_call_leaves_the_scene_as_it_was(scene):
    scene.add_mesh(V, I)
    before = scene.facts
    for wrong in (lambda: scene.add_mesh(V, [[0, 1, 9]]), lambda: scene.add_material("metal", roughness=-1),
                  lambda: scene.add_mesh(V, I, transform=np.zeros((3, 4)))):
        with pytest.raises(gpurt.InvalidArgument):
            wrong()
    assert scene.facts.num_instances == before.num_instances == 1


def test_every_result_has_its_class():
    classes = {gpurt.InvalidArgument: ValueError, gpurt.OutOfMemory: MemoryError,
               gpurt.Unsupported: NotImplementedError, gpurt.Cancelled: Exception, gpurt.DeviceError: RuntimeError,
               gpurt.Timeout: TimeoutError, gpurt.FileError: OSError, gpurt.InternalError: RuntimeError}
    for own, builtin in classes.items():
        assert issubclass(own, gpurt.Error) and issubclass(own, builtin)
        assert str(own("text")) == "text"
