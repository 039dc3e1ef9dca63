"""Plain interpolation of a pose between keys at real-valued times: slerp, and its C1 cubic relative.

A segment between two keys is a cubic Bezier curve in time, for positions and (in cumulative form, Kim et al. 1995)
for rotations. Its tangents decide what it is: the segment's own slope gives lerp and slerp exactly; a tangent that
both neighbouring segments share gives a curve without a kink at the key.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from data_schemas.errors import UsageError
from stages.shared.kinematics.device import onto
from stages.shared.kinematics.rotations import (
    conjugate,
    continuous_signs,
    from_turn_vectors,
    multiply,
    shorter_way,
    turn_vectors,
    turns_between,
)


class Damping(NamedTuple):
    """Seconds of the gap that keeps half of the cubic, of rotations and of places (docs/log.md, 2026-11-28)."""

    turns_s: float = 1.3
    places_s: float = 2.0


DAMPING = Damping()
# A segment's middle control turn stays so far below a half turn, at which it would go round the other way.
MOST_MIDDLE_RAD = math.radians(165)


class Smoothing(NamedTuple):
    """How far segments leave slerp and lerp for the C1 cubic, of rotations and of places: 0 to 1, or (K-1,) with one
    for each segment."""

    turns: float | Tensor
    places: float | Tensor


Smoothness = float | Tensor | Smoothing


class Glide(NamedTuple):
    """How a pose goes on beyond its first and last key: with the speed it has there, which decays exponentially.

    root: time constant of joint 0's and moving joints' places, in the key times' unit. turn: of rotations. At 0 they
    stand still, and where both are 0 the pose is held to the bit.
    """

    root: float
    turn: float

    def in_frames(self, rate_hz: float) -> Glide:
        """From seconds to frames."""
        return Glide(self.root * rate_hz, self.turn * rate_hz)


class Segments(NamedTuple):
    """Where times fall between keys: `first` (T,) index of the key before, `share` (T,) in [0, 1] of the way on."""

    first: Tensor
    share: Tensor


def damped_smoothness(key_times: Tensor, rate_hz: float, damping: Damping = DAMPING) -> Smoothing:
    """How far each gap may leave slerp for the C1 cubic: rotations nearly all the way where keys are close, little
    where they are seconds apart and a velocity at the key says nothing of the middle; places, which have inertia,
    longer.

    On validation clips the cubic's L2P is 0.66 of slerp's at gaps of 5 frames (30 a second) and about slerp's at gaps
    of 30 between single keys; in transitions, whose keys' velocities are exact, 0.57 at 15, 0.87 at 30 and 1.1 at 60,
    where the damped one is 0.58, 0.81 and 0.86. Places would like 5 s on the average, but on Bandai Namco 1, whose
    people stop, that is a sixth worse than slerp in transitions of 60, and 2 s a twentieth (docs/log.md, 2026-11-28).

    Args:
        key_times: (K,) rising. rate_hz: how many of their units are a second.
    """
    seconds = key_times.double().diff() / rate_hz
    return Smoothing(*(_damped(seconds, half) for half in damping))


def _damped(seconds: Tensor, half: float) -> Tensor:
    return (1 / (1 + (seconds / half) ** 3)).float()


def locate_segments(key_times: Tensor, times: Tensor) -> Segments:
    """Segments of K >= 2 rising key times (K,) in which times (T,) fall; outside the keys the share is 0 or 1.

    Computed in float64, since a frame number of a long clip times a rate does not fit float32's mantissa.
    """
    keys = key_times.double().contiguous()
    wanted = times.double().contiguous()
    first = (torch.searchsorted(keys, wanted, right=True) - 1).clamp(0, len(keys) - 2)
    share = (wanted - keys[first]) / (keys[first + 1] - keys[first])
    return Segments(first, share.clamp(0.0, 1.0).float())


def interpolate_pose(
    local: Tensor,
    roots: Tensor,
    offsets: Tensor,
    key_times: Tensor,
    times: Tensor,
    *,
    smooth: Smoothness = 0.0,
    glide: Glide | None = None,
    whole_turns: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Poses at any times from poses at keys.

    Args:
        local: (K, J, 4) unit quaternions xyzw in the parents' frames, float32; signs need not agree between keys.
        roots: (K, 3) positions of joint 0, metres.
        offsets: (K, J, 3) joints' heads in their parents' frames, metres, or (J, 3) where they never vary.
        key_times: (K,) strictly rising, any unit.
        times: (T,) in the same unit. Both may lie on the CPU whatever the poses' device.
        smooth: 0 is slerp and lerp, 1 the C1 cubic through the keys, between them the tangents are blended; a number,
            (K-1,) with one for each segment, or such of rotations and of places, as `damped_smoothness` gives.
        glide: how to go on before the first and after the last key; None holds them.
        whole_turns: (J,) bool, or (K-1, J) with one for each segment: joints that may turn right round between two
            keys where the velocities at the keys ask for it, which are the pelvis and the joints above it
            (`joint_tree.pelvis_and_above`). None: no joint may.

    Returns: local (T, J, 4) sign-continuous in rising time, roots (T, 3), offsets (T, J, 3) (or (J, 3) as given).
    Raises: UsageError where there is no key or the key times do not rise.
    """
    _check_key_times(key_times)
    varying = offsets.dim() == 3
    if len(key_times) == 1:
        held = times.new_zeros(len(times), dtype=torch.long)
        return local[held], roots[held], offsets[held] if varying else offsets
    segments = Segments(*(onto(part, local.device) for part in locate_segments(key_times, times)))
    lengths = onto(key_times.double().diff().float(), local.device)
    turns, places = smooth if isinstance(smooth, Smoothing) else (smooth, smooth)
    local_out = _rotation_curve(continuous_signs(local), lengths, segments, turns, whole_turns)
    roots_out = _position_curve(roots, lengths, segments, places)
    offsets_out = _position_curve(offsets, lengths, segments, places) if varying else offsets
    if glide is not None and any(glide):
        away = torch.maximum(times.double() - key_times[-1].double(), key_times[0].double() - times.double()).float()
        out = away > 0
        after = times[out] > key_times[-1]
        edge = torch.where(after, len(key_times) - 1, 0)
        inner = torch.where(after, len(key_times) - 2, 1)
        steps = _glide_steps(lengths[torch.minimum(edge, inner)], away[out], glide)
        local_out[out] = _turned_on(local[edge], local[inner], steps.turn)
        roots_out[out] = _moved_on(roots[edge], roots[inner], steps.root)
        if varying:
            offsets_out[out] = _moved_on(offsets[edge], offsets[inner], steps.root)
    return local_out, roots_out, offsets_out


