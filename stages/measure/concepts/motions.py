"""The motions that are measured, as windows of positions with their actions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError
from data_schemas.manifest import Artefact
from data_schemas.motion import MotionReader
from stages.shared.concepts.actions import action_of, action_pattern
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.concepts.sequences import ConceptSet
from stages.shared.inference.recognising import RecogniserModel
from stages.shared.kinematics.resampling import resample
from stages.shared.training.action_windows import batch_of, windows_of


@dataclass(frozen=True)
class Features:
    """What the recogniser finds in N motions: features (N, D), logits (N, C), and their true actions (N,)."""

    features: np.ndarray
    logits: np.ndarray
    actions: np.ndarray


def features_of_real(model: RecogniserModel, found: ConceptSet, splits: Sequence[str]) -> Features | None:
    """Windows that follow each other in the real motions of some splits; None where there are none."""
    kinds = [model.actions.index(name) for name in found.actions]
    windows = windows_of([each for each in found.sequences if each.split in splits], model.window)
    if not windows:
        return None
    parts = [(clip.positions[start : start + model.window], kinds[clip.action]) for clip, start in windows]
    return _features(model, parts, found.body.groups)


def features_of_made(model: RecogniserModel, folder: Path, actions: str) -> tuple[Features, Artefact]:
    """The first window of each motion of an artefact, and the artefact.

    Raises: InputError for a clip of an action that the recogniser does not know, or on another rig.
    """
    pattern = action_pattern(actions)
    parts, groups = [], np.zeros(0)
    with MotionReader(folder) as reader:
        for row in reader.clips:
            action = action_of(row, pattern)
            if action not in model.actions:
                told = f"of the action {action!r}" if action else "of no known action"
                raise InputError(
                    f"The clip {row.clip!r} of {folder} is {told}, and the recogniser knows "
                    f"{', '.join(model.actions)}.",
                    "Say where the action is in the clips' sources: --actions REGEX.",
                )
            skeleton = reader.skeleton(row.skeleton)
            body = body_of(skeleton)
            if body.names != model.joints:
                raise InputError(
                    f"The clip {row.clip!r} of {folder} is on another rig ({len(body.names)} joints) than the "
                    f"recogniser was trained on ({len(model.joints)} joints).",
                    "Put it on that rig first: pumps retarget IN --to RIG.bvh -o OUT.bvh.",
                )
            groups = body.groups
            motion = resample(reader.motion(row.clip), model.fps)
            places = body_positions(skeleton, motion, body)[: model.window] * body.scale
            parts.append((places, model.actions.index(action)))
        if not parts:
            raise InputError(f"{folder} holds no motion.")
        return _features(model, parts, groups), reader.artefact


def _features(model: RecogniserModel, parts: Sequence[tuple[np.ndarray, int]], groups: np.ndarray) -> Features:
    batch = batch_of(parts, groups, model.window)
    return Features(*model.recognised(batch.motion, batch.counts), batch.action.numpy())
