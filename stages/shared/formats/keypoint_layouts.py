"""The layouts of 2D keypoints that pose detectors write, and how the landmarks of a body are found among them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from data_schemas.errors import InputError
from stages.shared.formats.joint_lists import measured_joints
from stages.shared.formats.joint_matching import matched, plain_name
from stages.shared.humanoid.landmarks import LANDMARKS


def _points(names: str) -> tuple[str, ...]:
    return tuple(names.split())


_BODY25 = _points(
    "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist hip right_hip right_knee"
    " right_ankle left_hip left_knee left_ankle right_eye left_eye right_ear left_ear left_toe left_small_toe"
    " left_heel right_toe right_small_toe right_heel"
)
# Human3.6M's 17 are joints of a skeleton: its thorax lies between the shoulders, its head is the top of the head.
_H36M17 = _points(
    "hip right_hip right_knee right_ankle left_hip left_knee left_ankle spine neck face head_top left_shoulder"
    " left_elbow left_wrist right_shoulder right_elbow right_wrist"
)
# Halpe's head is the top of the head.
_HALPE26 = [{"head": "head_top"}.get(name, name.replace("big_toe", "toe")) for name in measured_joints("halpe26")]

# Layout -> the names of its points, in the order of the data.
LAYOUTS: dict[str, tuple[str, ...]] = {
    "coco17": tuple(measured_joints("coco17")),
    "body25": _BODY25,
    "mediapipe33": tuple(measured_joints("mediapipe33")),
    "h36m17": _H36M17,
    "halpe26": tuple(_HALPE26),
}
NAMED = "named"  # points that state their names, as DeepLabCut's
COUNTED = ", ".join(f"{layout} ({len(names)})" for layout, names in LAYOUTS.items())

# Landmark -> the points that it is the middle of, the first of these that a layout has. A point of a landmark's own
# name comes before them.
_MIDDLES: dict[str, tuple[tuple[str, ...], ...]] = {
    "pelvis": (("hip",), ("left_hip", "right_hip")),
    "neck": (("left_shoulder", "right_shoulder"),),
    "head": (("left_ear", "right_ear"), ("left_eye", "right_eye")),
}
# Other names of points, in lower case without separators. DeepLabCut's human model counts right to left.
_ALIASES = {
    "midhip": "hip", "pelvis": "hip", "root": "hip", "midshoulder": "neck", "thorax": "neck", "chest": "neck",
    "headtop": "head_top", "forehead": "head_top", "leftfootindex": "left_toe", "rightfootindex": "right_toe",
    "leftbigtoe": "left_toe", "rightbigtoe": "right_toe", "lefthand": "left_wrist", "righthand": "right_wrist",
    "leftfoot": "left_ankle", "rightfoot": "right_ankle", "ankle1": "right_ankle", "knee1": "right_knee",
    "hip1": "right_hip", "hip2": "left_hip", "knee2": "left_knee", "ankle2": "left_ankle", "wrist1": "right_wrist",
    "elbow1": "right_elbow", "shoulder1": "right_shoulder", "shoulder2": "left_shoulder", "elbow2": "left_elbow",
    "wrist2": "left_wrist",
}  # fmt: skip
_KNOWN = tuple(dict.fromkeys((*LANDMARKS, *(name for names in LAYOUTS.values() for name in names))))
_LIMBS = tuple(name for name in LANDMARKS if name.endswith(("shoulder", "elbow", "wrist", "hip", "knee", "ankle")))


def names_of_layout(layout: str) -> tuple[str, ...]:
    """The points of a layout. Raises InputError naming the layouts, if it is none."""
    if layout not in LAYOUTS:
        raise InputError(
            f"There is no keypoint layout {layout[:60]!r}.",
            f"Give {', '.join(LAYOUTS)}, or points with names, such as DeepLabCut's.",
        )
    return LAYOUTS[layout]


def layout_of_count(count: int, name: str) -> str:
    """The layout with this many points; coco17 of the two with 17. Raises InputError naming the layouts."""
    found = next((layout for layout, names in LAYOUTS.items() if len(names) == count), None)
    if found is None:
        raise InputError(
            f"{name} has {count} keypoints a person, which is no known layout.",
            f"Known are {COUNTED}, and points with names, such as DeepLabCut's.",
        )
    return found


def standard_names(given: Sequence[str], name: str) -> tuple[str, ...]:
    """The names of points as this module spells them; a point that is no landmark keeps its own.

    Raises: InputError if they are not the points of a body.
    """
    found = matched([plain_name(each) if plain_name(each) in _ALIASES else each for each in given], _KNOWN, _ALIASES)
    names = tuple(_KNOWN[at] if at >= 0 else own for at, own in zip(found, given, strict=True))
    if len(set(names) & set(_LIMBS)) < len(_LIMBS) // 2:
        raise InputError(
            f"{name}: its points ({', '.join(each[:30] for each in given[:4])}, ...) are not those of a human body.",
            "Name them left_hip, left_knee, left_ankle, left_shoulder, left_elbow, left_wrist, and so on; or give a"
            f" layout: {', '.join(LAYOUTS)}.",
        )
    return names


def _ways(landmark: str) -> tuple[tuple[str, ...], ...]:
    """The points that give a landmark: itself, or the ends that it is the middle of."""
    return (landmark,), *_MIDDLES.get(landmark, ())


def landmark_tracks(
    names: Sequence[str], places: np.ndarray, confidences: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Tracks of `LANDMARKS` from those of a layout's points.

    Args:
        names: K. places: (T, K, 2), NaN where missing. confidences: (T, K), 0 where missing.

    Returns: places (T, L, 2), NaN where missing, and confidences (T, L): for a middle the least of its ends'.
    """
    index = {each: at for at, each in enumerate(names)}
    tracks = np.full((len(places), len(LANDMARKS), 2), np.nan)
    trust = np.zeros((len(places), len(LANDMARKS)))
    for at, landmark in enumerate(LANDMARKS):
        ends = next(
            ([index[end] for end in way] for way in _ways(landmark) if all(end in index for end in way)), None
        )
        if ends is not None:
            tracks[:, at] = places[:, ends].mean(axis=1)
            trust[:, at] = confidences[:, ends].min(axis=1)
    trust[~np.isfinite(tracks).all(axis=-1)] = 0.0
    return tracks, trust


def landmark_columns(layout: str) -> tuple[np.ndarray, np.ndarray]:
    """Which landmarks the points of a layout are.

    Returns: (N,) columns of the layout, and (N,) indices into `LANDMARKS`. Points that no landmark stands for (small
        toes, fingers) are left out.
    """
    own = {"hip": "pelvis", **{name: name for name in LANDMARKS}}
    pairs = [(at, LANDMARKS.index(own[name])) for at, name in enumerate(names_of_layout(layout)) if name in own]
    columns, landmarks = np.array(pairs).T
    return columns, landmarks


def landmark_mask(layout: str) -> np.ndarray:
    """(L,) bool, which of `LANDMARKS` can be found among the points of a layout."""
    names = set(names_of_layout(layout))
    return np.array([any(set(way) <= names for way in _ways(landmark)) for landmark in LANDMARKS])