def glide_on(
    local: tuple[Tensor, Tensor], offsets: tuple[Tensor, Tensor], gap: Tensor, away: Tensor, glide: Glide
) -> tuple[Tensor, Tensor]:
    """Poses beyond an edge key.

    Args:
        local: (..., J, 4) rotations at the edge key and at the key next to it.
        offsets: (..., J, 3) places at the two.
        gap: (...) time between the two keys; at 0 the edge key is held.
        away: (...) time from the edge key on, outwards.
        glide: in the same unit.
    """
    steps = _glide_steps(gap, away, glide)
    return _turned_on(*local, steps.turn), _moved_on(*offsets, steps.root)


class _Steps(NamedTuple):
    """How many times the last step between keys is made again, by places and by rotations."""

    root: Tensor
    turn: Tensor


def _glide_steps(gap: Tensor, away: Tensor, glide: Glide) -> _Steps:
    steps = [
        torch.where(gap > 0, constant * -torch.expm1(-away / max(constant, 1e-9)) / gap.clamp_min(1e-9), 0.0)
        for constant in glide
    ]
    return _Steps(*steps)


def _moved_on(edge: Tensor, inner: Tensor, steps: Tensor) -> Tensor:
    return edge + steps.view(*steps.shape, *[1] * (edge.dim() - steps.dim())) * (edge - inner)


def _turned_on(edge: Tensor, inner: Tensor, steps: Tensor) -> Tensor:
    return multiply(edge, from_turn_vectors(steps[..., None, None] * turns_between(inner, edge)))


def interpolate_values(values: Tensor, key_times: Tensor, times: Tensor, *, smooth: float | Tensor = 0.0) -> Tensor:
    """Values (K, ...) at keys to values (T, ...) at times: lines, or with `smooth` 1 without kinks; held outside.

    Raises: UsageError where there is no key or the key times do not rise.
    """
    _check_key_times(key_times)
    if len(key_times) == 1:
        return values.expand(len(times), *values.shape[1:])
    lengths = key_times.double().diff().float()
    return _position_curve(values, lengths, locate_segments(key_times, times), smooth)


def _check_key_times(key_times: Tensor) -> None:
    if len(key_times) == 0 or bool((key_times.diff() <= 0).any()):
        raise UsageError("The key times must be one or more strictly rising numbers.")


