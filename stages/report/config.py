"""Settings of `pumps report`."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from stages.shared.contract import WritingConfig


class Config(WritingConfig):
    """One HTML page that opens offline: results, loss curves, motions side by side in 3D."""

    metrics: Path | None = Field(None, description="The metrics artefact.")
    checkpoints: tuple[Path, ...] = Field((), description="Checkpoint artefacts whose logs are drawn.")
    motions: tuple[str, ...] = Field(
        (),
        description="NAME=PATH of BVH files or motion artefacts to play side by side, the truth first; "
        "SCENE/NAME=PATH for several scenes, SCENE a title or TITLE: DETAIL.",
    )
    keyframes: str = Field("every:15", description="Which frames of the motions were known.")
    scene_keyframes: tuple[str, ...] = Field((), description="SCENE=FRAMES where a scene's known frames are others.")
    slerp: bool = Field(True, description="Also play slerp between the keyframes of a scene's first motion.")
    max_clips: int = Field(8, description="Clips to take from motion artefacts.", ge=1)
    max_seconds: float = Field(40, description="Longer motions are played up to here.", gt=0)
    title: str = Field("Motion, filled in", description="The page's heading.")
    licences: tuple[str, ...] = Field(
        (), description="Licences of the motions that are files, to be told at the foot."
    )
    output: Path = Field(description="The HTML file to write.")
    picture: Path | None = Field(None, description="Also an SVG to write: poses over a gap of each scene.")
    pictured: tuple[str, ...] = Field((), description="Scenes in the picture; all of them by default.")
