"""Gaps filled by transition concepts (motion concepts 3.1.3): the keys of a gap are its anchors."""

from __future__ import annotations

import numpy as np
import torch

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.concepts.posing import follow_positions
from stages.shared.inference.filled import Filled, nothing_to_fill
from stages.shared.inference.filling import FillOptions, eased_pose, held_fill
from stages.shared.inference.refining import ConceptModel, check_rig, sampled_transition
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.plain_interpolation import damped_smoothness
from stages.shared.solve.skeleton_pose import SkeletonPose


def concept_fill(
    model: ConceptModel,
    skeleton: Skeleton,
    motion: Motion,
    known: np.ndarray,
    *,
    seeds: tuple[int, ...] | None = None,
    options: FillOptions | None = None,
) -> Filled:
    """Fill each gap by a transition between the keys on both sides of it.

    The plain interpolation is moved to the transition's joint positions by the least turns of its bones, so what
    positions do not show (roll, fingers) is interpolated.

    Args:
        motion: T frames of any rate; only the known ones are read. known: (T,) bool; they come back value for value.
        seeds: of the codes of the transitions; None takes the most likely code, zero, for each.
        options: how keys are eased and feet held.

    Raises: UsageError where the first or the last frame is missing; InputError for another rig than the model's.
    """
    options, known = options or FillOptions(), np.asarray(known, bool)
    if known.all():
        return nothing_to_fill(motion)
    if not (known[0] and known[-1]):
        raise UsageError(
            "Transition concepts lead from one keyframe to another.", "Make the first and the last frame keyframes."
        )
    body = body_of(skeleton)
    check_rig(model, body, "The motion")
    keys, gaps = np.flatnonzero(known), np.flatnonzero(~known)
    given = SkeletonPose.of_motion(skeleton, motion)
    key_times, gap_times = (torch.as_tensor(frames * (MODEL_FPS / motion.fps)) for frames in (keys, gaps))
    plain = given.rows(keys).by_local().at(key_times, gap_times, damped_smoothness(key_times, MODEL_FPS))
    base = given.with_rows(gaps, plain)
    places = body_positions(skeleton, base.motion(motion.fps), body)
    codes = None if seeds is None else torch.Generator().manual_seed(_one_seed(seeds))
    for first, last in zip(keys[:-1].tolist(), keys[1:].tolist(), strict=True):
        if last - first > 1:
            begin, end = places[first] * body.scale, places[last] * body.scale
            made = sampled_transition(model, begin, end, last - first, codes, fps=motion.fps)
            places[first + 1 : last] = made[1:-1] / body.scale
    followed = follow_positions(skeleton, base.motion(motion.fps).at(gaps), body, places[gaps])
    if not (np.isfinite(followed.rotations).all() and np.isfinite(followed.root_positions).all()):
        raise InputError("The networks give numbers that are not finite.", "Train them again: pumps train concepts.")
    pose = given.with_rows(gaps, SkeletonPose.of_motion(skeleton, followed).by_local())
    eased = eased_pose(pose, None, known, motion.fps, options)
    kept = np.zeros(motion.rotations.shape[:2], bool)
    # No point rides on a bone here, so none can stray.
    return held_fill(eased, kept, known, motion.fps, options, None, base=base, wander_m=0.0)


def _one_seed(seeds: tuple[int, ...]) -> int:
    """One seed of several numbers."""
    return int(np.random.SeedSequence(seeds).generate_state(1, np.uint64)[0] >> np.uint64(1))
