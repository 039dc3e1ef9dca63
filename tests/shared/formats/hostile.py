"""Files damaged on purpose: mutations of small sound ones, for every format that is read."""

from __future__ import annotations

import copy
import io
import json
import struct
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from stages.shared.formats.recording import Recording
from stages.shared.formats.robot_table import ROOT_COLUMNS
from tests.shared.formats.amass_files import npz, old_layout, pose_vectors
from tests.shared.formats.asf_texts import AsfText
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.glb_bytes import glb_with
from tests.shared.formats.gltf_files import GltfText
from tests.shared.formats.robot_files import ANGLES, RobotText, csv_of, some_rows

WORDS = [
    b"nan", b"inf", b"-inf", b"1e308", b"1e-400", b"99999999999999999999", b"-1", b"0", b"\0", b"\xff", b"\r", b"\n",
    b"\t", b"{", b"}", b"[", b"]", b'"', b",", b":", b"-", b"1.2.3", b"_", b"'", b"\\u0000", b"true", b"null",
    b"\x80\x02]q\x00.",
]  # fmt: skip
OWN_WORDS = {
    "bvh": b"ROOT|JOINT|OFFSET|CHANNELS 6|End Site|MOTION|Frames: 3|Xrotation|HIERARCHY".split(b"|"),
    "asf": b"root|lfemur|:DEGREES|:RADIANS|:SAMPLES-PER-SECOND 0|#|1\n|rhand 1 2\n".split(b"|"),
    "asf-skeleton": b"begin|end|:root|:bonedata|:hierarchy|dof rx|axis|length|name|root".split(b"|"),
    "deepmimic": b'"Frames"|"Loop"|[[|]]|0.0333'.split(b"|"),
    "robot": b',,|;|0.5,|1,0,0,0|\n\n|"|root_x'.split(b"|"),
    "urdf": b"<link|<joint|</robot>|<!DOCTYPE r []>|&amp;|&x;|type='fixed'|xyz='0 0 nan'|<mimic joint='a'/>|'".split(
        b"|"
    ),
    "positions": b',,|;|time|Hips.x|.y|\n\n|"'.split(b"|"),
}
VALUES: list[Any] = [
    None, True, -1, 0, 1, 10**9, 10**30, 1e308, float("nan"), float("inf"), "", "x" * 300, "../../up", [], {}, [[]],
    [1] * 99,
]  # fmt: skip


