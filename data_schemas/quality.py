"""What ingest found of a clip's quality: columns of the clip index, made to be filtered by."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MotionQuality:
    """Figures of one clip (`stages.shared.humanoid.motion_quality`); None, 0 and False where nothing was measured.

    still_share:       of the frames, those in stretches of half a second and more in which no joint moves.
    t_pose:            arms straight out sideways and still for half a second or more.
    repeated_share:    of the frames, those that are the frame before over again, to the last digit.
    spikes:            frames in which a joint turns faster than any human's.
    flips:             frames in which a joint jumps by more than 115 degrees.
    foot_skate:        metres a second, of feet that stand (`stages.shared.kinematics.foot_contacts`).
    floor_penetration: metres, how far the feet sink below the level on which they mostly stand.
    speed_log2:        log2 of the speed at which it seems to be played (`stages.shared.kinematics.playback_speed`).
    wrong_rate:        that speed is suspicious: its frame rate may be wrong.
    swapped:           left and right seem to be exchanged: knees and toes point the other way.
    repaired_frames:   frames with numbers that were none, filled in from their neighbours.
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
