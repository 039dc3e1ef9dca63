"""`pumps estimate` from end to end: keypoints of an embedded clip become motion on any rig; bad input is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from data_schemas.errors import InputError, UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.estimate.config import Config
from stages.estimate.run import run
from stages.project.config import Config as ProjectConfig
from stages.project.run import run as project
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.keypoint_files import read_keypoints
from stages.shared.formats.keypoint_layouts import LAYOUTS
from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import source_named
from stages.shared.humanoid.landmarks import LANDMARKS, landmarks_of
from stages.shared.kinematics.foot_contacts import find_feet, floor_levels
from stages.shared.kinematics.forward_numpy import positions_of
from tests.docs.pages import ROOT
from tests.shared.formats.keypoint_files_made import (
    coco_results,
    deeplabcut,
    mediapipe,
    mmpose_video,
    openpose_frames,
    person,
)

CLIPS = ROOT / "stages" / "shared" / "clips"
OTHER_RIG = ROOT / "docs" / "examples" / "other_rig.bvh"
CAMERA = {"azimuth": 40.0, "elevation": 12.0, "distance": 6.0}


def _read(path: Path) -> tuple[Skeleton, Motion]:
    found = recordings_in(source_named(str(path)), Asked())[0]
    return found.skeleton, found.motion


def _bones(path: Path) -> np.ndarray:
    """(T, 12, 3) directions of the limbs' bones, trunk and shoulders, in the body's own heading."""
    skeleton, motion = _read(path)
    heads, turns = positions_of(skeleton, motion), motion.rotations.astype(float)
    at = dict(zip(LANDMARKS, landmarks_of(skeleton, heads, turns).place(heads, turns).swapaxes(0, 1), strict=True))
    pairs = [("pelvis", "neck"), ("right_shoulder", "left_shoulder")] + [
        (f"{side}_{one}", f"{side}_{other}")
        for side in ("left", "right")
        for one, other in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))
    ]
    bones = np.stack([at[end] - at[start] for start, end in pairs], axis=1)
    bones /= np.linalg.norm(bones, axis=-1, keepdims=True)
    left = bones[:, 1] * [1, 0, 1]
    yaw = np.arctan2(left[:, 2], left[:, 0])
    turn = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    x = bones[..., 0] * turn[:, :1] + bones[..., 2] * turn[:, 1:]
    z = bones[..., 2] * turn[:, :1] - bones[..., 0] * turn[:, 1:]
    return np.stack([x, bones[..., 1], z], axis=-1)


def _degrees_apart(one: np.ndarray, other: np.ndarray) -> float:
    frames = min(len(one), len(other))
    cosines = (one[:frames] * other[:frames]).sum(-1).clip(-1, 1)
    return float(np.degrees(np.arccos(cosines)).mean())


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first frames of an embedded clip."""
    head, _, rows = (CLIPS / "walk.bvh").read_text().partition("Frames:")
    time, *lines = rows.splitlines()[1:]
    path = tmp_path_factory.mktemp("seen") / "truth.bvh"
    path.write_text("\n".join([f"{head}Frames: 45", time, *lines[:45], ""]))
    return path


@pytest.fixture(scope="module")
def seen(walk: Path) -> Path:
    path = walk.with_name("walk.json")
    project(ProjectConfig(input=walk, output=path, **CAMERA))
    return path


@pytest.fixture(scope="module")
def estimated(seen: Path, walk: Path) -> tuple[Path, dict]:
    output = seen.with_name("walk.bvh")
    page = seen.with_name("walk.html")
    report = run(Config(input=seen, output=output, skeleton=walk, page=page, fov=55.0))
    return output, report.figures


def test_the_motion_is_the_true_one(walk: Path, estimated: tuple[Path, dict]):
    truth, made = _bones(walk), _bones(estimated[0])
    assert len(made) == len(truth) and _degrees_apart(made, truth) < 25
    assert estimated[1]["reprojection_mm"] < 60


