"""The table of formats that pumps reads: each one's files, how its content is recognised, its reader, its traps.

Readers are named by strings, so that a run imports only the readers that it needs.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from data_schemas.errors import InputError
from stages.shared.formats.smpl_keys import is_smpl
from stages.shared.formats.sources import Source, above, beside
from stages.shared.formats.table_columns import looks_like_places, looks_trc
from stages.shared.formats.unread_formats import refuse_unread

if TYPE_CHECKING:
    from stages.shared.formats.recording import Asked, Recording

_LOOKED_AT = 8192
_CSV_QUATERNION = re.compile(rb"(?:\w*[._ ])?(?:q|quat|quaternion|r|rot|rotation|orn|orientation)[._ ]*w")
_CSV_NUMBER = re.compile(rb"[-+]?[\d.]+(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Format:
    """One format.

    name:     its name in `pumps ingest`.
    suffixes: of its files, lower case. shared: True if files of other kinds often have the same suffixes.
    reader:   "module:function" of (data, name, Asked) -> list of Recording.
    looks:    whether the start of a file looks like this format.
    rig:      suffix of the skeleton files beside its recordings, or "".
    reads, traps: for the table in docs/formats.md.
    """

    name: str
    suffixes: tuple[str, ...]
    reader: str
    looks: Callable[[bytes], bool]
    reads: str
    traps: str
    shared: bool = False
    rig: str = ""

    def read(self, data: bytes, name: str, asked: Asked) -> list[Recording]:
        """The clips of a file. Raises InputError naming the file."""
        module, _, function = self.reader.partition(":")
        return getattr(import_module(module), function)(data, name, asked)


def _looks_bvh(start: bytes) -> bool:
    return b"HIERARCHY" in start.upper()


def _looks_amc(start: bytes) -> bool:
    return re.search(rb"(?mi)^:(fully-specified|degrees|radians)\s*$", start.replace(b"\r", b"\n")) is not None


def _looks_amass(start: bytes) -> bool:
    return False  # a zip's list of members is at its end: `recognise` reads it


def _looks_deepmimic(start: bytes) -> bool:
    return start.lstrip().startswith(b"{") and b'"Frames"' in start


def _looks_gltf(start: bytes) -> bool:
    return start.startswith(b"glTF") or (start.lstrip().startswith(b"{") and b'"asset"' in start)


def _looks_robot(start: bytes) -> bool:
    head = start.removeprefix(b"\xef\xbb\xbf").lstrip().replace(b"\r", b"\n").partition(b"\n")[0].lower()
    cells = [cell.strip().strip(b'"') for cell in re.split(rb"[,;\t]", head)]
    quaternions = sum(_CSV_QUATERNION.fullmatch(cell) is not None for cell in cells)
    if quaternions:  # a robot has one, its root's; a table of all joints' rotations has one for each
        return quaternions == 1
    whole = cells if len(head) < len(start) else cells[:-1]  # the last one may be cut
    return len(whole) > 7 and all(_CSV_NUMBER.fullmatch(cell) for cell in whole)


def _looks_positions(start: bytes) -> bool:
    return start.startswith(b"\x93NUMPY") or looks_trc(start) or looks_like_places(start)


FORMATS: tuple[Format, ...] = (
    Format(
        "bvh", (".bvh",), "stages.shared.formats.bvh_motion:read_bvh_motion", _looks_bvh,
        "all variants found in public data: any channel order per joint, positions on any joints, namespaces, blanks"
        " in names, missing end sites, tabs, any newline, rows wrapped over several lines",
        "Unit and up axis are found from the body. The header's zero pose need not be a human pose. Frame times may"
        " be wrong (`--fps-override`). A file with two ROOTs is refused.",
    ),
    Format(
        "asf", (".amc",), "stages.shared.formats.amc:read_asf_amc", _looks_amc,
        "AMC with the ASF of its folder (of several, the one whose name the AMC's name starts with) or of"
        " `--skeleton`; axes per bone, any subset and order of channels, degrees or radians",
        "Lengths are inches divided by the ASF's `length` (CMU: 0.45). Most files state no rate: 120 is assumed."
        " Bones' translations and stretching are left out.",
        rig=".asf",
    ),
    Format(
        "amass", (".npz",), "stages.shared.formats.amass:read_amass", _looks_amass,
        "SMPL, SMPL-H and SMPL-X poses, AMASS' old and new layouts (`poses`, or `root_orient`, `pose_body`, ...;"
        " either spelling of the rate) and the smplx package's names (`global_orient`, `body_pose`, `transl`, ...);"
        " rotation vectors or rotation matrices; with `--body-models DIR` the subject's own joints from `betas` and"
        " `gender`",
        "Z up, unless the body stands along Y: that is reported. The smplx package's parameters state no rate: 30 is"
        " assumed. Without a body model the joints are those of a neutral body of about 1.7 m and only"
        " approximate. `dmpls` are left out. Pickles are not read: body models must be `.npz`.",
    ),
    Format(
        "deepmimic", (".json", ".txt"), "stages.shared.formats.deepmimic:read_deepmimic_motion", _looks_deepmimic,
        "humanoid3d clips, 44 numbers per frame",
        "Frames that last unequally long are resampled to a constant rate.",
        shared=True,
    ),
    Format(
        "robot", (".csv",), "stages.shared.formats.robot_csv:read_robot_csv", _looks_robot,
        "joint angles of a robot with its URDF: the root's place and quaternion (x, y, z, w), then one angle per"
        " joint in the URDF's order, or in that of a first line of names; the URDF is in the same folder, in the one"
        " above, anywhere in the same archive, or given with `--skeleton`",
        "Z up, metres, radians. It states no rate: 30 is assumed (`--fps-override`). Joints that slide are refused."
        " Meshes are never opened: the ends of feet and hands come from solids and fixed links.",
        shared=True, rig=".urdf",
    ),
    Format(
        "positions", (".npy", ".npz", ".csv", ".trc"), "stages.shared.formats.positions:read_positions",
        _looks_positions,
        "joint positions (T, J, 3), columns `Hips.x, Hips.y, Hips.z`, or a `.trc` of OpenSim or Pose2Sim; landmarks"
        " of MediaPipe (33), COCO (17) and Halpe (26); rotations by inverse kinematics",
        "Names come from the file, a sidecar, or `--skeleton` (a rig, or the name of a known list). Columns go to the"
        " joints of their names; others are left out and reported. Angles are refused. Positions do not determine the"
        " twist about a bone: the smallest is used. Without a rate 30 is assumed.",
        shared=True, rig=".json",
    ),
    Format(
        "gltf", (".glb", ".gltf"), "stages.shared.formats.gltf_motion:read_gltf", _looks_gltf,
        "skins with animations, one clip each, or animated nodes where there is no skin; linear, step and cubic"
        " samplers; buffers inside the file",
        "Metres. All clips are on one skeleton, whose lengths are those of the nodes at rest. Scales that vary or"
        " differ by axis are refused; constant ones are multiplied into the lengths. Buffers in other files are not"
        " read.",
    ),
)  # fmt: skip
NAMES = tuple(each.name for each in FORMATS)
AUTO = "auto"


def format_named(name: str) -> Format:
    """The format with this name. Raises KeyError."""
    return next(each for each in FORMATS if each.name == name)


def suffixes_of(name: str) -> tuple[str, ...]:
    """Suffixes of the files that `pumps ingest NAME` looks for in folders and archives; all of them for "auto"."""
    chosen = FORMATS if name == AUTO else (format_named(name),)
    return tuple(dict.fromkeys(suffix for each in chosen for suffix in each.suffixes))


def rig_suffixes() -> tuple[str, ...]:
    """Suffixes of the skeleton files that lie beside recordings."""
    return tuple(each.rig for each in FORMATS if each.rig)


def recognise(data: bytes, name: str) -> Format | None:
    """The format of a file by its content, or by its suffix if the content is unclear; None if it is not a recording.

    Raises: InputError for a format that is recognised but cannot be read.
    """
    start = data[:_LOOKED_AT]
    suffix = PurePosixPath(name.replace("\\", "/")).suffix.lower()
    by_suffix = [each for each in FORMATS if suffix in each.suffixes]
    for each in by_suffix:
        if each.looks(start):
            return each
    refuse_unread(data, name, by_suffix=False)
    if start.startswith(b"PK"):
        return _of_arrays(data)
    for each in FORMATS:
        if each.looks(start):
            return each
    chosen = next((each for each in by_suffix if not each.shared and each.name != "amass"), None)
    if chosen is None:
        refuse_unread(data, name)
    return chosen


def _of_arrays(data: bytes) -> Format | None:
    """AMASS or positions, by the names of the arrays; None for AMASS' files that hold body shapes only."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            arrays = {name.removesuffix(".npy") for name in archive.namelist()[:1000]}
    except (zipfile.BadZipFile, LookupError, OSError, ValueError, NotImplementedError, RuntimeError):
        return format_named("amass")  # its reader reports the fault
    if is_smpl(arrays):
        return format_named("amass")
    if arrays <= {"betas", "gender", "num_betas", "surface_model_type", "v_template", "labels", "labels_obs"}:
        return None
    return format_named("positions")


