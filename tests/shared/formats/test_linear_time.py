"""Every reader takes time in proportion to its input: ten times the text, at most a few times ten the time."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from types import FrameType

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.readers import FORMATS, format_named, recognise
from stages.shared.formats.recording import Asked
from tests.shared.formats.amass_files import npz, old_layout, pose_vectors
from tests.shared.formats.asf_texts import AsfText
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.gltf_files import GltfText
from tests.shared.formats.position_files import NAMES, PLACES, csv_of_places
from tests.shared.formats.robot_files import RobotText, csv_of, some_rows
from tests.shared.formats.trc_files import trc_of

_TIMES = 10
_MOST_RATIO = 35.0  # 10 is in proportion; the square of the length gives 100
_LEAST_S = 0.02  # below this a time says nothing about growth
_HANGS_S = 60
_TRIES = 3
_RIG = BvhText(frames=1).data()
_HEAD = _RIG.partition(b"MOTION")[0]


def _amc(frames: int) -> bytes:
    head, _, lines = AsfText(frames=1, newline="\n").amc().partition(b"\n1\n")
    return head + b"\n" + b"".join(b"%d\n%s\n" % (i + 1, lines.strip()) for i in range(frames))


def _counts(blanks: bytes) -> bytes:
    """A BVH whose lines of counts are long."""
    return _HEAD + b"MOTION\nFrames" + blanks + b"x\nFrame Time" + blanks + b"0.03\n"


_POSES = pose_vectors("body", 1)
# Each makes (recording, rig) of a size that grows with its argument; 1 gives some hundred kilobytes.
SAMPLES: dict[str, tuple[str, Callable[[int], tuple[bytes, bytes]]]] = {
    "bvh: rows": ("bvh", lambda n: (BvhText(frames=100 * n).data(), b"")),
    "bvh: blanks among the counts": ("bvh", lambda n: (_counts(b" " * 300 * n), b"")),
    "bvh: blank lines": ("bvh", lambda n: (_HEAD + b"MOTION\n" + b" \n" * 50_000 * n, b"")),
    "bvh: blanks before MOTION": ("bvh", lambda n: (_HEAD + (b"\n" + b" " * 500) * 100 * n, b"")),
    "bvh: a name": ("bvh", lambda n: (_RIG.replace(b"LeftHand", b"_- " * 20_000 * n), b"")),
    "asf: frames": ("asf", lambda n: (_amc(20 * n), AsfText().asf())),
    "asf: blanks": ("asf", lambda n: (b":DEGREES" + b"\n" * 100_000 * n + b"x", AsfText().asf())),
    "asf: skeleton": ("asf", lambda n: (_amc(1), b":bonedata\n" + b"begin\nname a\nend (\n" * 2_000 * n)),
    "amass": (
        "amass", lambda n: (old_layout("body", poses=np.tile(_POSES, (60 * n, 1)), trans=np.zeros((60 * n, 3))), b""),
    ),
    "deepmimic": ("deepmimic", lambda n: (json.dumps({"Frames": [[0.03] + [1] * 43] * 200 * n}).encode(), b"")),
    "deepmimic: blanks": ("deepmimic", lambda n: (b'{"Frames": [' + b" " * 200_000 * n, b"")),
    "robot: rows": ("robot", lambda n: (csv_of(some_rows(60 * n)), RobotText().urdf())),
    "robot: a name": (
        "robot", lambda n: (b"root_x,root" + b"_" * 30_000 * n + b"q,root_z\n1,2,3\n", RobotText().urdf()),
    ),
    "robot: names": (
        "robot", lambda n: (b"root_x," + b",".join(b"j%d" % i for i in range(1500 * n)), RobotText().urdf()),
    ),
    "robot: digits": ("robot", lambda n: (b"1" * 100_000 * n + b"," * 30 + b"e", RobotText().urdf())),
    "robot: elements": ("robot", lambda n: (csv_of(some_rows(2)), b"<robot>" + b"<link name='a'/>" * 3000 * n)),
    "positions: rows": ("positions", lambda n: (csv_of_places(list(NAMES), np.tile(PLACES, (3 * n, 1, 1))), _RIG)),
    "positions: dashes": (
        "positions", lambda n: (b"Hips.x,Hips.y,Hips.z,a" + b"-" * 50_000 * n + b"\n1,2,3,4\n", _RIG),
    ),
    "positions: brackets": ("positions", lambda n: (b"Hips.x" + b"(" * 50_000 * n + b"\n1\n", _RIG)),
    "positions: one word": ("positions", lambda n: (b"x" * 50_000 * n, _RIG)),
    "positions: columns": (
        "positions", lambda n: (b",".join(b"a%d.x,a%d.y,a%d.z" % (i, i, i) for i in range(400 * n)), _RIG),
    ),
    "positions: sidecar": (
        "positions", lambda n: (
            csv_of_places(list(NAMES), PLACES),
            json.dumps({"names": [f"j{i}" for i in range(3000 * n)], "parents": [*range(-1, 3000 * n - 1)]}).encode(),
        ),
    ),
    "positions: trc": ("positions", lambda n: (trc_of(list(NAMES), np.tile(PLACES, (3 * n, 1, 1))), _RIG)),
    "positions: names of a trc": (
        "positions", lambda n: (trc_of([f"m{i}" for i in range(130 * n)], np.zeros((9, 130 * n, 3))), _RIG),
    ),
    "positions: npz": (
        "positions", lambda n: (npz(positions=np.tile(PLACES, (10 * n, 1, 1)), names=np.array(NAMES)), _RIG),
    ),
    "gltf": ("gltf", lambda n: (GltfText(frames=60 * n).data(), b"")),
    "gltf: blanks": ("gltf", lambda n: (b'{"asset": ' + b" " * 200_000 * n, b"")),
}  # fmt: skip


def test_every_reader_is_measured() -> None:
    assert {name for name, _ in SAMPLES.values()} == {each.name for each in FORMATS}


def _hangs(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"still reading after {_HANGS_S} s")


def _seconds(name: str, data: bytes, rig: bytes) -> float:
    """Processor seconds of looking at a file and reading it, whether it is refused or not."""
    begun = time.process_time()
    with suppress(InputError):
        recognise(data, "walk.csv")
    with suppress(InputError):
        format_named(name).read(data, "walk", Asked(rig=rig, rig_name="rig" if rig else ""))
    return time.process_time() - begun


@pytest.mark.parametrize("sample", SAMPLES)
def test_time_grows_with_the_length(sample: str) -> None:
    name, make = SAMPLES[sample]
    small, large = make(1), make(_TIMES)
    before = signal.signal(signal.SIGALRM, _hangs)
    signal.alarm(_HANGS_S)
    try:
        _seconds(name, *small)  # modules are loaded and caches made
        for _ in range(_TRIES):  # another process may slow one of the two down
            ratio = _seconds(name, *large) / max(_seconds(name, *small), _LEAST_S)
            if ratio < _MOST_RATIO:
                return
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    pytest.fail(f"{_TIMES} times the text takes {ratio:.0f} times as long")
