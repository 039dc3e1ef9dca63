"""What the fuzzer runs: for every reader, and for the artefact reader, a function of bytes and its first corpus.

A target returns where the bytes are refused with a PumpsError, and where they are read and what was read is sound.
Anything else is a find: another exception, an error that does not name the file, numbers that are not finite.
"""

from __future__ import annotations

import atexit
import io
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.manifest import open_artefact
from data_schemas.motion import MotionReader
from stages.shared.formats import archives
from stages.shared.formats.keypoint_files import detections_in
from stages.shared.formats.keypoints import person_of
from stages.shared.formats.readers import format_named, recognise
from stages.shared.formats.recording import Asked
from stages.shared.formats.skeleton_map import read_skeleton_map
from stages.shared.formats.sources import find_sources
from tests.data_schemas.examples import write_motion
from tests.shared.formats.amass_files import npz
from tests.shared.formats.asf_texts import AsfText
from tests.shared.formats.bvh_texts import BvhText
from tests.shared.formats.glb_bytes import glb_with
from tests.shared.formats.hostile import OWN_WORDS, TARGETS, WORDS, a_scene, an_archive, check_recordings
from tests.shared.formats.keypoint_files_made import SIZE as KEYPOINTS_SIZE
from tests.shared.formats.keypoint_files_made import every_file
from tests.shared.formats.position_files import NAMES, PLACES, csv_of_places, npy_of
from tests.shared.formats.robot_files import RobotText, csv_of, some_rows
from tests.shared.formats.trc_files import trc_of

_NAME = "fuzz.bin"
_RIG = BvhText(frames=1).data()
_PARENTS = [-1, 0, 1, 2, 3, 2, 5, 6, 7, 2, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19]


@dataclass(frozen=True)
class FuzzTarget:
    """run: of bytes, as above. seeds: the corpus to start from. words: the dictionary. covers: packages to trace."""

    run: Callable[[bytes], None]
    seeds: Callable[[], list[bytes]]
    words: tuple[bytes, ...] = ()
    covers: tuple[str, ...] = ("stages.shared.formats", "stages.shared.humanoid")


def _read(chosen: str, data: bytes, rig: bytes) -> None:
    try:
        recognise(data, _NAME)
        check_recordings(format_named(chosen).read(data, _NAME, Asked(rig=rig, rig_name="fuzz.rig" if rig else "")))
    except InputError as error:
        assert _NAME in error.message or "fuzz.rig" in error.message, error.message
        assert "\n" not in error.message and len(error.message) < 1000, error.message


def _reader(chosen: str, rig: bytes = b"") -> Callable[[bytes], None]:
    return lambda data: _read(chosen, data, rig)


def _rig_of(chosen: str, recording: bytes) -> Callable[[bytes], None]:
    return lambda data: _read(chosen, recording, data)


def _made(kind: str, count: int = 8) -> Callable[[], list[bytes]]:
    """Sound files of `tests.shared.formats.hostile`, and some with a little damage."""
    return lambda: [TARGETS[kind].make(np.random.default_rng(seed))[0] for seed in range(count)]


# --- arrays: the bytes choose types and shapes, since a damaged zip is refused before its arrays are read --------

_TYPES = ("f8", "f4", "f2", "i1", "i8", "u2", "?", "U3", "S2", "c8", ">f8")


