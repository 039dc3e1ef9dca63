"""The verbs of `pumps edit`: changes of whole files."""

from __future__ import annotations

from stages.registry.stage import Stage

_WRITES = "BVH, GLB, npz, CSV, Parquet"


def _verb(name: str, summary: str, example: str, *more: str, reads: tuple[str, ...] = ("any format",)) -> Stage:
    """`pumps edit NAME`. more: further arguments after the input."""
    return Stage(
        ("edit", name), summary, reads, _WRITES, example, arguments=("input", *more), pipeline=False
    )  # fmt: skip


STAGES: tuple[Stage, ...] = (
    _verb("trim", "Keep a range of a file's frames.", "pumps edit trim walk.bvh --frames 10:50 -o short.bvh"),
    _verb(
        "resample",
        "Give a file another frame rate; poses at times that both rates have stay as they are.",
        "pumps edit resample walk.bvh --fps 60 -o walk_60.bvh",
    ),
    _verb("mirror", "Exchange left and right.", "pumps edit mirror kick.bvh -o other_foot.bvh"),
    _verb(
        "smooth",
        "Smooth a whole motion in time; its first and last frame stay.",
        "pumps edit smooth walk.bvh --seconds 0.2 -o smooth.bvh",
    ),
    _verb(
        "loop",
        "Add frames after a clip's last one that lead to its first pose, at the place where the clip ends, so that "
        "it can be repeated.",
        "pumps edit loop walk.bvh -o walk_loop.bvh",
        reads=("any format", "checkpoint"),
    ),
    _verb(
        "join",
        "Put a second clip after a first one of the same rig, with filled frames between them.",
        "pumps edit join walk.bvh run.bvh --blend 0.5 -o both.bvh",
        "then",
        reads=("any format", "checkpoint"),
    ),
)
