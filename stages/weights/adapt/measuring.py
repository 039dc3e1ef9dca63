"""Weights on held-out windows: the error of what they fill, with their confidence and with one fitted anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from data_schemas.skeleton import Motion, Skeleton
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.confidence import Confidence
from stages.shared.inference.filling import (
    FillOptions,
    Start,
    apply_corrections,
    eased_pose,
    find_clouds,
    solve_clouds,
    start_from,
)
from stages.shared.inference.models import Models
from stages.shared.inference.trust_fit import Sums, fit
from stages.shared.inference.trust_gaps import add_gaps
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.solve.solving import Corrections
from stages.shared.statistics.baselines import Poses, slerp
from stages.shared.statistics.measurements import measured_joints
from stages.shared.statistics.metrics import l2p_m
from stages.shared.statistics.windows import Task, Window, chosen_windows, clip_windows, tasks_of
from stages.weights.adapt.clips import Clip
from stages.weights.adapt.holding_out import SPAN, Part, spans_of

TASKS = tuple(tasks_of((5, 15, 30), (15, 30, 60), (), SPAN))
_POINTS = 256
_OPTIONS = FillOptions()
_PRIOR_WINDOWS = 4.0  # as of `pumps weights calibrate`


@dataclass(frozen=True)
class HeldWindow:
    """Frames of a held-out part that one task is measured on.

    span: number of the span that it lies in. task: index into `TASKS`. half: 0 or 1; the trust of windows of one half
    is fitted on those of the other.
    """

    span: int
    task: int
    half: int
    skeleton: Skeleton
    motion: Motion
    known: np.ndarray

    def error(self, motion: Motion) -> float:
        """L2P of a filled window, metres."""
        return _l2p(Poses.of(self.skeleton, [motion]).positions.numpy(), self)


def windows_of(clips: Sequence[Clip], parts: Sequence[Part], limit: int) -> list[HeldWindow]:
    """The windows of the held-out parts: all tasks in each of at most `limit` spans."""
    held = [part for part in parts if part.held_out]
    spans = spans_of([part.frames for part in held])
    by_part = [
        [Window(str(number), start, frames) for number, start, frames in spans if number == each]
        for each in range(len(held))
    ]
    chosen = chosen_windows(by_part, limit)
    one_part = len({frames.clip for frames in chosen}) == 1
    found = []
    for number, frames in enumerate(chosen):
        part = held[int(frames.clip)]
        clip = clips[part.clip]
        whole = clip.motion.at(slice(part.start + frames.start, part.start + frames.start + frames.frames))
        half = (number >= len(chosen) / 2) if one_part else int(frames.clip) % 2
        for index, task in enumerate(TASKS):
            for within in _within(task, frames.frames):
                motion = whole.at(within.span)
                found.append(HeldWindow(number, index, int(half), clip.skeleton, motion, task.known(motion.frames)))
    return _in_both_halves(found)


def _within(task: Task, frames: int) -> list[Window]:
    """The task's one window in the middle of a span; none where it does not fit."""
    windows = clip_windows("", frames, task)
    return windows[len(windows) // 2 :][:1]


def _in_both_halves(windows: list[HeldWindow]) -> list[HeldWindow]:
    """The windows, by the number of their spans where one half would be empty."""
    if len({window.half for window in windows}) == 2:
        return windows
    return [replace(each, half=each.span % 2) for each in windows]


def slerp_errors(windows: Sequence[HeldWindow]) -> np.ndarray:
    """L2P of slerp in each window, metres."""
    return np.array([_l2p(slerp(Poses.of(each.skeleton, [each.motion]), each.known)[0], each) for each in windows])


def _l2p(positions: np.ndarray, window: HeldWindow) -> float:
    joints = measured_joints(window.skeleton)
    truth = Poses.of(window.skeleton, [window.motion]).positions.numpy()
    return float(l2p_m(positions[:, :, joints], truth[:, :, joints])[0])


@dataclass(frozen=True)
class Measured:
    """L2P of each window, metres, with the confidence that the weights have and with one fitted on the other half;
    and the trust that is fitted on both halves."""

    as_they_are: np.ndarray
    fitted: np.ndarray
    trust: np.ndarray


def measure(models: Models, windows: Sequence[HeldWindow], seed: int, advance: Callable[[], None]) -> Measured:
    """Fill all windows with some weights; `advance` is called after each one."""
    solved: list[tuple[HeldWindow, Start, Corrections]] = []
    halves = (Sums(), Sums())
    for window in windows:
        start, made = _solved(models, window, seed)
        add_gaps(start.scene, made, window.motion, (halves[window.half], made))
        solved.append((window, start, made))
        advance()
    before = None if models.confidence is None else models.confidence.trust
    by_half = [Confidence(fit([other], _PRIOR_WINDOWS, before)) for other in reversed(halves)]
    return Measured(
        np.array([_error(*each, models.confidence) for each in solved]),
        np.array([_error(*each, by_half[each[0].half]) for each in solved]),
        fit(list(halves), _PRIOR_WINDOWS, before),
    )


def _solved(models: Models, window: HeldWindow, seed: int) -> tuple[Start, Corrections]:
    """The corrections that filling finds, before they are multiplied by a confidence."""
    source = SynthesisedClouds(models)
    device = models.autoencoder.device
    start = start_from(window.skeleton, window.motion, window.known, source, device=device, options=_OPTIONS)
    with torch.no_grad():
        clouds = find_clouds(start, source, points=_POINTS, seed=seed, options=_OPTIONS)
        return start, solve_clouds(start, clouds, _OPTIONS.solve)


def _error(window: HeldWindow, start: Start, made: Corrections, confidence: Confidence | None) -> float:
    """L2P of a window filled with corrections as far as a confidence believes them."""
    with torch.no_grad():
        solved = apply_corrections(start, made, window.known, _OPTIONS, confidence)
        pose = eased_pose(solved.pose, start.parts, window.known, MODEL_FPS, _OPTIONS)
    return window.error(pose.motion(MODEL_FPS))
