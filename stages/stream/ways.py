"""Two ways of streaming a clip: the latents of a body's parts, and quantised rotations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stages.shared.inference.part_models import PartBody
from stages.stream.channel import ROTATION_BYTES, held, quantised, quantised_rotations

Channel = Callable[[int], np.ndarray]
"""Takes the number of packets; returns (count,) bool, True for those that arrive."""


@dataclass(frozen=True)
class LatentRange:
    """Of each part the least and greatest number (D,) of each place of its latent, which both ends know."""

    low: tuple[np.ndarray, ...]
    high: tuple[np.ndarray, ...]


def range_of(body: PartBody, columns: Tensor) -> LatentRange:
    """The range over windows (N, T, B, 6) of training clips."""
    latents = [each.cpu().numpy() for each in body.encode(columns.to(body.device))]
    return LatentRange(tuple(z.min(0) for z in latents), tuple(z.max(0) for z in latents))


def streamed_parts(
    body: PartBody, columns: Tensor, known: LatentRange, bits: int, channel: Channel
) -> tuple[Tensor, int]:
    """A clip's windows (N, T, B, 6) after the channel, and the number of packets.

    One packet a part and window, part after part. Where a part's packet is lost, its joints keep the last pose that
    was decoded; before the first packet, the mean pose of the training.
    """
    latents = [each.cpu().numpy() for each in body.encode(columns.to(body.device))]
    sent = [quantised(z, low, high, bits) for z, low, high in zip(latents, known.low, known.high, strict=True)]
    whole = body.decode([torch.from_numpy(z).float().to(body.device) for z in sent]).cpu()
    there = channel(len(columns) * len(body.parts)).reshape(len(columns), len(body.parts))
    out = whole.clone()
    for index, (model, places) in enumerate(zip(body.parts, body.kept, strict=True)):
        joints = model.part.joints[places].tolist()
        mean = model.network.mean.cpu().numpy()[places]
        ends = held(whole[:, -1, joints].numpy(), there[:, index], mean)
        before = np.concatenate([mean[None], ends[:-1]])
        lost = ~there[:, index]
        for window in np.flatnonzero(lost):
            out[int(window), :, joints] = torch.from_numpy(before[window])
    return out, there.size


def streamed_rotations(local: np.ndarray, every: int, channel: Channel) -> tuple[np.ndarray, int]:
    """A clip's rotations (T, B, 4) after the channel, and the number of packets: one packet a pose, every so many
    frames; the last pose that arrived is held; until one arrives, the clip's first pose is."""
    poses = quantised_rotations(local[::every])
    there = channel(len(poses))
    return np.repeat(held(poses, there, poses[0]), every, axis=0)[: len(local)], len(poses)


def bytes_of_parts(widths: Sequence[int], bits: int, header: int, seconds: float) -> float:
    """Bytes a second of one packet a part and window of `seconds`."""
    return sum(header + np.ceil(width * bits / 8) for width in widths) / seconds


def bytes_of_rotations(joints: int, every: int, rate_hz: float, header: int) -> float:
    """Bytes a second of one packet a pose."""
    return (header + np.ceil(joints * ROTATION_BYTES)) * rate_hz / every
