"""Formats of motion that pumps recognises and does not read: the name of each, and how to convert it.

They are recognised by content first, and by suffix if the content is unclear. No file is unpickled for this.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import PurePosixPath

from data_schemas.errors import InputError

_BY_BLENDER = "Convert it to GLB with Blender: docs/formats.md shows the command."
_BY_ADD_ON = "Import it into Blender with {}, and export GLB: docs/formats.md shows the command."
_AS_ARRAYS = (
    "Pickles are never loaded, since they can run any program. In a program that you trust, save the arrays with"
    " numpy.savez: SMPL's as poses, trans, betas and mocap_framerate; joint positions as positions, names and"
    " parents."
)
_LEGACY_TORCH = bytes.fromhex("80028a0a6cfc9c46f9206aa85019")
_STO = re.compile(rb"(?mi)^endheader[ \t]*$")
_PICKLE = re.compile(rb"\x80[\x02-\x05]")


@dataclass(frozen=True)
class UnreadFormat:
    """what: its name in an error, after "is". hint: how to convert it. suffixes: lower case.

    looks: whether the start of a file is that of this format.
    """

    what: str
    hint: str
    suffixes: tuple[str, ...]
    looks: Callable[[bytes], bool]


def _starts(*marks: bytes) -> Callable[[bytes], bool]:
    return lambda start: start.startswith(marks)


def _looks_c3d(start: bytes) -> bool:
    # Byte 0 is the first block of 512 bytes with parameters; byte 1 is always 0x50.
    return len(start) >= 512 and start[1] == 0x50 and 2 <= start[0] <= 16 and b"\0" in start[:64]


def _looks_storage(start: bytes) -> bool:
    head = start[:4096].replace(b"\r\n", b"\n")
    return _STO.search(head) is not None and (b"nRows" in head or b"nColumns" in head or b"datacolumns" in head)


def _never(start: bytes) -> bool:
    return False


_TORCH = UnreadFormat("a PyTorch file", _AS_ARRAYS, (".pt", ".pth", ".ckpt"), _starts(_LEGACY_TORCH))
UNREAD: tuple[UnreadFormat, ...] = (
    UnreadFormat("FBX", _BY_BLENDER, (".fbx",), _starts(b"Kaydara FBX Binary", b"; FBX ")),
    UnreadFormat("VRML", _BY_BLENDER, (".wrl",), _starts(b"#VRML")),
    UnreadFormat(
        "USD", _BY_BLENDER, (".usd", ".usda", ".usdc", ".usdz"), _starts(b"PXR-USDC", b"#usda"),
    ),
    UnreadFormat("Alembic", _BY_BLENDER, (".abc",), _starts(b"Ogawa")),
    UnreadFormat("COLLADA", _BY_BLENDER, (".dae",), lambda start: b"<COLLADA" in start[:1024]),
    UnreadFormat(
        "a Blender scene", "Export GLB from Blender, with its animations.", (".blend",), _starts(b"BLENDER"),
    ),
    UnreadFormat(
        "MikuMikuDance motion (VMD)", _BY_ADD_ON.format("the add-on MMD Tools"), (".vmd",),
        _starts(b"Vocaloid Motion Data"),
    ),
    UnreadFormat(
        "C3D, which holds markers and no skeleton",
        "Solve it where it was recorded and export BVH; or, if its points are joints, save them as .trc (ezc3d and"
        " OpenSim do).",
        (".c3d",), _looks_c3d,
    ),
    UnreadFormat(
        "an OpenSim table of coordinates (.mot, .sto), whose joints are defined in an .osim model",
        "Export the places of the model's joints from OpenSim (Analyze, PointKinematics) as .trc or CSV, or give the"
        " .trc of the markers.",
        (".mot", ".sto"), _looks_storage,
    ),
    UnreadFormat(
        "3ds Max Biped motion (.bip)", "Load it on a Biped in 3ds Max, and export BVH or FBX (then GLB by Blender).",
        (".bip",), _never,
    ),
    UnreadFormat(
        "Xsens MVN motion (.mvnx)", "Export BVH from MVN.", (".mvnx",), lambda start: b"<mvnx" in start[:1024],
    ),
    UnreadFormat("MATLAB data", "Save the arrays as .npz (scipy.io.loadmat, numpy.savez).", (".mat",),
                 _starts(b"MATLAB 5.0 MAT-file")),
    UnreadFormat(
        "HDF5",
        "A folder of pumps' own is read by `pumps export FOLDER`; of another program, save the arrays as .npz.",
        (".h5", ".hdf5"), _starts(b"\x89HDF\r\n\x1a\n"),
    ),
    UnreadFormat(
        "Parquet", "Save it as CSV with columns such as Hips.x, or as .npz.", (".parquet",), _starts(b"PAR1"),
    ),
    _TORCH,
    UnreadFormat("a pickle of Python", _AS_ARRAYS, (".pkl", ".pickle", ".p", ".joblib"),
                 lambda start: _PICKLE.match(start) is not None),
)  # fmt: skip


def unread_format(data: bytes, name: str, *, by_suffix: bool = True) -> UnreadFormat | None:
    """The format of a file that pumps does not read; None for any other file.

    Args:
        by_suffix: use the suffix if the content is unclear.
    """
    start = data[:8192]
    for each in UNREAD:
        if each.looks(start):
            return each
    if start.startswith(b"PK") and _holds_torch(data):
        return _TORCH
    suffix = PurePosixPath(name.replace("\\", "/")).suffix.lower()
    return next((each for each in UNREAD if by_suffix and suffix in each.suffixes), None)


def refuse_unread(data: bytes, name: str, *, by_suffix: bool = True) -> None:
    """Raise InputError that says how to convert a file of a format that pumps does not read."""
    found = unread_format(data, name, by_suffix=by_suffix)
    if found is not None:
        raise InputError(f"{name} is {found.what}; pumps does not read it.", found.hint)


def _holds_torch(data: bytes) -> bool:
    """Whether a zip is one of torch.save: its members are in a folder that holds data.pkl."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return any(name.endswith("/data.pkl") for name in archive.namelist()[:10_000])
    except (zipfile.BadZipFile, LookupError, OSError, ValueError, NotImplementedError, RuntimeError, OverflowError):
        return False