def test_the_file_has_the_rigs_header_and_the_feet_are_on_the_floor(estimated: tuple[Path, dict]):
    output = estimated[0]
    assert read_bvh(output.read_bytes(), "a").header == read_bvh((CLIPS / "walk.bvh").read_bytes(), "b").header
    skeleton, motion = _read(output)
    heads = positions_of(skeleton, motion)
    assert abs(floor_levels(heads, find_feet(skeleton)).min()) < 0.1
    height = np.ptp(heads[:, :, 1], axis=1)
    assert 1.0 < np.median(height) < 2.0
    assert np.percentile(heads[:, skeleton.root, 1], [5, 95]).min() > 0.6  # level: the pelvis stays up


def test_the_camera_is_found(estimated: tuple[Path, dict]):
    camera = estimated[1]["camera"]
    assert 0.5 < camera["position_m"][1] < 3.5
    distance = float(np.hypot(*(np.array(camera["position_m"]) - [0, 1, 0])[[0, 2]]))
    assert 3.5 < distance < 9


def test_the_page_holds_both_and_opens_offline(seen: Path, estimated: tuple[Path, dict]):
    text = seen.with_name("walk.html").read_text()
    assert "http://" not in text and "https://" not in text
    scene = json.loads(text.partition("const scene = ")[2].partition(";\n")[0])
    assert len(scene["seen"]) == len(scene["made"]) == estimated[1]["frames"]
    apart = [
        np.hypot(one[0] - other[0], one[1] - other[1])
        for frame, made in zip(scene["seen"], scene["made"], strict=True)
        for one, other in zip(frame, made, strict=True)
        if one and other
    ]
    assert np.median(apart) < 40  # pixels of 1920


def test_another_rig_and_a_detectors_errors(tmp_path: Path):
    seen, output = tmp_path / "a.json", tmp_path / "a.bvh"
    project(ProjectConfig(input=CLIPS / "punch.bvh", output=seen, layout="body25", errors="detector", **CAMERA))
    report = run(Config(input=seen, output=output, skeleton=OTHER_RIG, image_size="1920x1080"))
    skeleton, motion = _read(output)
    assert motion.frames == report.figures["frames"] == len(read_keypoints(str(seen)).places)
    assert skeleton.names == _read(OTHER_RIG)[0].names
    assert np.isfinite(motion.rotations).all()


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path):
    outputs = [tmp_path / "a.bvh", tmp_path / "b.bvh"]
    rng = np.random.default_rng(0)
    np.save(tmp_path / "a.npy", person("coco17", frames=12) + rng.normal(0, 5, (12, 17, 3)) * [1, 1, 0])
    for output in outputs:
        run(Config(input=tmp_path / "a.npy", output=output))
    assert outputs[0].read_bytes() == outputs[1].read_bytes()


def test_any_rate_gives_as_many_frames(tmp_path: Path):
    for fps in (24.0, 60.0):
        seen = tmp_path / f"{fps}.npz"
        places = person("coco17", frames=20)
        rng = np.random.default_rng(0)
        places[..., :2] += rng.normal(0, 5, (20, 17, 2))
        np.savez(seen, keypoints=places, fps=fps, image_size=np.array([640.0, 480.0]))
        report = run(Config(input=seen, output=tmp_path / f"{fps}.bvh"))
        assert report.figures["frames"] == 20
        assert _read(tmp_path / f"{fps}.bvh")[1].fps == pytest.approx(fps, rel=1e-3)


