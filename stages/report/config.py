"""Settings of `pumps report`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """One HTML page that opens offline: results, loss curves, motions side by side in 3D."""

    metrics: Path | None = Field(None, description="The metrics artefact whose tables are shown.")
    fills: tuple[Path, ...] = Field(
        (),
        description="Metrics artefact of `pumps evaluate --keep-fills`: its windows are played and drawn as film"
        " strips and spectra. Several are of other methods on the same windows.",
    )
    max_windows: int = Field(
        2, description="Most windows of --fills to play of each archive, task and interval, spread evenly.", ge=1
    )
    checkpoints: tuple[Path, ...] = Field((), description="Checkpoint artefact whose training log is plotted.")
    motions: tuple[str, ...] = Field(
        (),
        description="NAME=PATH of a BVH (FILE.zip!MEMBER too) or a motion artefact to play side by side, the true"
        " motion first; SCENE/NAME=PATH for several scenes. SCENE is a title, or TITLE: DETAIL.",
    )
    samples: tuple[str, ...] = Field(
        (),
        description="BVH of one of several fills (`pumps infill --samples`), or a pattern such as 'tries-*.bvh'. The"
        " page plays the fills over each other and charts their distances by frame.",
    )
    truth: Path | None = Field(None, description="BVH of the true motion of --samples.")
    keyframes: str = Field("every:15", description="Which frames of the motions were known.")
    scene_keyframes: tuple[str, ...] = Field((), description="SCENE=FRAMES: the known frames of one scene.")
    slerp: bool = Field(True, description="Also play slerp between the keyframes of the first motion of each scene.")
    max_clips: int = Field(8, description="Most clips to play from motion artefacts.", ge=1)
    max_seconds: float = Field(40, description="Longest time to play of each motion, in seconds.", gt=0)
    title: str = Field("Motion, filled in", description="Heading of the page.")
    licences: tuple[str, ...] = Field(
        (), description="Licence of the motions that are files; shown at the end of the page."
    )
    output: Path = Field(description="HTML file to write.")
    picture: Path | None = Field(None, description="SVG file to write, too: poses across one gap of each scene.")
    animation: Path | None = Field(
        None, description="SVG file to write, too: the scenes playing beside their keys, for pages without scripts."
    )
    pictured: tuple[str, ...] = Field((), description="Scene to show in picture and animation; by default all.")
