"""The errors of 2D pose detectors, for training and measuring: noise by keypoint, points that are missing, swapped
sides, outliers, and confidences that reflect some of these errors.

The noise's proportions between keypoints are those of COCO's annotators (cocoeval's sigmas, in units of the root of
the person's area); its size and all other numbers are ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stages.shared.humanoid.landmarks import LANDMARKS

_SIGMAS = {
    "nose": 0.026, "eye": 0.025, "ear": 0.035, "head": 0.035, "head_top": 0.05, "neck": 0.06, "shoulder": 0.079,
    "elbow": 0.072, "wrist": 0.062, "spine": 0.09, "pelvis": 0.09, "hip": 0.107, "knee": 0.087, "ankle": 0.089,
    "heel": 0.08, "toe": 0.08,
}  # fmt: skip
SIGMAS = np.array([_SIGMAS[name.removeprefix("left_").removeprefix("right_")] for name in LANDMARKS])
_MIRROR = np.array(
    [
        LANDMARKS.index(name.replace("left", "right") if name.startswith("left") else name.replace("right", "left"))
        for name in LANDMARKS
    ]
)


@dataclass(frozen=True)
class DetectorErrors:
    """How a detector fails.

    noise:   standard deviation, as a share of COCO's sigmas; drawn up to this for each window.
    smooth:  0 to 1, how alike the noise of neighbouring frames is.
    missing: share of points that are missing, in runs. hidden: chance that a limb is missing for a while.
    swapped: chance that left and right are exchanged for a while. outliers: share of points far off.
    """

    noise: float = 0.6
    smooth: float = 0.7
    missing: float = 0.05
    hidden: float = 0.15
    swapped: float = 0.05
    outliers: float = 0.01


NONE = DetectorErrors(0, 0, 0, 0, 0, 0)
DETECTOR = DetectorErrors()
PRESETS = {"none": NONE, "detector": DETECTOR}
_LIMBS = tuple(
    np.array([LANDMARKS.index(f"{side}_{name}") for name in names])
    for side in ("left", "right")
    for names in (("elbow", "wrist"), ("knee", "ankle", "heel", "toe"))
)
_LONGEST_RUN = 30


def with_errors(
    places: np.ndarray, rng: np.random.Generator, errors: DetectorErrors = DETECTOR
) -> tuple[np.ndarray, np.ndarray]:
    """Landmarks as a detector would give them.

    Args: places: (T, L, 2) true ones, any unit.

    Returns: places (T, L, 2), NaN where missing, and confidences (T, L) 0 to 1, 0 where missing.
    """
    frames, count = places.shape[:2]
    size = float(np.sqrt(np.prod(np.maximum(np.ptp(places, axis=1), 1e-9), axis=-1)).mean())
    level = errors.noise * rng.uniform(0.2, 1.0)
    drawn = _smoothed(rng.standard_normal((frames, count, 2)), errors.smooth)
    # A point is seen badly for a while: its noise is larger, and its confidence lower.
    bad = np.exp(0.5 * _smoothed(rng.standard_normal((frames, count, 1)), 0.9))
    out = places + level * size * SIGMAS[:, None] * bad * drawn
    trust = np.clip(
        0.95 - 0.25 * level * (bad[..., 0] - 0.4) + 0.03 * rng.standard_normal((frames, count)), 0.05, 1.0
    )
    far = rng.random((frames, count)) < errors.outliers
    out[far] += 0.3 * size * rng.standard_normal((int(far.sum()), 2))
    trust[far] *= rng.uniform(0.3, 1.0, int(far.sum()))
    if rng.random() < errors.swapped:
        rows = _run(frames, rng)
        out[rows], trust[rows] = out[rows][:, _MIRROR], trust[rows][:, _MIRROR]
    gone = np.zeros((frames, count), bool)
    for at in np.flatnonzero(rng.random(count) < errors.missing * frames / (_LONGEST_RUN / 2)):
        gone[_run(frames, rng), at] = True
    for limb in _LIMBS:
        if rng.random() < errors.hidden:
            gone[_run(frames, rng), limb[:, None]] = True
    out[gone], trust[gone] = np.nan, 0.0
    return out, trust


def _run(frames: int, rng: np.random.Generator) -> slice:
    length = int(rng.integers(1, _LONGEST_RUN + 1))
    start = int(rng.integers(0, max(1, frames - length + 1)))
    return slice(start, start + length)


def _smoothed(values: np.ndarray, alike: float) -> np.ndarray:
    """Noise of standard deviation 1 in which neighbouring frames have the correlation `alike`, from white noise."""
    from scipy.signal import lfilter

    if alike <= 0:
        return values
    return np.asarray(lfilter([np.sqrt(1 - alike**2)], [1, -alike], values, axis=0, zi=alike * values[:1])[0])