def mutated(data: bytes, rng: np.random.Generator, words: list[bytes]) -> bytes:
    """One edit or a few: bytes cut, words put in, pieces copied or moved, the end lost."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 4]))):
        at = int(rng.integers(0, len(data) + 1))
        span = int(rng.choice([1, 1, 3, 10, 60]))
        edit = rng.integers(0, 6)
        if edit == 0:
            data = data[:at] + data[at + span :]
        elif edit == 1:
            data = data[:at] + words[int(rng.integers(len(words)))] + data[at:]
        elif edit == 2:
            data = data[:at] + words[int(rng.integers(len(words)))] + data[at + span :]
        elif edit == 3:
            data = data[:at] + bytes(rng.integers(0, 256, int(rng.integers(1, 9)), np.uint8)) + data[at + span // 8 :]
        elif edit == 4:
            piece = data[at : at + span * 10]
            to = int(rng.integers(0, len(data) + 1))
            data = data[:to] + piece + data[to:]
        elif rng.random() < 0.3:
            data = data[:at]
    return data


# --- one seed and one way of damage for each format -----------------------------------------------


@dataclass(frozen=True)
class Target:
    """format: as `stages.shared.formats.readers` calls it. make: (rng) -> bytes of a recording and of its rig."""

    format: str
    name: str
    make: Callable[[np.random.Generator], tuple[bytes, bytes]]


def _text(kind: str, seeds: list[bytes], rig: bytes = b"") -> Callable[[np.random.Generator], tuple[bytes, bytes]]:
    words = WORDS + OWN_WORDS[kind] * 2

    def make(rng: np.random.Generator) -> tuple[bytes, bytes]:
        return mutated(seeds[int(rng.integers(len(seeds)))], rng, words), rig

    return make


@lru_cache(maxsize=1)
def _deepmimic() -> bytes:
    row = [0.0333, 0, 0.9, 0] + [1, 0.1, 0, 0] * 10
    return json.dumps({"Loop": "wrap", "Frames": [row, row, row]}).encode()


def _asf_pair(rng: np.random.Generator) -> tuple[bytes, bytes]:
    text = AsfText(frames=2, newline="\n")
    if rng.random() < 0.5:
        return mutated(text.amc(), rng, WORDS + OWN_WORDS["asf"] * 2), text.asf()
    return text.amc(), mutated(text.asf(), rng, WORDS + OWN_WORDS["asf-skeleton"] * 2)


def _odd_array(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    edit = rng.integers(0, 8)
    if array.dtype.kind not in "iuf":
        edit = rng.choice([1, 3, 5, 6])
    if edit == 0:
        with np.errstate(all="ignore"):
            return array.astype(str(rng.choice(["f4", "i1", "c8", "?", "U5", "S3", ">f8"])))
    if edit == 1:
        return array.reshape(-1)[: int(rng.integers(0, array.size + 1))]
    if edit == 2:
        return np.full_like(array, rng.choice([np.nan, np.inf, -1, 0]), dtype=np.float64)
    if edit == 3:
        return np.zeros(tuple(rng.integers(0, 9, int(rng.integers(0, 5)))))
    if edit == 4:
        changed = np.array(array, np.float64).reshape(-1)
        changed[: min(3, changed.size)] = rng.choice([1e300, -1e9, np.nan, 1e-300])
        return changed.reshape(array.shape)
    if edit == 5:
        return np.array([{"a": 1}], dtype=object)
    if edit == 6:
        return array[..., None]
    return np.asfortranarray(array)


def _odd_npz(arrays: dict[str, np.ndarray], rng: np.random.Generator) -> bytes:
    """Sound zip, odd arrays; or arrays' own bytes damaged; or the whole archive."""
    arrays = dict(arrays)
    for _ in range(int(rng.integers(1, 4))):
        key = str(rng.choice(list(arrays))) if arrays else "a"
        if rng.random() < 0.15:
            arrays.pop(key, None)
        elif key in arrays:
            arrays[key] = _odd_array(arrays[key], rng)
    data = npz(**arrays)
    where = rng.random()
    if where < 0.5:
        return data
    if where < 0.7:
        return mutated(data, rng, WORDS)
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(stream, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if rng.random() < 0.5:
                content = mutated(content[:128], rng, [*WORDS, b"(999999999, 3)", b"'|O'", b"(" * 50]) + content[128:]
            new.writestr(name, content)
    return stream.getvalue()


@lru_cache(maxsize=1)
def _amass_arrays() -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(old_layout("smpl", frames=3))) as arrays:
        whole = {key: arrays[key] for key in arrays.files}
    return whole | {"root_orient": pose_vectors("body", 3)[:, :3], "pose_body": pose_vectors("body", 3)[:, 3:]}


def _amass(rng: np.random.Generator) -> tuple[bytes, bytes]:
    return _odd_npz(_amass_arrays(), rng), b""


@lru_cache(maxsize=1)
def _places() -> tuple[tuple[str, ...], np.ndarray]:
    from tests.shared.formats.position_files import NAMES, PLACES

    return NAMES, PLACES[:3]


def _positions(rng: np.random.Generator) -> tuple[bytes, bytes]:
    from tests.shared.formats.position_files import csv_of_places, npy_of

    names, places = _places()
    rig = BvhText(frames=1).data()
    kind = rng.integers(0, 4)
    if kind == 0:
        return mutated(csv_of_places(list(names), places, fps=30), rng, WORDS + OWN_WORDS["positions"] * 2), rig
    if kind == 1:
        data = npy_of(_odd_array(places, rng)) if rng.random() < 0.7 else mutated(npy_of(places), rng, WORDS)
        return data, rig if rng.random() < 0.5 else mutated(rig, rng, WORDS + OWN_WORDS["bvh"])
    parents = np.array([-1, 0, 1, 2, 3, 2, 5, 6, 7, 2, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19])
    if kind == 2:
        sidecar = json.dumps({"names": list(names), "parents": parents.tolist(), "fps": 30}).encode()
        return npy_of(places), mutated(sidecar, rng, WORDS)
    return _odd_npz(
        {"positions": places, "names": np.array(names), "parents": parents, "fps": np.array(30)}, rng
    ), b""


@lru_cache(maxsize=2)
def a_scene() -> tuple[dict, bytes]:
    data = GltfText(frames=3, moving=("Hips", "LeftHand"), parts=("a", "b")).data()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[20 + length :]


