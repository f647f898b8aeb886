"""Devices: what there is, limits, messages."""

import gc
import logging
import os

import numpy as np
import pytest
from conftest import make_box, sphere

import gpurt


def test_the_cpu_is_always_there_and_comes_first():
    found = gpurt.devices()
    assert found[0].type == "cpu"
    assert found[0].name and found[0].memory_bytes > 0
    assert [d.ordinal for d in found[1:]] == list(range(len(found) - 1))
    assert all(d.type == "cuda" for d in found[1:])


def test_properties_say_what_was_asked_for():
    p = gpurt.Device("cpu", threads=2, memory_limit=1 << 30).properties
    assert (p.type, p.num_threads, p.memory_limit) == ("cpu", 2, 1 << 30)
    assert p.instruction_set
    assert gpurt.Device("cpu").properties.num_threads == len(os.sched_getaffinity(0))


def test_the_default_device_is_shared_while_it_is_used():
    first = gpurt.Scene()
    second = gpurt.Scene()
    assert first.device is second.device is gpurt.default_device()


def test_there_is_no_thousandth_gpu():
    with pytest.raises((gpurt.DeviceError, gpurt.Unsupported)) as caught:
        gpurt.Device("cuda", ordinal=999)
    assert str(caught.value)


def test_memory_is_counted_and_given_back():
    device = gpurt.Device("cpu")
    assert device.properties.memory_used == 0
    scene = make_box(device)
    used = device.properties.memory_used
    assert used > 0
    image = scene.render(width=64, height=64, spp=1)
    assert device.properties.memory_used > used
    assert device.properties.memory_peak >= device.properties.memory_used
    del image, scene
    gc.collect()
    assert device.properties.memory_used == 0


def test_a_memory_limit_ends_in_an_error_and_the_device_goes_on():
    device = gpurt.Device("cpu", memory_limit=1 << 20)
    scene = gpurt.Scene(device)
    with pytest.raises(gpurt.OutOfMemory) as caught:
        scene.add_mesh(*sphere(7))  # 131,072 triangles: more than 1 MiB in any form
        scene.commit("kdtree")
    assert isinstance(caught.value, MemoryError)
    del scene
    assert make_box(device, "kdtree").trace(np.array([[0, 0, 0, 0, 0, 0, -1, 9]], np.float32))["t"][0] == 1


def test_messages_go_to_the_function():
    messages = []
    device = gpurt.Device("cpu", log=lambda level, text: messages.append((level, text)))
    make_box(device, "kdtree")
    assert all(level in ("error", "warning", "info") and text for level, text in messages)


def test_messages_go_to_logging_by_default(tmp_path, caplog):
    """A glTF file with a material that has no counterpart makes a warning."""
    import json

    import glb
    path = glb.write_box(tmp_path / "box.glb")
    raw = path.read_bytes()
    document = json.loads(raw[20:20 + int.from_bytes(raw[12:16], "little")])
    document["materials"][0]["pbrMetallicRoughness"] = {"metallicFactor": 0.5, "roughnessFactor": 0.3}
    buffer = raw[20 + int.from_bytes(raw[12:16], "little") + 8:]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (28 + len(text) + len(buffer)).to_bytes(4, "little")
                     + len(text).to_bytes(4, "little") + b"JSON" + text
                     + len(buffer).to_bytes(4, "little") + b"BIN\0" + buffer)
    with caplog.at_level(logging.INFO, logger="gpurt"):
        gpurt.load(path, gpurt.Device("cpu"))
    assert any(r.levelno == logging.WARNING and r.name == "gpurt" for r in caplog.records)

    class Refused(Exception):
        pass

    def refuse(level, message):
        raise Refused(message)

    strict = gpurt.Device("cpu", log=refuse)
    with pytest.raises(Refused):
        gpurt.load(path, strict)
    assert make_box(strict).facts.is_committed


def test_a_log_function_that_holds_the_device_is_collected():
    import weakref

    class Owner:
        def __init__(self):
            self.device = gpurt.Device("cpu", log=self.log)

        def log(self, level, message):
            pass

    owner = Owner()
    gone = weakref.ref(owner)
    del owner
    gc.collect()
    assert gone() is None