def arrays_of(data: bytes, sound: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The sound arrays, changed as the bytes say: 8 bytes an edit (which, how, type, shape), then numbers."""
    arrays, keys = dict(sound), list(sound)
    edits = min(data[0] % 4, len(data) // 9) if data else 0
    numbers = data[1 + 8 * edits :]
    for edit in range(edits):
        which, how, kind, *shape = data[1 + 8 * edit : 9 + 8 * edit]
        key = keys[which % len(keys)]
        if how % 4 == 0:
            arrays.pop(key, None)
            continue
        dtype = np.dtype(_TYPES[kind % len(_TYPES)])
        sizes = [each % 12 for each in shape[: 1 + how % 5]]
        if how % 4 == 1 and key in arrays:  # the shape stays, the type and the numbers change
            sizes = list(arrays[key].shape)
        size = int(np.prod(sizes)) * dtype.itemsize
        content = (numbers * (size // max(len(numbers), 1) + 1))[:size].ljust(size, b"\0")
        arrays[key] = np.frombuffer(content, dtype).reshape(sizes)
    return arrays


def _arrays(chosen: str, sound: Callable[[], dict[str, np.ndarray]]) -> Callable[[bytes], None]:
    return lambda data: _read(chosen, npz(**arrays_of(data, sound())), b"")


@lru_cache(maxsize=1)
def _amass() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {
        "poses": rng.normal(0, 0.2, (4, 72)), "trans": rng.normal(size=(4, 3)), "betas": np.zeros(10),
        "gender": np.array("neutral"), "mocap_framerate": np.array(60.0), "root_orient": rng.normal(0, 0.2, (4, 3)),
        "pose_body": rng.normal(0, 0.2, (4, 63)),
    }  # fmt: skip


@lru_cache(maxsize=1)
def _positions() -> dict[str, np.ndarray]:
    return {
        "positions": PLACES[:4], "names": np.array(NAMES), "parents": np.array(_PARENTS), "fps": np.array(30),
    }  # fmt: skip


def _edits() -> list[bytes]:
    rng = np.random.default_rng(0)
    return [b"\0", *(bytes([i % 4]) + rng.bytes(24 + 8 * i) for i in range(12))]


# --- containers and artefacts -------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="pumps-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _archive(data: bytes, suffix: str) -> None:
    path = _folder() / f"a{suffix}"
    path.write_bytes(data)
    archives.forget()
    try:
        for source in find_sources([str(path)]):
            assert ".." not in source.member.split("/") and not source.member.startswith("/")
            assert len(source.read()) == source.size
    except InputError as error:
        assert path.name in error.message, error.message


@lru_cache(maxsize=1)
def _artefact() -> dict[str, bytes]:
    """A sound motion artefact, and the bytes of its files by their paths."""
    path = _folder() / "artefact"
    write_motion(path)
    return {str(file.relative_to(path)): file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def _artefact_with(data: bytes, ending: str) -> None:
    sound, path = _artefact(), _folder() / "artefact"
    name = next(name for name in sound if name.endswith(ending))
    (path / name).write_bytes(data)
    try:
        with MotionReader(open_artefact(path, "motion")) as reader:
            for skeleton in reader.skeletons():
                reader.skeleton(skeleton)
            for row in reader.clips:
                reader.motion(row.clip)
    except InputError as error:
        assert "artefact" in error.message, error.message
    finally:
        (path / name).write_bytes(sound[name])


def _part(ending: str) -> FuzzTarget:
    return FuzzTarget(
        lambda data: _artefact_with(data, ending),
        lambda: [next(content for name, content in _artefact().items() if name.endswith(ending))],
        (b'"files"', b'"digest"', b"null", b"1e999", b"[" * 40, b"..", b"data-0123456789abcdef"),
        covers=("data_schemas",),
    )


def _map(data: bytes) -> None:
    path = _folder() / "map.toml"
    path.write_bytes(data)
    try:
        read_skeleton_map(path)
    except InputError as error:
        assert "map.toml" in error.message, error.message


def _maps() -> list[bytes]:
    groups = "".join(
        f'{group} = ["a", "b"]\n' for group in ("spine", "left_arm", "right_arm", "left_leg", "right_leg")
    )
    return [f'unit_m = 0.01\nup = "y"\npelvis = "a"\noutside = ["c"]\n[chains]\n{groups}[beside]\n{groups}'.encode()]


def _scenes() -> Iterator[bytes]:
    scene, _ = a_scene()
    yield json.dumps(scene).encode()


def _gltf_json(data: bytes) -> None:
    _, rest = a_scene()
    _read("gltf", glb_with(data, rest), b"")


def _sidecar() -> list[bytes]:
    return [json.dumps({"names": list(NAMES), "parents": _PARENTS, "fps": 30}).encode()]


def _keypoints(data: bytes) -> None:
    """Read as 2D keypoints, and as places in 3D where they are none."""
    try:
        found = person_of(detections_in(data, _NAME), _NAME, size=KEYPOINTS_SIZE)
    except InputError as error:
        assert _NAME in error.message and "\n" not in error.message and len(error.message) < 1000, error.message
        return
    assert (np.isfinite(found.places).all(axis=-1) == (found.confidences > 0)).all()
    assert len(found.names) == found.places.shape[1]


def _words(kind: str) -> tuple[bytes, ...]:
    return (*OWN_WORDS.get(kind, ()), *WORDS)


_ASF, _AMC = AsfText(frames=2, newline="\n").asf(), AsfText(frames=2, newline="\n").amc()
_TRC = (*_words("positions"), b"\tmm\t", b"\t\t\t")
_JSON = (b'"names"', b'"parents"', b'"fps"', *WORDS)
_NPY = (b"'descr'", b"'shape'", b"'|O'", *WORDS)
_GLTF = (b'"children"', b'"byteOffset"', b'"count"', *WORDS)
_TOML = (b"[[", b"]]", b'"""', b"'''", *WORDS)
_ZIP, _TAR = (b"PK\x01\x02", b"PK\x05\x06", b"../"), (b"../", b"77777777777", b"\x80\xff")
FUZZ_TARGETS: dict[str, FuzzTarget] = {
    "bvh": FuzzTarget(_reader("bvh"), lambda: [BvhText(frames=2).data(), *_made("bvh")()], _words("bvh")),
    "amc": FuzzTarget(_reader("asf", _ASF), lambda: [_AMC], _words("asf")),
    "asf": FuzzTarget(_rig_of("asf", _AMC), lambda: [_ASF], _words("asf-skeleton")),
    "amass": FuzzTarget(_arrays("amass", _amass), _edits),
    "npz": FuzzTarget(_reader("amass"), _made("amass"), tuple(WORDS)),
    "deepmimic": FuzzTarget(_reader("deepmimic"), _made("deepmimic"), _words("deepmimic")),
    "robot": FuzzTarget(_reader("robot", RobotText().urdf()), lambda: [csv_of(some_rows(3))], _words("robot")),
    "urdf": FuzzTarget(_rig_of("robot", csv_of(some_rows(3))), lambda: [RobotText().urdf()], _words("urdf")),
    "positions-csv": FuzzTarget(
        _reader("positions", _RIG), lambda: [csv_of_places(list(NAMES), PLACES[:3], fps=30)], _words("positions"),
    ),
    "positions-trc": FuzzTarget(_reader("positions", _RIG), lambda: [trc_of(list(NAMES), PLACES[:3])], _TRC),
    "positions-json": FuzzTarget(_rig_of("positions", csv_of_places(list(NAMES), PLACES[:3])), _sidecar, _JSON),
    "positions-arrays": FuzzTarget(_arrays("positions", _positions), _edits),
    "npy": FuzzTarget(_reader("positions", _RIG), lambda: [npy_of(PLACES[:3])], _NPY),
    "keypoints": FuzzTarget(
        _keypoints, lambda: [data for data, _ in every_file().values()],
        (b'"keypoints"', b'"instances"', b'"image_id"', b"likelihood", b"bodyparts", *WORDS),
    ),
    "glb": FuzzTarget(_reader("gltf"), _made("gltf"), tuple(WORDS)),
    "gltf-json": FuzzTarget(_gltf_json, lambda: list(_scenes()), _GLTF),
    "map": FuzzTarget(_map, _maps, _TOML, ("stages.shared.formats", "stages.shared.toml")),
    "zip": FuzzTarget(lambda data: _archive(data, ".zip"), lambda: _archives("zip"), _ZIP),
    "tar": FuzzTarget(lambda data: _archive(data, ".tar"), lambda: _archives("tar"), _TAR),
    "artefact-manifest": _part("manifest.json"),
    "artefact-clips": _part("clips.parquet"),
    "artefact-motions": _part("motions.h5"),
}  # fmt: skip


def _archives(kind: str) -> list[bytes]:
    return [an_archive(kind, np.random.default_rng(seed)) for seed in range(6)]


def dictionary_of(words: tuple[bytes, ...]) -> str:
    """The words in libFuzzer's notation, one a line."""
    out = io.StringIO()
    for word in dict.fromkeys(words):
        out.write('"' + "".join(f"\\x{byte:02x}" for byte in word) + '"\n')
    return out.getvalue()
