"""Hostile files: work is in proportion to their size, memory is below 64 MB plus ten times their size."""

from __future__ import annotations

import copy
import gc
import json
import time
import tracemalloc
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.readers import format_named
from stages.shared.formats.recording import Asked
from tests.shared.formats.amass_files import npz, old_layout, pose_vectors
from tests.shared.formats.asf_texts import AsfText
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.hostile import a_glb, a_scene
from tests.shared.formats.position_files import npy_of
from tests.shared.formats.robot_files import ANGLES, RobotText, csv_of, some_rows

_FREE_BYTES, _TIMES_SIZE = 64 << 20, 10
_REFERENCE_S = 0.1  # what `_slowness` measures where the limits below were set
_FREE_S, _S_PER_MB = (
    1.5,
    3.0,
)  # processor time on a busy machine with memory being traced; quadratic work takes minutes

_ONE = b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n%s}\nMOTION\nFrames: %d\nFrame Time: 0.03\n"
_JOINT = b"JOINT j%d\n{\nOFFSET 0 1 %d\nCHANNELS 0\n"


def _bvh_rows() -> bytes:
    head, _, _ = BvhText(frames=1).data().partition(b"MOTION")
    return head + b"MOTION\nFrames: 4000\nFrame Time: 0.03\n" + (b"0 " * 66 + b"\n") * 4000


def _amc(frames: int, turned: bool) -> bytes:
    text = AsfText(frames=1, newline="\n").amc()
    head, _, lines = text.partition(b"\n1\n")
    other = b"\n".join(lines.strip().split(b"\n")[::-1]) + b"\n"
    return head + b"\n" + b"".join(b"%d\n%s" % (i + 1, other if turned and i else lines) for i in range(frames))


def _bones(count: int) -> bytes:
    bone = b"begin\nname b%d\ndirection 1 0 0\nlength 1\nend\n"
    chain = b"".join(b"b%d b%d\n" % (i, i + 1) for i in range(count - 1))
    return b":bonedata\n" + b"".join(bone % i for i in range(count)) + b":hierarchy\nroot b0\n" + chain


def _robot_joints(count: int, *, chained: bool) -> bytes:
    joint = (
        "<joint name='j{0}' type='revolute'><origin xyz='0 0.1 {0}e-3'/><parent link='l{1}'/>"
        "<child link='l{0}'/></joint><link name='l{0}'/>"
    )
    joints = "".join(joint.format(i + 1, i if chained else 0) for i in range(count))
    return f"<robot name='r'><link name='l0'/>{joints}</robot>".encode()


def _scene(change: Callable[[dict], None]) -> bytes:
    scene, rest = a_scene()
    scene = copy.deepcopy(scene)
    change(scene)
    return a_glb(scene, rest)


def _many_accessors(scene: dict) -> None:
    scene["accessors"] += [scene["accessors"][1]] * 9000
    scene["animations"][0]["samplers"] += [{"input": 0, "output": i} for i in range(2, 9000)]
    scene["animations"][0]["channels"] += [
        {"sampler": i, "target": {"node": 1 + i % 20, "path": "rotation"}} for i in range(2, 9000)
    ]


def _nodes_in_a_line(scene: dict) -> None:
    first = len(scene["nodes"])
    scene["nodes"] += [{"children": [first + i + 1]} for i in range(9000)] + [{}]
    scene["skins"][0]["joints"] = list(range(first, first + 4000))


def _long_animation(scene: dict) -> None:
    scene["accessors"][0]["count"] = 2
    for accessor in scene["accessors"][1:]:
        accessor["count"] = 2


