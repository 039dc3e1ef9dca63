"""Settings that all verbs of `pumps edit` share. Imports no torch."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from stages.shared.contract import MotionFilesConfig, WritingConfig

_INPUT = (
    "Motion to change: a BVH, whose text and untouched rows stay, a robot's joint angles, or any format that pumps "
    "reads. FILE.zip!MEMBER reads from an archive"
)
_OUTPUT = (
    "File to write: .bvh, .glb, .npz, .csv or .parquet. With the input's suffix, a BVH and a robot's joint angles "
    "keep their layout."
)


def seconds_in(value: object) -> object:
    """A time as a number in text, without the unit `s` that may follow it; all else as it is."""
    text = value.strip() if isinstance(value, str) else ""
    return text[:-1].strip() if text.lower().endswith("s") else value


class EditConfig(WritingConfig):
    """Change a whole file, of any format that pumps reads."""

    input: Path = Field(description=f"{_INPUT}.")
    output: Path = Field(description=_OUTPUT)
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0, lt=1e6
    )
    up_axis: Literal["y", "z"] | None = Field(
        None, description="Up axis of the file's world, if it is not the one that the body's poses show."
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton for files that have none: an ASF for AMC, a URDF for a robot's joint angles, a BVH "
        "or the name of a joint list for positions.",
    )
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body (`pumps inspect FILE --map` prints one)."
    )


class ManyEditsConfig(EditConfig, MotionFilesConfig):
    """The same of each file in a folder, archive or pattern."""

    input: Path = Field(description=f"{_INPUT}; of a folder, archive or pattern, each file is changed.")
    output: Path = Field(description=f"{_OUTPUT} For several files, a folder.")
