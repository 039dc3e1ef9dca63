"""How fast a motion seems to be played: twice too fast where its file names half of its true frame time.

Bodies of one size under one gravity move at like speeds, and a clip that is played at another speed is out of line in
several ways at once: speeds, the ratio of acceleration to speed, how hard the pelvis is thrown down. Six such
features, all logarithms and without unit, go into a quadratic regression of log2 of the playback speed, fitted on
recordings played at half, their own and twice their speed (docs/log.md, 2026-11-28); docs/formats.md says how often
it is right. It is a hint and no proof: slow styles exist, and so do fast ones.

The rate of a body that stays in place cannot be judged: a bow may take one second or three. Gravity sets the pace
only of a body that travels, so only clips with travel are flagged.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from data_schemas.errors import InputError
from data_schemas.skeleton import BODY_GROUPS, Skeleton
from stages.shared.kinematics.foot_contacts import Feet, find_feet
from stages.shared.kinematics.quantiles import median, percentile

GRAVITY = 9.81
LOW_PASS_HZ = 12.0
LEAST_S = 1.0
LONGEST_S = 40.0  # more of a clip adds nothing
SUSPECT = 0.6  # |log2 of the speed| from which a frame rate is suspected
TRAVEL_FLOOR = 0.05  # leg lengths a second, added to the travel under its logarithm
LEAST_TRAVEL = 0.2  # leg lengths that the pelvis travels in a second, below which the rate is not judged

# The regression's weights: of the features, of their squares, and the constant. Fitting: docs/log.md, 2026-11-28.
WEIGHTS = np.array(
    [
        *(-0.54851, 0.62742, 1.6391, 0.15832, 0.18281, -0.20778),
        *(-0.075871, 0.2355, -0.21812, 0.029499, 0.0974, -0.12483),
        -3.2931,
    ]
)


def speed_of(features: np.ndarray) -> float:
    """log2 of the speed at which a clip seems to be played, from its features (6,): 0 is right, 1 twice too fast."""
    return float(design(features[None])[0] @ WEIGHTS)


def rate_is_suspect(features: np.ndarray) -> bool:
    """Whether a clip with the features (6,) travels, and seems to be played at another speed than its own."""
    return bool(features[-1] > np.log(LEAST_TRAVEL + TRAVEL_FLOOR) and abs(speed_of(features)) > SUSPECT)


def speed_features(
    skeleton: Skeleton, positions: np.ndarray, fps: float, feet: Feet | None = None
) -> np.ndarray | None:
    """(6,) the inputs of the regression.

    Args:
        positions: (T, J, 3) joints in the world, metres, Y up.
        feet: the skeleton's, if they are found already.

    Returns: None for a clip shorter than a second, one that stands still, or a body without legs.
    """
    positions = positions[: int(LONGEST_S * fps)].astype(np.float64)
    try:
        leg = (feet or find_feet(skeleton)).leg_m
    except InputError:
        return None
    ends = [np.flatnonzero((skeleton.groups == group) & skeleton.sampled)[-1:] for group in range(len(BODY_GROUPS))]
    if len(positions) < LEAST_S * fps or leg <= 0 or not all(len(end) for end in ends):
        return None
    pelvis = positions[:, skeleton.root] / leg
    reaching = positions[:, np.concatenate(ends)] / leg - pelvis[:, None]
    if fps > 3 * LOW_PASS_HZ:
        # Imported here: it takes as long as all other imports of the readers, and recordings at 30 Hz do without it.
        from scipy.signal import sosfiltfilt

        pelvis, reaching = (sosfiltfilt(_low_pass(fps), each, axis=0) for each in (pelvis, reaching))
    velocities, accelerations = np.diff(reaching, axis=0) * fps, np.diff(reaching, 2, axis=0) * fps**2
    speeds, pushes = (np.sqrt(np.square(each).sum(-1).mean(0)) for each in (velocities, accelerations))
    if speeds.mean() < 1e-3:
        return None
    thrown = np.diff(pelvis[:, 1], 2) * fps**2 * leg / GRAVITY
    travel = np.linalg.norm(np.diff(pelvis, axis=0), axis=-1).mean() * fps
    return np.array(
        [
            np.log(speeds.mean()),
            np.log(percentile(np.linalg.norm(velocities, axis=-1).reshape(-1), 95) + 1e-6),
            np.log(median(pushes / (speeds + 1e-9)) + 1e-6),
            np.log(max(percentile(-thrown, 99), 0.0) + 0.02),
            np.log(np.std(thrown) + 0.02),
            np.log(travel + TRAVEL_FLOOR),
        ]
    )


@lru_cache(maxsize=64)
def _low_pass(fps: float) -> np.ndarray:
    """The sections of a Butterworth filter; finding them takes as long as filtering a short clip."""
    from scipy.signal import butter

    return np.asarray(butter(4, LOW_PASS_HZ / (fps / 2), output="sos"))


def design(features: np.ndarray) -> np.ndarray:
    """(N, 13) rows of the regression from (N, 6) features."""
    return np.concatenate([features, features**2, np.ones((len(features), 1))], axis=1)