FORMS = {
    "two people": ("a.json", lambda rows: coco_results([rows + np.array([2, 1, 0]), rows - np.array([400, 0, 0.4])])),
    "body25": ("frames", lambda rows: openpose_frames([rows])),
    "mediapipe33": ("a.json", mediapipe),
    "h36m17": ("a.npy", None),
    "mmpose": ("a.json", lambda rows: mmpose_video(rows, "coco17")),
    "deeplabcut": ("a.csv", lambda rows: deeplabcut({"": rows}, LAYOUTS["coco17"])),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_keypoints_becomes_the_motion(form: str, walk: Path, tmp_path: Path):
    """The same walk, seen by the same camera, as each detector writes it."""
    layout = form if form in LAYOUTS else "coco17"
    project(ProjectConfig(input=walk, output=tmp_path / "seen.json", layout=layout, **CAMERA))
    found = read_keypoints(str(tmp_path / "seen.json"))
    rows = np.nan_to_num(np.concatenate([found.places, 0.9 * np.isfinite(found.places[..., :1])], axis=-1))[:10]
    assert found.size is not None
    name, write = FORMS[form]
    path = tmp_path / name
    settings: dict = {"input": path, "output": tmp_path / "made.bvh", "fps": 30.0, "fov": 55.0, "method": "turns"}
    settings |= {"image_size": "x".join(f"{int(side)}" for side in found.size)}
    if write is None:
        np.save(path, rows)
        settings["layout"] = layout
    elif name == "frames":
        path.mkdir()
        for frame, data in write(rows).items():
            (path / frame).write_bytes(data)
    else:
        if form == "mediapipe33":  # shares of the image
            rows = rows * [640 / found.size[0], 480 / found.size[1], 1]
        path.write_bytes(write(rows))
    report = run(Config(skeleton=walk, **settings))
    assert report.figures["frames"] == len(rows) and report.figures["layout"] in (layout, "named")
    assert report.figures["people"] == (2 if form == "two people" else 1)
    assert _degrees_apart(_bones(tmp_path / "made.bvh"), _bones(walk)) < 30


def test_landmarks_in_3d_go_the_same_way(tmp_path: Path):
    """Places of COCO's 17 in 3D and MediaPipe's world landmarks, both without a pelvis."""
    skeleton, motion = _read(CLIPS / "walk.bvh")
    heads, turns = positions_of(skeleton, motion), motion.rotations.astype(float)
    marks = landmarks_of(skeleton, heads, turns).place(heads, turns)
    names = [name for name in LANDMARKS if name not in ("pelvis", "spine", "neck", "head", "head_top")]
    names = [name for name in names if "heel" not in name and "toe" not in name]
    places = marks[:, [LANDMARKS.index(name) for name in names]]
    np.savez(tmp_path / "a.npz", positions=places, names=np.array(names), fps=30.0)
    run(Config(input=tmp_path / "a.npz", output=tmp_path / "a.bvh", skeleton=OTHER_RIG))
    truth, made = _bones(CLIPS / "walk.bvh"), _bones(tmp_path / "a.bvh")
    assert _degrees_apart(made, truth) < 20


BAD = {
    "no known layout": ({"input": "eleven.json"}, InputError, "no known layout"),
    "no image size": ({"input": "frames", "fov": 50.0}, InputError, "image's size"),
    "no such person": ({"person": 4}, InputError, "--person 4"),
    "two cameras": ({"intrinsics": "a,b,c"}, UsageError, "no camera"),
    "no such weights": ({"weights": "nothing"}, InputError, "no weights nothing"),
    "other weights": ({"weights": str(ROOT / "stages/shared/weights/small-free/lms")}, InputError, "fine-tuned"),
    "a rig that is none": ({"skeleton": "rig.bvh"}, InputError, "humanoid|rig.bvh"),
    "an output of another kind": ({"output": "a.txt"}, UsageError, "suffix"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_input_is_refused_and_nothing_is_written(kind: str, seen: Path, tmp_path: Path):
    settings, error, words = BAD[kind]
    rows = [{"image_id": t, "keypoints": list(range(1, 34))} for t in range(3)]
    (tmp_path / "eleven.json").write_text(json.dumps(rows))
    (tmp_path / "frames").mkdir()
    for name, data in openpose_frames([person("body25")]).items():
        (tmp_path / "frames" / name).write_bytes(data)
    lines = (CLIPS / "walk.bvh").read_text().replace("left_knee", "prop")
    (tmp_path / "rig.bvh").write_text(
        lines.partition("JOINT left_hip")[0] + "}\nMOTION\nFrames: 0\nFrame Time: 0.03\n"
    )
    before = sorted(tmp_path.iterdir())
    paths = {key: tmp_path / settings[key] for key in ("input", "skeleton", "output") if key in settings}
    given = {"input": seen, "output": tmp_path / "out.bvh", **settings, **paths}
    with pytest.raises(error, match=words) as refused:
        run(Config(**given))
    assert "\n" not in refused.value.message
    assert sorted(tmp_path.iterdir()) == before