_RNG = np.random.default_rng(0)
_RIG = BvhText(frames=1).data()
_CHAIN = np.arange(-1, 3999)
SAMPLES: dict[str, tuple[str, Callable[[], bytes], bytes]] = {
    "bvh: rows": ("bvh", _bvh_rows, b""),
    "bvh: short rows": ("bvh", lambda: _ONE % (b"", 100_000) + b"1\n" * 100_000, b""),
    "bvh: one long row": ("bvh", lambda: _ONE % (b"", 100_000) + b"1 " * 100_000, b""),
    "bvh: empty rows": ("bvh", lambda: _ONE % (b"", 9) + b"\n" * 500_000, b""),
    "bvh: joints in a line": (
        "bvh", lambda: _ONE % (b"".join(_JOINT % (i, i) for i in range(4000)) + b"}" * 4000, 2) + b"0\n0\n", b"",
    ),
    "bvh: joints side by side": (
        "bvh", lambda: _ONE % (b"".join(_JOINT % (i, i) + b"}\n" for i in range(4000)), 2) + b"0\n0\n", b"",
    ),
    "bvh: braces": ("bvh", lambda: b"HIERARCHY\n" + b"{ " * 300_000 + b"\nMOTION\n", b""),
    "asf: frames": ("asf", lambda: _amc(600, False), AsfText().asf()),
    "asf: frames in turned order": ("asf", lambda: _amc(400, True), AsfText().asf()),
    "asf: numbers alone": ("asf", lambda: b":DEGREES\n1\nroot 1 1 1 1 1 1\n" + b"12\n" * 200_000, AsfText().asf()),
    "asf: bones in a line": ("asf", lambda: b":DEGREES\n1\nroot 1 1 1 1 1 1\n", _bones(4000)),
    "amass: bytes for angles": (
        "amass", lambda: old_layout("smplx", poses=np.zeros((6_000, 165), np.int8), trans=np.zeros((6_000, 3))), b"",
    ),
    "amass: half numbers": (
        "amass", lambda: old_layout(poses=np.tile(pose_vectors("smplh", 1), (2000, 1)).astype(np.float16),
        trans=np.zeros((2000, 3), np.float16)), b"",
    ),
    "deepmimic: brackets": ("deepmimic", lambda: b'{"Frames":' + b"[" * 500_000, b""),
    "deepmimic: lists": ("deepmimic", lambda: b'{"Frames":[' + b"[]," * 200_000 + b"[]]}", b""),
    "deepmimic: rows": ("deepmimic", lambda: json.dumps({"Frames": [[0.03] + [1] * 43] * 3000}).encode(), b""),
    "positions: bytes": ("positions", lambda: npy_of(_RNG.integers(-90, 90, (6_000, 21, 3)).astype(np.int8)), _RIG),
    "positions: one joint of many": ("positions", lambda: b"Hips.x,Hips.y,Hips.z\n" + b"1,2,3\n" * 100_000, _RIG),
    "positions: columns": ("positions", lambda: b",".join(b"a%d.x" % i for i in range(150_000)), _RIG),
    "positions: joints in a line": (
        "positions", lambda: npz(positions=_RNG.normal(size=(9, 4000, 3)), parents=_CHAIN, names=_CHAIN.astype("U9")),
        b"",
    ),
    "robot: rows": ("robot", lambda: (b"0,0,1,0,0,0,1" + b",0" * len(ANGLES) + b"\n") * 20_000, RobotText().urdf()),
    "robot: rows of the same": ("robot", lambda: b"0,0,1,0,0,0,1\n" * 50_000, RobotText().urdf()),
    "robot: empty rows": ("robot", lambda: b"0,0,1,0,0,0,1\n" + b"\n" * 500_000 + b"1", RobotText().urdf()),
    "robot: columns": ("robot", lambda: b"0," * 300_000, RobotText().urdf()),
    "robot: names": ("robot", lambda: b",".join(b"j%d" % i for i in range(15_000)), RobotText().urdf()),
    "robot: joints in a line": ("robot", lambda: csv_of(some_rows(2, 1500)), _robot_joints(1500, chained=True)),
    "robot: joints side by side": ("robot", lambda: csv_of(some_rows(2, 4000)), _robot_joints(4000, chained=False)),
    "robot: elements": ("robot", lambda: csv_of(some_rows(2)), b"<robot>" + b"<a/>" * 300_000 + b"</robot>"),
    "robot: attributes": (
        "robot", lambda: csv_of(some_rows(2)), b"<robot " + b" ".join(b"a%d='1'" % i for i in range(90_000)) + b"/>",
    ),
    "robot: text": ("robot", lambda: csv_of(some_rows(2)), b"<robot>" + b"x" * 3_000_000 + b"</robot>"),
    "gltf: objects": ("gltf", lambda: b'{"asset":{"version":"2.0"},"nodes":[' + b"{}," * 300_000 + b"{}]}", b""),
    "gltf: nodes": ("gltf", lambda: _scene(lambda s: s["nodes"].extend([{"name": "n"}] * 10_000)), b""),
    "gltf: nodes in a line": ("gltf", lambda: _scene(_nodes_in_a_line), b""),
    "gltf: accessors of one buffer": ("gltf", lambda: _scene(_many_accessors), b""),
    "gltf: two keys far apart": ("gltf", lambda: _scene(_long_animation), b""),
}  # fmt: skip


@pytest.mark.parametrize("sample", SAMPLES)
def test_work_and_memory_are_in_proportion_to_the_size(sample: str) -> None:
    chosen, make, rig = SAMPLES[sample]
    data, reader = make(), format_named(chosen)
    asked = Asked(rig=rig, rig_name="rig" if rig else "", trim_first="auto")
    _read(reader, data[:500], asked)  # modules are loaded and caches made before memory is measured
    gc.collect()
    tracemalloc.start()
    begun = time.process_time()
    _read(reader, data, asked)
    spent, (_, peak) = time.process_time() - begun, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    size = len(data) + len(rig)
    assert peak < _FREE_BYTES + _TIMES_SIZE * size, f"{peak / 1e6:.0f} MB for {size / 1e6:.1f} MB"
    allowed = _slowness() * (_FREE_S + _S_PER_MB * size / 1e6)
    assert spent < allowed, f"{spent:.1f} s of {allowed:.1f} s for {size / 1e6:.1f} MB"


def _slowness() -> float:
    """How many times as long as on the machine of the limits a fixed piece of Python takes here and now; 1 at least.

    The limits are processor seconds, which grow where the processor is slower or its caches are shared.
    """
    tracemalloc.start()
    begun = time.process_time()
    rows = [[float(number), str(number)] for number in range(60_000)]
    spent = time.process_time() - begun
    tracemalloc.stop()
    assert len(rows) == 60_000
    return max(1.0, spent / _REFERENCE_S)


def _read(reader, data: bytes, asked: Asked) -> None:  # type: ignore[no-untyped-def]
    with suppress(InputError):
        reader.read(data, "hostile", asked)
