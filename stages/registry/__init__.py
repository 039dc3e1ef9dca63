"""Every stage, in order: the command that runs it, what it reads and writes. Help, README and tests come from here.

Modules are named by strings, so that asking what stages there are loads none of them.
"""

from __future__ import annotations

from stages.registry import editing, pipeline, tools
from stages.registry.stage import Stage

STAGES: tuple[Stage, ...] = pipeline.STAGES + editing.STAGES + tools.STAGES

# What `pumps --help` shows: panel -> words after `pumps`, in the order of reading.
PANELS = {
    "Animate": (
        "demo",
        "infill",
        "retarget",
        "studio",
        "edit",
        "denoise",
        "estimate",
        "generate",
        "segment",
        "refine",
        "inspect",
        "export",
        "report",
        "formats",
        "doctor",
    ),
    "Data": ("data", "ingest", "artefact"),
    "Meshes": ("skin", "simulate-cloth", "predict-mesh", "complete-mesh", "export-mesh"),
    "Train": ("sample-tpc", "encode", "train", "weights", "config", "run"),
    "Research": ("evaluate", "measure", "body-parts", "stream", "decode", "project", "results", "stages"),
}

GROUP_SUMMARIES = {
    "body-parts": "Put bodies together from trained parts.",
    "data": "List and download public data sets; pick clips, or put them on other rigs.",
    "edit": "Change whole files: trim, resample, mirror, smooth, loop, join.",
    "ingest": "Read recordings into a motion artefact.",
    "measure": "Measure one part: autoencoders, latents, the solver, motions.",
    "train": "Train a network.",
    "weights": "List, show and fetch weights; average, calibrate, adapt and pack your own.",
}

# Names of stages in 0.1.0 -> names now. Settings files and `--set` may have the old ones for one more version.
OLD_NAMES = {
    "average-checkpoints": "weights-average",
    "calibrate": "weights-calibrate",
    "fetch-data": "data-fetch",
    "list-data": "data-list",
    "list-weights": "weights-list",
    "pack-weights": "weights-pack",
    "pick-clips": "data-pick",
    "retarget-clips": "data-rerig",
    "show-weights": "weights-show",
}
# Those of them that were commands. They are not in help, and are removed in the next version.
OLD_WORDS = ("average-checkpoints", "calibrate", "pack-weights", "pick-clips", "retarget-clips")


def stage_named(name: str) -> Stage:
    """The stage with this name. Raises KeyError."""
    for stage in STAGES:
        if stage.name == name:
            return stage
    raise KeyError(f"no stage is called {name!r}; there are {', '.join(NAMES)}")


def downstream_of(names: set[str]) -> set[str]:
    """The pipeline stages that must run again when these have, themselves included."""
    stale = set(names)
    for stage in PIPELINE:  # in order, so that one pass reaches everything
        if stale.intersection(stage.needs):
            stale.add(stage.name)
    return stale


PIPELINE = tuple(stage for stage in STAGES if stage.pipeline)
NAMES = tuple(stage.name for stage in STAGES if not stage.form_of)
