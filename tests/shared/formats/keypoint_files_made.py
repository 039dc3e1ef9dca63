"""Files of 2D keypoints in every form that is read, of one moving person."""

from __future__ import annotations

import json

import numpy as np

from stages.shared.formats.keypoint_layouts import LAYOUTS, names_of_layout

FRAMES, SIZE = 5, (640.0, 480.0)


def person(layout: str, at: float = 0.0, frames: int = FRAMES) -> np.ndarray:
    """(T, K, 3) keypoints: a column of points that moves to the right; `at` pixels aside."""
    count = len(names_of_layout(layout))
    rows = np.zeros((frames, count, 3))
    rows[..., 0] = 100 + at + 3 * np.arange(frames)[:, None] + np.arange(count) % 5
    rows[..., 1] = 50 + 10 * np.arange(count)
    rows[..., 2] = 0.9
    return rows


def openpose_frames(people: list[np.ndarray]) -> dict[str, bytes]:
    """File name -> bytes, as OpenPose writes BODY_25."""
    return {
        f"video_{frame:012d}_keypoints.json": json.dumps(
            {
                "version": 1.3,
                "people": [{"person_id": [-1], "pose_keypoints_2d": rows[frame].ravel().tolist()} for rows in people],
            }
        ).encode()
        for frame in range(len(people[0]))
    }


def coco_results(people: list[np.ndarray], *, named: bool = False) -> bytes:
    """COCO's results; with `named` as AlphaPose writes them, with images' names and people's numbers."""
    rows = [
        {
            "image_id": f"{frame}.jpg" if named else frame,
            "category_id": 1,
            "keypoints": rows[frame].ravel().tolist(),
            "score": 2.5,
            **({"idx": number + 1} if named else {}),
        }
        for frame in range(len(people[0]))
        for number, rows in enumerate(people)
    ]
    return json.dumps(rows).encode()


def coco_annotations(rows: np.ndarray) -> bytes:
    shown = rows.copy()
    shown[..., 2] = 2
    images = [
        {"id": 90 + frame, "file_name": f"{frame:06d}.jpg", "width": SIZE[0], "height": SIZE[1]}
        for frame in range(len(rows))
    ]
    annotations = [{"image_id": 90 + frame, "keypoints": shown[frame].ravel().tolist()} for frame in range(len(rows))]
    return json.dumps({"images": images, "annotations": annotations}).encode()


def mmpose_video(rows: np.ndarray, layout: str) -> bytes:
    frames = [
        {
            "frame_id": frame + 1,
            "instances": [
                {"keypoints": each[:, :2].tolist(), "keypoint_scores": each[:, 2].tolist(), "bbox": [[0, 0, 9, 9]]}
            ],
        }
        for frame, each in enumerate(rows)
    ]
    names = {str(at): name for at, name in enumerate(names_of_layout(layout))}
    return json.dumps({"meta_info": {"keypoint_id2name": names}, "instance_info": frames}).encode()


def easy_vitpose(rows: np.ndarray, layout: str) -> bytes:
    names = {str(at): name for at, name in enumerate(names_of_layout(layout))}
    frames = [{"0": each[:, [1, 0, 2]].tolist()} for each in rows]
    return json.dumps({"keypoints": frames, "skeleton": names}).encode()


def mediapipe(rows: np.ndarray) -> bytes:
    frames = [
        {"pose_landmarks": [{"x": x / SIZE[0], "y": y / SIZE[1], "z": 0.0, "visibility": c} for x, y, c in each]}
        for each in rows
    ]
    return json.dumps(frames).encode()


def deeplabcut(people: dict[str, np.ndarray], names: tuple[str, ...]) -> bytes:
    """DeepLabCut's CSV; of several individuals if there are more than one."""
    owners = [owner for owner in people for _ in names for _ in range(3)]
    parts = [name for _ in people for name in names for _ in range(3)]
    coords = [coordinate for _ in people for _ in names for coordinate in ("x", "y", "likelihood")]
    head = [["scorer", *["DLC"] * len(parts)], ["bodyparts", *parts], ["coords", *coords]]
    if len(people) > 1:
        head.insert(1, ["individuals", *owners])
    count = len(next(iter(people.values())))
    rows = [
        [str(frame), *(f"{v:.4f}" for own in people.values() for v in own[frame].ravel())] for frame in range(count)
    ]
    return "\n".join(",".join(line) for line in [*head, *rows]).encode()


def every_file() -> dict[str, tuple[bytes, str]]:
    """A file of each form of one file, with its layout."""
    coco, body, media = person("coco17"), person("body25"), person("mediapipe33")
    return {
        "openpose": (next(iter(openpose_frames([body]).values())), "body25"),
        "coco": (coco_results([coco]), "coco17"),
        "alphapose": (coco_results([person("halpe26")], named=True), "halpe26"),
        "annotations": (coco_annotations(coco), "coco17"),
        "mmpose": (mmpose_video(person("h36m17"), "h36m17"), "h36m17"),
        "vitpose": (easy_vitpose(coco, "coco17"), "coco17"),
        "mediapipe": (mediapipe(media), "mediapipe33"),
        "deeplabcut": (deeplabcut({"": coco}, LAYOUTS["coco17"]), "coco17"),
    }