def _tangents(slopes: Tensor, lengths: Tensor, smooth: float | Tensor) -> tuple[Tensor, Tensor]:
    """Slopes at the start and the end of every segment, (K-1, ...), from the segments' mean slopes (K-1, ...).

    A shared tangent is the slope at the key of the parabola through the key and its neighbours; the first and the
    last key have a neighbour on one side alone and keep that segment's slope.
    """
    h = lengths.view(-1, *[1] * (slopes.dim() - 1))
    inner = (h[1:] * slopes[:-1] + h[:-1] * slopes[1:]) / (h[1:] + h[:-1])
    shared = torch.cat([slopes[:1], inner, slopes[-1:]])
    if isinstance(smooth, Tensor):
        smooth = smooth.to(slopes).view(-1, *[1] * (slopes.dim() - 1))
    return slopes + smooth * (shared[:-1] - slopes), slopes + smooth * (shared[1:] - slopes)


def _position_curve(values: Tensor, lengths: Tensor, segments: Segments, smooth: float | Tensor) -> Tensor:
    first, share = segments.first, segments.share.view(-1, *[1] * (values.dim() - 1))
    straight = torch.lerp(values[first], values[first + 1], share)
    if not isinstance(smooth, Tensor) and smooth == 0.0:
        return straight
    h = lengths.view(-1, *[1] * (values.dim() - 1))
    slopes = values.diff(dim=0) / h
    start, end = _tangents(slopes, lengths, smooth)
    # Hermite form, written as the straight line plus what the tangents add to it; zero at both keys.
    bend_in = share * (1 - share) ** 2
    bend_out = share**2 * (1 - share)
    return straight + h[first] * (bend_in * (start - slopes)[first] - bend_out * (end - slopes)[first])


def _rotation_curve(
    keys: Tensor, lengths: Tensor, segments: Segments, smooth: float | Tensor, whole_turns: Tensor | None
) -> Tensor:
    first, share = segments.first, segments.share.view(-1, *[1] * (keys.dim() - 2), 1)
    turns = multiply(conjugate(keys[:-1]), keys[1:])
    # The shorter way round; the sign continuity of the keys has chosen it already except for float rounding.
    turns = shorter_way(turns)
    steps = turn_vectors(turns)
    if not isinstance(smooth, Tensor) and smooth == 0.0:
        curve = multiply(keys[first], from_turn_vectors(share * steps[first]))
    else:
        h = lengths.view(-1, *[1] * (keys.dim() - 1))
        start, end = _tangents(steps / h, lengths, smooth)
        outward, inward = _towards_slerp(start * h / 3, end * h / 3, steps, whole_turns)
        middle = turn_vectors(multiply(multiply(from_turn_vectors(-outward), turns), from_turn_vectors(-inward)))
        curve = keys[first]
        rests = (1 - (1 - share) ** 3, share**2 * (3 - 2 * share), share**3)  # cumulative Bernstein polynomials
        for rest, part in zip(rests, (outward, middle, inward), strict=True):
            curve = multiply(curve, from_turn_vectors(rest * part[first]))
    at_key = torch.where(share == 0, keys[first], curve)  # keys come back exactly, free of rounding
    return torch.where(share == 1, keys[first + 1], at_key)


def _towards_slerp(
    outward: Tensor, inward: Tensor, steps: Tensor, whole_turns: Tensor | None
) -> tuple[Tensor, Tensor]:
    """Control turns of each segment for which the middle one is at most `MOST_MIDDLE_RAD`.

    Slerp's three control turns are each a third of the step. Where the outer two differ from it by a and b, the
    middle one is at most |step| / 3 + |a| + |b|. If that exceeds the limit, a and b are multiplied by one
    factor. For a rotation about one axis, this multiplies the curve's distance from slerp by the same factor.

    Args:
        outward, inward: (K-1, J, 3) rotation vectors after the first and before the second key, radians.
        steps: (K-1, J, 3) from key to key, at most a half turn each.
        whole_turns: as `interpolate_pose` takes it; of these joints nothing is changed.
    """
    third = steps / 3
    away = (outward - third).norm(dim=-1, keepdim=True) + (inward - third).norm(dim=-1, keepdim=True)
    room = MOST_MIDDLE_RAD - third.norm(dim=-1, keepdim=True)
    too_much = away > room
    if whole_turns is not None:
        too_much = too_much & ~onto(whole_turns, steps.device).unsqueeze(-1)
    share = room / away.clamp_min(1e-9)
    return (
        torch.where(too_much, third + share * (outward - third), outward),
        torch.where(too_much, third + share * (inward - third), inward),
    )
