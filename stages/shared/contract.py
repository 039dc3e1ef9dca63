"""What every stage's Config and Report share. Imports no torch, so that flags and help are made without it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from data_schemas.errors import UsageError

_Item = TypeVar("_Item")

# What `json_schema_extra` of a Config's field may say to the command line:
OFTEN_SET = "often_set"  # where any field has it, `--help` shows those alone, and `--help-all` the others too
VALUES = "values"  # a list of values that the shell completes
NAMES_OF = "names_of"  # "weights" or "data sets", whose names the shell completes
OFTEN: JsonDict = {OFTEN_SET: True}


class StageConfig(BaseModel):
    """Base of the stages' configs: frozen, typed, unknown keys refused. A field's description is its help text."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class SeededConfig(StageConfig):
    """A stage that draws random numbers."""

    seed: int = Field(0, description="Seed of all random draws; the same seed gives the same result.")


class WritingConfig(StageConfig):
    """A stage that writes files or artefacts; `stages.shared.outputs` applies the rule for those that exist."""

    # Not part of the settings that are stored: it does not change the result.
    overwrite: bool = Field(False, exclude=True, description="Replace an output that exists.")


class ClusterConfig(StageConfig):
    """A stage over many files or clips, which the machines of a cluster may do together."""

    cluster: str | None = Field(
        None,
        exclude=True,  # It does not change the result.
        description="Address of a Dask scheduler whose workers share the work, such as tcp://host:8786 (extra "
        "`pumps[cluster]`).",
    )


class ManyFilesConfig(WritingConfig, ClusterConfig):
    """A stage that makes one file from another. Given a folder, glob or archive, it makes a file in the output folder
    from each.

    table_columns: figures of each file's report that the table of all files has columns for.
    """

    table_columns: ClassVar[tuple[str, ...]] = ()

    jobs: int = Field(
        0,
        exclude=True,
        description="Processes that work on the files of a folder, glob or archive; 0 for one per core.",
        ge=0,
        le=1024,
    )

    def outputs_of(self, output: Path) -> tuple[Path, ...]:
        """The files that are written where `output` is asked for."""
        return (output,)

    def suffix_of(self, own: str, writable: Collection[str]) -> str:
        """The suffix of the file that is written for one of a folder, glob or archive.

        Args:
            own: the input's suffix. writable: suffixes of the formats of motion that pumps writes.

        Raises: UsageError for a suffix that the stage does not write.
        """
        raise NotImplementedError


class MotionFilesConfig(ManyFilesConfig):
    """A stage that makes one file of motion from another."""

    suffix: str | None = Field(
        None,
        description="Suffix of the files written for a folder, glob or archive, such as .glb; by default each "
        "input's own where pumps writes it, else .bvh.",
    )

    def suffix_of(self, own: str, writable: Collection[str]) -> str:
        if self.suffix is None:
            return own if own in writable else ".bvh"
        if self.suffix.lower() not in writable:
            raise UsageError(f"--suffix {self.suffix} is not one that pumps writes.", f"Give {', '.join(writable)}.")
        return self.suffix


class DeviceConfig(StageConfig):
    """A stage that runs a network."""

    device: str = Field(
        "auto",
        json_schema_extra={VALUES: ["auto", "cpu", "cuda", "mps"]},
        description="Where to compute: auto, cpu, cuda or mps.",
    )


class ShardedConfig(ClusterConfig):
    """A stage over many files or clips, of which each machine may also do one part, without a cluster."""

    shard: str | None = Field(
        None, description="Do one part alone, as 2/5 for the second of five; `pumps artefact merge` joins the parts."
    )

    def share_of(self, items: Sequence[_Item]) -> tuple[_Item, ...]:
        """The items of this part: every n-th, so that parts weigh alike; all of them where there are no parts.

        Raises: UsageError for a part that cannot be.
        """
        if self.shard is None:
            return tuple(items)
        part, _, parts = self.shard.partition("/")
        if not (part.isdecimal() and parts.isdecimal() and len(self.shard) < 20 and 1 <= int(part) <= int(parts)):
            raise UsageError(f"--shard {self.shard} is not a part of a whole.", "Give 1/3, 2/3 or 3/3, for example.")
        return tuple(items[int(part) - 1 :: int(parts)])


class StageReport(BaseModel):
    """What a stage reports when it is done: plain data, printed by the command line or dumped as JSON."""

    output: Path | None = None
    lines: list[str] = Field(default_factory=list, description="What a person should read, one sentence or row each.")
    gist: list[str] = Field(
        default_factory=list,
        description="Those of the lines that a page with room for a few shows, warnings first.",
    )
    figures: dict[str, Any] = Field(default_factory=dict, description="Counts and numbers for machines.")
    tints: dict[int, str] = Field(
        default_factory=dict, exclude=True, description="Line -> what it is about; a terminal may colour it so."
    )
