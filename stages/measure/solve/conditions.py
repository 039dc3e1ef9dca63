"""Clouds to follow, from true ones to bad ones, each drawn on a real motion, so that the truth is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from data_schemas.skeleton import BODY_GROUPS, Motion, Skeleton
from stages.measure.solve.config import Config
from stages.measure.solve.rigs import RIGS, Rigged, with_other_proportions
from stages.shared.inference.clouds import place_on_pose
from stages.shared.pointcloud.drawn_points import draw_on_skeleton
from stages.shared.solve.following import FollowOptions
from stages.shared.solve.skeleton_pose import pose_of_motion
from stages.shared.solve.solving import SolveOptions

TRUE = "true cloud"
SCALES = (0.7, 0.85, 1.0, 1.15, 1.3)
NOISES_MM = (10, 30, 60)
COUNTS = (64, 128, 512)
KEYS_EVERY = 15  # of all conditions except the first
ONE_KEY = 0  # the interval of a clip of which only the first frame is known
OTHER_BODY = FollowOptions(solve=SolveOptions(point_noise_m=0.01, rigid_start=True, slack_m=0.1), scale=None)


@dataclass(frozen=True)
class Case:
    """A cloud and the motion that should result.

    points: (T, P, 3) in random order; groups: (P,). options: what the solve knows of the cloud.
    """

    skeleton: Skeleton
    motion: Motion
    known: np.ndarray
    points: Tensor
    groups: Tensor
    options: FollowOptions


@dataclass(frozen=True)
class Condition:
    """name: in tables. interval: frames between keys, or `ONE_KEY`. make: builds a case from a motion and a
    generator."""

    name: str
    interval: int
    make: Callable[[Rigged, np.random.Generator], Case]


def conditions_of(config: Config) -> list[Condition]:
    """All measured conditions, in order. True clouds come first, once for each interval."""
    return [condition for name in dict.fromkeys(config.conditions) for condition in _OF[name](config)]


def known_every(frames: int, interval: int) -> np.ndarray:
    """(frames,) bool: every so many frames and the last one, or for `ONE_KEY` only the first."""
    known = np.zeros(frames, bool)
    known[:: interval or frames] = True
    known[-1] |= bool(interval)
    return known


def _case(
    rigged: Rigged,
    rng: np.random.Generator,
    *,
    config: Config,
    interval: int = KEYS_EVERY,
    points: int | None = None,
    without: int | None = None,
    scale: float = 1.0,
    noise_m: float = 0.0,
    source: Rigged | None = None,
    options: FollowOptions | None = None,
) -> Case:
    """A cloud drawn on the motion (or on `source`, another body in the same pose) and damaged as the condition
    says."""
    body = source or rigged
    drawn = draw_on_skeleton(body.skeleton, points or config.points, rng, config.sigma_m)
    order = torch.as_tensor(rng.permutation(len(drawn.groups)))
    cloud = scale * place_on_pose(drawn, pose_of_motion(body.skeleton, body.motion), body.skeleton)[:, order]
    groups = drawn.groups[order]
    if without is not None:
        cloud, groups = cloud[:, groups != without], groups[groups != without]
    if noise_m:
        cloud = cloud + torch.as_tensor(rng.normal(0, noise_m, cloud.shape), dtype=torch.float32)
    known = known_every(rigged.motion.frames, interval)
    return Case(rigged.skeleton, rigged.motion, known, cloud, groups, options or FollowOptions())


def _true(config: Config) -> Iterator[Condition]:
    for interval in config.intervals:
        yield Condition(TRUE, interval, partial(_case, config=config, interval=interval))


def _groups(config: Config) -> Iterator[Condition]:
    for group, name in enumerate(BODY_GROUPS):
        yield Condition(f"no {name.replace('_', ' ')}", KEYS_EVERY, partial(_case, config=config, without=group))


def _scales(config: Config) -> Iterator[Condition]:
    found = FollowOptions(scale=None)
    for scale in SCALES:
        yield Condition(
            f"{scale:g} of the size", KEYS_EVERY, partial(_case, config=config, scale=scale, options=found)
        )
    yield Condition("other proportions", KEYS_EVERY, partial(_other_body, config=config, interval=KEYS_EVERY))


def _noise(config: Config) -> Iterator[Condition]:
    for noise in NOISES_MM:
        yield Condition(f"noise {noise} mm", KEYS_EVERY, partial(_case, config=config, noise_m=noise / 1000))


def _points(config: Config) -> Iterator[Condition]:
    for count in COUNTS:
        yield Condition(f"{count} points", KEYS_EVERY, partial(_case, config=config, points=count))


def _rigs(config: Config) -> Iterator[Condition]:
    for name in RIGS:
        yield Condition(f"rig: {name.replace('-', ' ')}", KEYS_EVERY, partial(_on_rig, name=name, config=config))


def _keys(config: Config) -> Iterator[Condition]:
    yield Condition("one key", ONE_KEY, partial(_case, config=config, interval=ONE_KEY))
    found = FollowOptions(scale=None)
    sized = partial(_case, config=config, interval=ONE_KEY, scale=SCALES[-1], options=found)
    yield Condition(f"one key, {SCALES[-1]:g} of the size", ONE_KEY, sized)
    yield Condition("one key, other proportions", ONE_KEY, partial(_other_body, config=config, interval=ONE_KEY))


def _other_body(rigged: Rigged, rng: np.random.Generator, *, config: Config, interval: int) -> Case:
    source = with_other_proportions(rigged, rng)
    return _case(rigged, rng, config=config, interval=interval, source=source, options=OTHER_BODY)


def _on_rig(rigged: Rigged, rng: np.random.Generator, *, name: str, config: Config) -> Case:
    return _case(RIGS[name](rigged, rng), rng, config=config)


_OF: dict[str, Callable[[Config], Iterator[Condition]]] = {
    "true": _true,
    "groups": _groups,
    "scales": _scales,
    "noise": _noise,
    "points": _points,
    "rigs": _rigs,
    "keys": _keys,
}


def shortened(motion: Motion, seconds: float) -> Motion:
    """A part of this many seconds from the middle of a motion, or all of a shorter one."""
    frames = min(motion.frames, round(seconds * motion.fps))
    first = (motion.frames - frames) // 2
    return motion.at(slice(first, first + frames))
