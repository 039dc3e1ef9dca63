"""2D keypoints are read the same from every form; one person is followed; bad files are refused in one sentence."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError
from stages.shared.formats.keypoint_files import detections_in, holds_keypoints, looks_like_keypoints, read_keypoints
from stages.shared.formats.keypoint_layouts import LAYOUTS, landmark_columns, landmark_mask, landmark_tracks
from stages.shared.formats.keypoints import MOST_PEOPLE, Detection, Detections, people_of, person_of
from stages.shared.formats.layout_names import KEYPOINT_LAYOUTS
from stages.shared.humanoid.landmarks import LANDMARKS
from tests.shared.formats.hostile import WORDS, mutated
from tests.shared.formats.keypoint_files_made import (
    FRAMES,
    SIZE,
    coco_results,
    deeplabcut,
    every_file,
    mediapipe,
    openpose_frames,
    person,
)

FILES = every_file()


def _of(data: bytes, **settings):
    return person_of(detections_in(data, "a.json"), "a.json", **settings)


@pytest.mark.parametrize("kind", FILES)
def test_every_form_gives_the_same_points(kind: str):
    data, layout = FILES[kind]
    size = SIZE if kind == "mediapipe" else None
    found = _of(data, size=size)
    truth = person(layout)[: len(found.places)]
    assert found.layout == layout and found.names == LAYOUTS[layout]
    assert found.places.shape == truth[..., :2].shape
    np.testing.assert_allclose(found.places, truth[..., :2], atol=1e-3)
    assert (found.confidences > 0).all() and found.people == 1 and found.missing == 0
    assert looks_like_keypoints(data, "a.json")


def test_a_folder_and_an_archive_of_openpose(tmp_path: Path):
    files = openpose_frames([person("body25")])
    del files["video_000000000002_keypoints.json"]
    folder = tmp_path / "frames"
    folder.mkdir()
    with zipfile.ZipFile(tmp_path / "frames.zip", "w") as archive:
        for name, data in files.items():
            (folder / name).write_bytes(data)
            archive.writestr(name, data)
    for path in (folder, tmp_path / "frames.zip"):
        found = read_keypoints(str(path))
        assert holds_keypoints(str(path)) and len(found.places) == FRAMES and found.missing == 1
        assert np.isnan(found.places[2]).all() and np.isfinite(found.places[3]).all()


def test_the_sizes_of_images_are_read():
    assert _of(FILES["annotations"][0]).size == SIZE


@pytest.mark.parametrize("count", [17, 25])
def test_arrays(count: int, tmp_path: Path):
    layout = {17: "coco17", 25: "body25"}[count]
    np.save(tmp_path / "a.npy", person(layout))
    np.savez(tmp_path / "a.npz", keypoints=person(layout)[..., :2], fps=25.0, image_size=np.array(SIZE))
    one, other = (read_keypoints(str(tmp_path / name)) for name in ("a.npy", "a.npz"))
    np.testing.assert_allclose(one.places, other.places)
    assert one.fps is None and other.fps == 25 and other.size == SIZE
    renamed = read_keypoints(str(tmp_path / "a.npy"), layout="h36m17") if count == 17 else None
    assert renamed is None or renamed.names == LAYOUTS["h36m17"]


def test_people_are_followed_without_numbers():
    near, far = person("coco17"), person("coco17", at=300) * [1, 1, 0.5]
    rows = [coco_results([near, far]), coco_results([far, near])]
    for data in rows:  # whichever stands first, the one seen best is person 0
        found = _of(data)
        assert found.people == 2
        np.testing.assert_allclose(found.places, near[..., :2])
        np.testing.assert_allclose(_of(data, person=1).places, far[..., :2])
    swapped = Detections(
        {t: [Detection(each[t]) for each in ((near, far) if t % 2 else (far, near))] for t in range(FRAMES)}
    )
    np.testing.assert_allclose([people_of(swapped)[0][t][0, 0] for t in range(FRAMES)], near[:, 0, 0])


def test_numbers_of_a_detector_are_kept():
    near, far = person("halpe26"), person("halpe26", at=300)[::-1] * [1, 1, 0.5]
    found = _of(coco_results([near, far], named=True), person=1)
    np.testing.assert_allclose(found.places, far[..., :2])


def test_several_individuals_of_deeplabcut():
    people = {"anna": person("coco17"), "ben": person("coco17", at=200) * [1, 1, 0.5]}
    found = _of(deeplabcut(people, LAYOUTS["coco17"]))
    assert found.people == 2
    np.testing.assert_allclose(found.places, people["anna"][..., :2], atol=1e-3)


def test_names_in_other_spellings():
    names = tuple(
        f"{name[0].upper()}{name.partition('_')[2].title()}" if "_" in name else name for name in LAYOUTS["coco17"]
    )
    human = [
        "ankle1", "knee1", "hip1", "hip2", "knee2", "ankle2", "wrist1", "elbow1", "shoulder1", "shoulder2", "elbow2",
        "wrist2", "chin", "forehead",
    ]  # fmt: skip
    assert set(_of(deeplabcut({"": person("coco17")}, names)).names) >= {"left_knee", "right_wrist"}
    found = _of(deeplabcut({"": person("coco17")[:, :14]}, tuple(human)))
    assert found.names[0] == "right_ankle" and found.names[9] == "left_shoulder" and found.layout == "named"


def test_missing_points():
    rows = person("coco17")
    rows[1, 3] = 0  # as detectors write it
    rows[2, 4, 2] = 0
    rows[3, 5, 0] = np.inf
    found = _of(json.dumps([{"image_id": t, "keypoints": r.ravel().tolist()} for t, r in enumerate(rows)]).encode())
    for frame, point in ((1, 3), (2, 4), (3, 5)):
        assert np.isnan(found.places[frame, point]).all() and found.confidences[frame, point] == 0
    assert (found.confidences > 0).sum() == FRAMES * 17 - 3


@pytest.mark.parametrize("layout", LAYOUTS)
def test_landmarks_of_layouts(layout: str):
    """What is projected into a layout is found in it again, with middles where the layout lacks a point."""
    rng = np.random.default_rng(0)
    true = rng.normal(size=(4, len(LANDMARKS), 2))
    for middle, ends in (("pelvis", "hip"), ("neck", "shoulder"), ("head", "ear")):
        sides = [LANDMARKS.index(f"{side}_{ends}") for side in ("left", "right")]
        true[:, LANDMARKS.index(middle)] = true[:, sides].mean(axis=1)
    columns, chosen = landmark_columns(layout)
    places = np.full((4, len(LAYOUTS[layout]), 2), np.nan)
    places[:, columns] = true[:, chosen]
    tracks, trust = landmark_tracks(LAYOUTS[layout], places, np.isfinite(places).all(-1).astype(float))
    found = landmark_mask(layout)
    assert ((trust > 0) == found).all()
    np.testing.assert_allclose(tracks[:, found], true[:, found])
    limbs = [name for name in LANDMARKS if name.endswith(("hip", "knee", "ankle", "shoulder", "elbow", "wrist"))]
    assert all(found[LANDMARKS.index(name)] for name in ("pelvis", "neck", *limbs))


def _arrays(**arrays: np.ndarray) -> bytes:
    made = io.BytesIO()
    np.savez(made, **arrays)
    return made.getvalue()


@pytest.mark.parametrize("shape", [(FRAMES, 17), (1, FRAMES, 17), (FRAMES, 17, 1)])
def test_confidences_of_arrays(shape: tuple[int, ...]):
    rows = person("coco17")
    scores = np.linspace(0.2, 0.9, FRAMES * 17)
    found = _of(_arrays(keypoints=rows[None, ..., :2], confidences=scores.reshape(shape)))
    np.testing.assert_allclose(found.confidences.ravel(), scores)


BAD = {
    "frames that differ": (
        _arrays(keypoints=person("coco17")[..., :2], scores=np.ones((FRAMES - 1, 17))), {}, "confidences of shape",
    ),
    "no known layout": (coco_results([person("coco17")[:, :11]]), {}, "no known layout"),
    "another layout": (FILES["coco"][0], {"layout": "body25"}, "has 17 keypoints"),
    "a layout that there is not": (FILES["coco"][0], {"layout": "coco18"}, "no keypoint layout"),
    "a person that is not there": (FILES["coco"][0], {"person": 3}, "--person 3"),
    "shares of an image of unknown size": (FILES["mediapipe"][0], {}, "shares of the image"),
    "too few points": (
        coco_results([person("coco17") * np.r_[np.ones(4), np.zeros(13)][:, None]]), {}, "no frame has",
    ),
    "a person without a point": (coco_results([0 * person("coco17")]), {}, "nobody in it has two keypoints"),
    "nobody": (b'{"people": []}', {}, "holds no person"),
    "no frames": (b'{"annotations": []}', {}, "holds no frame"),
    "points of a mouse": (
        deeplabcut({"": person("coco17")}, tuple(f"whisker{at}" for at in range(17))), {}, "not those of a human",
    ),
    "frames far apart": (
        json.dumps([{"image_id": t * 10**6, "keypoints": list(range(1, 52))} for t in range(3)]).encode(), {},
        "nearly all are missing",
    ),
    "numbers that are none": (b'[{"image_id": 1, "keypoints": ["a", "b", "c"]}]', {}, "not numbers"),
    "another JSON": (b'{"a": 1}', {}, "no known pose detector"),
    "nested deeply": (b"[" * 100_000, {}, "not JSON"),
    "a table of something else": (b"a,b\n1,2\n", {}, "no pose detector that pumps knows"),
    "a truncated table": (deeplabcut({"": person("coco17")}, LAYOUTS["coco17"])[:-200], {}, "cells where there are"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_bad_files_are_refused(kind: str):
    data, settings, words = BAD[kind]
    with pytest.raises(InputError, match=words) as refused:
        _of(data, **settings)
    assert "\n" not in refused.value.message


@pytest.mark.parametrize("kind", FILES)
def test_damaged_files_are_read_or_refused(kind: str, record_property):
    rng = np.random.default_rng(0)
    read = 0
    for _ in range(60):
        data = mutated(FILES[kind][0], rng, [*WORDS, b'"keypoints"', b'"image_id": 999999999', b"likelihood"])
        try:
            found = person_of(detections_in(data, "a.json"), "a.json", size=SIZE)
        except InputError as error:
            assert "a.json" in error.message and len(error.message) < 1000, error.message
            continue
        read += 1
        assert (np.isfinite(found.places).all(-1) == (found.confidences > 0)).all()
        assert ((found.confidences >= 0) & (found.confidences <= 1)).all()
    record_property("damaged_files", f"keypoints 60 {read}")


def test_a_crowd_takes_linear_time():
    """Of a frame's people only so many are read, and following them does not grow with the frames before."""
    crowd = [Detection(person("coco17", at=9.0 * at)[0]) for at in range(3 * MOST_PEOPLE)]
    assert len(people_of(Detections({0: crowd, 1: crowd}))) <= MOST_PEOPLE


def test_shares_need_the_size_only():
    found = _of(mediapipe(person("mediapipe33")), size=(2 * SIZE[0], SIZE[1]))
    np.testing.assert_allclose(found.places, person("mediapipe33")[..., :2] * [2, 1], atol=1e-6)


def test_the_names_of_layouts_in_settings_are_the_layouts():
    assert tuple(LAYOUTS) == KEYPOINT_LAYOUTS
