"""Settings of `pumps inspect`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field

from stages.shared.contract import ManyFilesConfig


class Config(ManyFilesConfig):
    """Describe what a motion file holds."""

    table_columns: ClassVar[tuple[str, ...]] = ("joints", "fps", "problems")

    input: str = Field(
        description="File of any format that pumps reads (FILE.zip!MEMBER too), or an archive, folder or pattern "
        "whose files are listed."
    )
    output: Path | None = Field(
        None,
        description="JSON file to write the description to (with --map, the map as TOML). For an archive, folder or "
        "pattern, a folder: one such file each, and files.csv with a row each.",
    )
    map: bool = Field(False, description="Print only the skeleton map, as TOML to edit.")
    skeleton_map: Path | None = Field(
        None, description="TOML that assigns joints to parts of the body; --map prints one."
    )
    skeleton: str | None = Field(
        None,
        description="Skeleton for files that have none: an ASF for AMC, a URDF for a robot's joint angles, a BVH "
        "or the name of a joint list for positions.",
    )
    body_models: Path | None = Field(None, description="Folder of SMPL-like body models (.npz), for AMASS files.")
    up_axis: Literal["y", "z"] | None = Field(
        None, description="Up axis of the files' world, if it is not the one that the body's poses show."
    )
    rest_frame: int | None = Field(None, description="Frame to use as the reference pose instead of an estimate.")
    fps_override: float | None = Field(
        None, description="True frame rate in frames per second, if the file states a wrong one.", gt=0
    )

    def suffix_of(self, own: str, writable: Collection[str]) -> str:
        """JSON for a description, TOML for a map, whatever the input is."""
        return ".toml" if self.map else ".json"