def rig_beside(source: Source, suffix: str) -> Source | None:
    """The skeleton file of a recording: the one whose name starts the recording's, else the only one in its folder.

    A JSON file must have the recording's name or be called skeleton.json, since it may hold anything.
    """
    found = beside(source, suffix) or (above(source, suffix) if suffix == ".urdf" else [])
    stem = PurePosixPath(source.member).stem.lower()
    stems = {each: PurePosixPath(each.member).stem.lower() for each in found}
    fitting = [each for each in found if stem.startswith(stems[each])]
    if suffix == ".json":
        fitting = [each for each in found if stems[each] in (stem, "skeleton")]
    elif not fitting and len(found) == 1:
        fitting = found
    return max(fitting, key=lambda each: len(stems[each]) + 1000 * (stems[each] == stem), default=None)


def recordings_in(source: Source, asked: Asked) -> list[Recording]:
    """The clips of a file of any format. Raises InputError naming the file if it is not a recording."""
    data = source.read()
    chosen = recognise(data, source.name)
    if chosen is None:
        raise InputError(
            f"{source.name} is not a recording in a format that pumps reads.", "docs/formats.md lists the formats."
        )
    return read_recordings(data, source, chosen, asked)


def read_recordings(data: bytes, source: Source, chosen: Format, asked: Asked) -> list[Recording]:
    """The clips of a source's bytes; without a rig in `asked`, the rig file beside the source is read.

    Raises: InputError naming the file.
    """
    refuse_unread(data, source.name, by_suffix=False)
    if chosen.rig and not asked.rig and not asked.rig_name:
        rig = rig_beside(source, chosen.rig)
        if rig is not None:
            asked = replace(asked, rig=rig.read(), rig_name=rig.name)
    return chosen.read(data, source.name, asked)