def _robot(rng: np.random.Generator) -> tuple[bytes, bytes]:
    rows = some_rows(3)
    named = ",".join([*ROOT_COLUMNS, *ANGLES]) if rng.random() < 0.5 else ""
    if rng.random() < 0.5:
        return mutated(csv_of(rows, named), rng, WORDS + OWN_WORDS["robot"] * 2), RobotText().urdf()
    return csv_of(rows, named), mutated(RobotText().urdf(), rng, WORDS + OWN_WORDS["urdf"] * 2)


def _gltf(rng: np.random.Generator) -> tuple[bytes, bytes]:
    scene, rest = a_scene()
    if rng.random() < 0.3:
        return mutated(a_glb(scene, rest), rng, WORDS), b""
    scene = copy.deepcopy(scene)
    for _ in range(int(rng.integers(1, 4))):
        _poke(scene, rng)
    return a_glb(scene, rest if rng.random() < 0.8 else mutated(rest, rng, WORDS)), b""


def _poke(tree: Any, rng: np.random.Generator) -> None:
    """Change one value somewhere in a JSON tree."""
    while True:
        keys = list(tree) if isinstance(tree, dict) else range(len(tree))
        if not len(keys):
            return
        key = keys[int(rng.integers(len(keys)))]
        inner = tree[key]
        if not isinstance(inner, dict | list) or not inner or rng.random() < 0.1:
            old = inner if isinstance(inner, int) and not isinstance(inner, bool) else 3
            choices = [*VALUES, old + 1, old * 2, -old, max(old - 1, 0)] * 1
            tree[key] = copy.deepcopy(choices[int(rng.integers(len(choices)))])
            return
        tree = inner


def a_glb(scene: dict, rest: bytes) -> bytes:
    return glb_with(json.dumps(scene).encode(), rest)


TARGETS = {
    "bvh": Target("bvh", "fuzz.bvh", _text("bvh", [
        BvhText(frames=2, placed=("Hips", "LeftHand")).data(),
        BvhText(frames=3, above="joint_Root", newline="\r\n").data(),
    ])),
    "asf": Target("asf", "fuzz.amc", _asf_pair),
    "amass": Target("amass", "fuzz.npz", _amass),
    "deepmimic": Target("deepmimic", "fuzz.json", lambda rng: _text("deepmimic", [_deepmimic()])(rng)),
    "positions": Target("positions", "fuzz.csv", _positions),
    "robot": Target("robot", "fuzz.csv", _robot),
    "gltf": Target("gltf", "fuzz.glb", _gltf),
}  # fmt: skip


# --- archives -------------------------------------------------------------------------------------


def an_archive(kind: str, rng: np.random.Generator) -> bytes:
    """A damaged zip or tar of a few members."""
    members = {"s/a.bvh": b"HIERARCHY " * 9, "s/b.bvh": b"x" * 700, "s/deep/" + "c" * 120 + ".bvh": b"y"}
    stream = io.BytesIO()
    if kind == "zip":
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in members.items():
                archive.writestr(name, data)
    else:
        mode = {"tar": "w", "tar.gz": "w:gz", "tar.bz2": "w:bz2", "tar.xz": "w:xz"}[kind]
        form = int(rng.choice([tarfile.PAX_FORMAT, tarfile.GNU_FORMAT]))
        with tarfile.open(fileobj=stream, mode=mode, format=form) as archive:  # type: ignore[call-overload]
            for name, data in members.items():
                info = tarfile.TarInfo(name)
                info.size = len(data)
                archive.addfile(info, io.BytesIO(data))
    words = [*WORDS, *b"../|/|\x80|77777777777|PK\x01\x02|PK\x05\x06|g|x|L|S".split(b"|"), b"\x80" + b"\xff" * 11]
    return mutated(stream.getvalue(), rng, words)


def check_recordings(recordings: list[Recording]) -> None:
    """Raise AssertionError unless every recording is a motion of finite numbers on a skeleton of its joints."""
    assert recordings
    for recording in recordings:
        motion, skeleton = recording.motion, recording.skeleton
        assert motion.rotations.shape == (motion.frames, skeleton.joints, 4)
        assert np.allclose(np.linalg.norm(motion.rotations, axis=-1), 1, atol=1e-3)
        assert np.isfinite(motion.root_positions).all() and np.isfinite(motion.tracks).all() and motion.fps > 0
        assert np.isfinite(skeleton.offsets).all() and np.isfinite(skeleton.tails).all()
