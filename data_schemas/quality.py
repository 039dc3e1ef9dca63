"""Measures of a clip's quality, taken by ingest: columns of the clip index, by which clips can be filtered."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MotionQuality:
    """Measures of one clip (`stages.shared.humanoid.motion_quality`); None, 0 or False if not measured.

    still_share:       share of the frames in stretches of half a second or more in which no joint moves.
    t_pose:            arms straight out sideways and still for half a second or more.
    repeated_share:    share of the frames that equal the frame before to the last digit.
    spikes:            frames in which a joint turns faster than a human joint can.
    flips:             frames in which a joint jumps by more than 115 degrees.
    foot_skate:        metres per second, of feet in contact (`stages.shared.kinematics.foot_contacts`).
    floor_penetration: metres, how far the feet are below the level on which they mostly stand.
    speed_log2:        log2 of the estimated playback speed (`stages.shared.kinematics.playback_speed`).
    wrong_rate:        the frame rate may be wrong, since that speed is implausible.
    swapped:           left and right seem to be swapped, since knees and toes point backwards.
    repaired_frames:   frames with values that were not numbers, filled in from their neighbours.
    """

    still_share: float | None = None
    t_pose: bool = False
    repeated_share: float | None = None
    spikes: int = 0
    flips: int = 0
    foot_skate: float | None = None
    floor_penetration: float | None = None
    speed_log2: float | None = None
    wrong_rate: bool = False
    swapped: bool = False
    repaired_frames: int = 0
