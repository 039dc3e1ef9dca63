"""Other plausible fills of the same gaps: each is the default fill with a residual drawn from `Variation`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.cloud_interfaces import Drawing, Scene
from stages.shared.inference.constraints.fixed import Fixed
from stages.shared.inference.filled import Filled
from stages.shared.inference.filling import (
    FillOptions,
    Start,
    apply_corrections,
    eased_pose,
    held_fill,
    solve_clouds,
)
from stages.shared.inference.models import Autoencoder
from stages.shared.inference.partly_known import PartlyKnown
from stages.shared.inference.token_times import choose_tokens
from stages.shared.inference.variation import Variation
from stages.shared.inference.varied_clouds import VariedClouds
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.solve.skeleton_pose import SkeletonPose


def varied_fill(
    skeleton: Skeleton,
    usual: Filled,
    known: np.ndarray,
    autoencoder: Autoencoder,
    variation: Variation,
    *,
    seeds: tuple[int, ...],
    points: int = 256,
    options: FillOptions | None = None,
    fixed: Fixed | None = None,
) -> Filled:
    """Another plausible fill.

    Args:
        usual: the usual fill, T frames. known: (T,) bool, True where the frame is given; such frames come back value
            for value.
        seeds: of the residuals; the same ones give the same motion.
        points: of the cloud. options, fixed: as of `fill_motion`.

    Returns: the fill; what its figures say of the plain interpolation is copied from those of the usual fill.
    """
    known, fps = np.asarray(known, bool), usual.motion.fps
    if known.all():
        return usual
    # The residual is what true motions have beyond the fill: it is applied as it is, neither shrunk nor smoothed.
    options = replace(options or FillOptions(), turn_floor_rad=0.0, shift_floor_m=0.0, smooth_span=0.0, trust=1.0)
    start = _start_around(skeleton, usual.motion, known, autoencoder.device, fixed)
    source = VariedClouds(autoencoder, variation, seeds)
    with torch.no_grad():
        clouds = source.find(start.scene, Drawing(points, options.sigma_m, 1, 0))
        corrections = solve_clouds(start, clouds, options.solve)
        solved = apply_corrections(start, corrections, known, options, None)
    eased = eased_pose(solved.pose, start.parts, known, fps, options)
    made = held_fill(eased, solved.plain, known, fps, options, fixed, base=start.given, wander_m=usual.wander_m)
    return replace(made, base_jumps_mps=usual.base_jumps_mps, base_skate_mps=usual.base_skate_mps, plain=usual.plain)


def _start_around(
    skeleton: Skeleton, filled: Motion, known: np.ndarray, device: torch.device, fixed: Fixed | None
) -> Start:
    """As `start_from`, with a fill in the place of the plain interpolation."""
    given = SkeletonPose.of_motion(skeleton, filled)
    keys, gaps = np.flatnonzero(known), np.flatnonzero(~known)
    tokens = choose_tokens(keys, filled.frames, filled.fps)
    whole = given.by_local().to(device)
    frame_times, gap_times = (
        torch.as_tensor(frames * (MODEL_FPS / filled.fps), device=device)
        for frames in (np.arange(filled.frames), gaps)
    )
    with torch.no_grad():
        scene = Scene(tokens, whole.at(frame_times, torch.as_tensor(tokens.times, device=device)))
    parts = None if fixed is None else PartlyKnown.of(fixed, known, given)
    return Start(given, whole.rows(keys), whole.rows(gaps), scene, gap_times, parts)
