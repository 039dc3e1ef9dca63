"""Methods that compute a motion from a cloud and a few known poses: slerp, which ignores the cloud; the solve; rig
networks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion
from stages.measure.solve.conditions import Case
from stages.measure.solve.config import Config
from stages.shared.inference.skeleton_decoding import RigNetwork, decode_cloud, load_rig_network, solve_from_network
from stages.shared.networks.layers.device import choose_device
from stages.shared.solve.following import follow_cloud
from stages.shared.solve.skeleton_pose import pose_of_motion, replace_rows

SLERP, SOLVE = "slerp", "solve"


@dataclass(frozen=True)
class Method:
    """A row of the tables. make: computes a motion from a case, with the same number of frames, or returns None if it
    cannot."""

    name: str
    make: Callable[[Case], Motion | None]
    source: str = ""


def methods_of(config: Config) -> list[Method]:
    """All methods. Raises UsageError if two networks have the same name, InputError if one cannot be read."""
    device = choose_device(config.device)
    methods = [Method(SLERP, slerp), Method(SOLVE, lambda case: solve(case, device))]
    for text in config.networks:
        name, equals, source = text.partition("=")
        if not (name and equals and source) or name in {method.name for method in methods}:
            raise UsageError(
                f"--networks {text!r} is not NAME=FOLDER of its own.", "Write --networks mine=runs/mine."
            )
        network = load_rig_network(source, config.device)
        for label, decode in ((name, decode_cloud), (f"{name} and solve", solve_from_network)):
            methods.append(Method(label, partial(by_network, network=network, decode=decode), source))
    return methods


def slerp(case: Case) -> Motion:
    """Slerp between the keys, its only input."""
    keys = np.flatnonzero(case.known)
    pose = pose_of_motion(case.skeleton, case.motion.at(keys))
    gaps = np.flatnonzero(~case.known)
    between = pose.at(torch.as_tensor(keys).double(), torch.as_tensor(gaps).double())
    return replace_rows(case.skeleton, case.motion, between, gaps)


def solve(case: Case, device: torch.device | str = "cpu") -> Motion:
    """Its input is positions, body groups and the keys' poses only."""
    points, groups = case.points.to(device), case.groups.to(device)
    return follow_cloud(case.skeleton, case.motion, case.known, points, groups, case.options).motion


def by_network(case: Case, network: RigNetwork, decode: Callable[..., Motion] = decode_cloud) -> Motion | None:
    """Its input is the cloud without keys; only if the network's rig is that of the case.

    Args: decode: `decode_cloud`, or `solve_from_network`, whose solve starts from the network's pose.
    """
    rig = network.rig.skeleton
    same = rig.names == case.skeleton.names and np.allclose(rig.tails, case.skeleton.tails, atol=1e-3)
    if not same or np.bincount(case.groups.numpy(), minlength=5).min() == 0:
        return None
    return decode(network, case.points, case.groups, case.motion.fps)
