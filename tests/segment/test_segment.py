"""`pumps segment`: anchors of a file as keyframes, the artefact, concepts of actions, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import write_artefact
from data_schemas.concepts import ConceptsReader, SegmentedClip, StoredBody
from data_schemas.errors import InputError, UsageError
from data_schemas.motion import ClipRow, MotionWriter
from stages.segment.config import Config
from stages.segment.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.inference.keyframes import parse_keyframes
from stages.shared.kinematics.spline_segments import spline_frames

CLIPS = Path(__file__).resolve().parents[2] / "stages" / "shared" / "clips"


def test_anchors_are_a_list_that_infill_takes():
    report = run(Config(input=CLIPS / "jump.bvh", keyframes=True, lambda_=800))
    (line,) = report.lines
    keys = parse_keyframes(line, report.figures["frames"])
    assert keys.tolist() == report.figures["keyframes"]
    assert keys[0] == 0 and keys[-1] == report.figures["frames"] - 1
    assert 5 < len(keys) < 40 and report.figures["fit_error_cm"] < 1.0


def test_lambda_divides_less_and_fits_worse():
    found = [run(Config(input=CLIPS / "dance_a.bvh", keyframes=True, lambda_=price)).figures for price in (50, 800)]
    assert len(found[0]["keyframes"]) > len(found[1]["keyframes"])
    assert found[0]["fit_error_cm"] < found[1]["fit_error_cm"]


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Embedded clips in an artefact, named as Bandai Namco names its files."""
    path = tmp_path_factory.mktemp("segment") / "motion"
    with write_artefact(path, "motion", stage="test", config={}) as draft, MotionWriter(draft.folder) as writer:
        for action, style, name in (("dance", "a", "dance_a"), ("dance", "b", "dance_b"), ("kick", "a", "kick")):
            skeleton, motion, _ = motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))
            row = ClipRow(
                clip=name, source=f"set.zip!dataset-1_{action}_{style}_001.bvh", sha256="0" * 64,
                skeleton=writer.add_skeleton(skeleton), frames=motion.frames, fps=motion.fps,
                seconds=motion.frames / motion.fps, split="train", licence="CC0",
            )  # fmt: skip
            writer.add_clip(row, motion)
        draft.licences.add("CC0")
    return path


def test_the_artefact_holds_splines_that_pass_near_the_motion(motions: Path, tmp_path: Path):
    run(Config(input=motions, output=tmp_path / "concepts", fps=20))
    with ConceptsReader(tmp_path / "concepts") as reader:
        assert reader.artefact.manifest.licences == ["CC0"] and reader.price == 200
        for row in reader.clips:
            clip = reader.segmented(row.clip)
            assert row.fps == 20 and clip.action == reader.action(row.clip) == row.clip.partition("_")[0]
            near = spline_frames(clip.splines, clip.anchors) - clip.positions
            assert np.linalg.norm(near, axis=-1).mean() < 0.01
            assert reader.body(row.skeleton).parents[0] == -1 and (clip.clusters == -1).all()


def test_the_same_input_gives_the_same_digest(motions: Path, tmp_path: Path):
    digests = set()
    for name in ("one", "two"):
        run(Config(input=motions, output=tmp_path / name))
        with ConceptsReader(tmp_path / name) as reader:
            digests.add(reader.artefact.manifest.digest)
    assert len(digests) == 1


@pytest.mark.parametrize("method", ["kmeans", "dbscan", "optics", "ward"])
def test_anchors_get_concepts_of_their_action(motions: Path, tmp_path: Path, method: str):
    pytest.importorskip("sklearn")
    page = tmp_path / "anchors.html"
    run(Config(input=motions, output=tmp_path / "c", cluster=method, page=page))  # pyright: ignore[reportArgumentType]
    with ConceptsReader(tmp_path / "c") as reader:
        centres = reader.centres()
        assert set(centres) == {"dance", "kick"}
        for row in reader.clips:
            clip = reader.segmented(row.clip)
            assert (clip.clusters >= 0).all() and clip.clusters.max() < len(centres[clip.action])
        np.testing.assert_allclose(centres["kick"][:, 0], 0, atol=1e-6)
    text = page.read_text()
    assert text.count("<h2>") == 2 and "http" not in text.replace("http://www.w3.org/2000/svg", "")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "Nothing is asked"),
        ({"keyframes": True, "fps": 20.0}, "--keyframes"),
        ({"output": Path("x"), "data_set": "humanact12", "fps": 20.0}, "keeps the rate"),
        ({"output": Path("x"), "page": Path("p.html")}, "--page"),
        ({"output": Path("x"), "clusters": 3}, "--clusters"),
        ({"output": Path("x"), "actions": "abc"}, "no group"),
        ({"output": Path("x"), "actions": "("}, "regular expression"),
    ],
)  # fmt: skip
def test_contradictions_are_refused(settings: dict, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=words):
        run(Config(input=CLIPS / "jump.bvh", **settings))
    assert not (tmp_path / "x").exists()


def test_keyframes_of_several_clips_are_refused(motions: Path):
    with pytest.raises(UsageError, match="several clips"):
        run(Config(input=motions, keyframes=True))


def test_an_artefact_that_exists_stays(motions: Path, tmp_path: Path):
    run(Config(input=motions, output=tmp_path / "c"))
    before = (tmp_path / "c" / "manifest.json").read_bytes()
    with pytest.raises(UsageError, match="--overwrite"):
        run(Config(input=motions, output=tmp_path / "c"))
    with pytest.raises(InputError, match="known action"):
        run(Config(input=CLIPS / "jump.bvh", output=tmp_path / "c", cluster="kmeans", overwrite=True))
    assert (tmp_path / "c" / "manifest.json").read_bytes() == before


def humanact12(folder: Path, rng: np.random.Generator) -> None:
    """Files of the data set's layout: joints of a body that stands in a camera's axes, Y down."""
    from stages.shared.formats.joint_lists import LISTS

    joints = LISTS["smpl24"]()
    names = [name for name, *_ in joints]
    places = np.zeros((24, 3))
    for at, (_, parent, offset) in enumerate(joints):
        if parent:
            places[at] = places[names.index(parent)] + np.array(offset) * (1, -1, -1)
    folder.mkdir()
    for subject, action in (("01", "0201"), ("02", "0201"), ("12", "1203")):
        moved = places + np.cumsum(rng.normal(scale=0.01, size=(40, 24, 3)), axis=0)
        np.save(folder / f"P{subject}G01R01F0001T0040A{action}.npy", moved.astype(np.float32))


def test_humanact12_is_read_in_its_layout(tmp_path: Path):
    humanact12(tmp_path / "h", np.random.default_rng(0))
    report = run(Config(input=tmp_path / "h", data_set="humanact12", output=tmp_path / "c"))
    assert report.figures["actions"] == {"throw": 1, "walk": 2}
    with ConceptsReader(tmp_path / "c") as reader:
        assert [row.split for row in reader.clips] == ["train", "train", "test"]
        assert {row.fps for row in reader.clips} == {20.0}
        assert reader.artefact.manifest.licences == ["for research, as its publishers state"]
        clip, body = reader.segmented(reader.clips[0].clip), reader.body(reader.clips[0].skeleton)
        head, foot = body.names.index("head"), body.names.index("left_foot")
        assert clip.positions[0, head, 1] > clip.positions[0, 0, 1] > clip.positions[0, foot, 1]


def test_uestc_is_read_in_its_layout(tmp_path: Path):
    rng = np.random.default_rng(1)
    (tmp_path / "u" / "info").mkdir(parents=True)
    (tmp_path / "u" / "joints3d").mkdir()
    videos = ["a0_d0_p001_c1_color.avi", "a1_d2_p003_c2_color.avi", "a1_d8_p003_c2_color.avi"]
    (tmp_path / "u" / "info" / "names.txt").write_text("\n".join(videos) + "\n")
    (tmp_path / "u" / "info" / "action_classes.txt").write_text("punching\nlifting\n")
    still = rng.normal(size=(49, 3))
    for video in videos:
        moved = still + np.cumsum(rng.normal(scale=0.01, size=(30, 49, 3)), axis=0)
        np.save(tmp_path / "u" / "joints3d" / f"{video[:-4]}.npy", moved)
    report = run(Config(input=tmp_path / "u", data_set="uestc", output=tmp_path / "c"))
    assert report.figures["clips"] == 2 and report.figures["actions"] == {"lifting": 1, "punching": 1}
    with ConceptsReader(tmp_path / "c") as reader:
        assert [row.split for row in reader.clips] == ["train", "test"]
        assert len(reader.body(reader.clips[0].skeleton).names) == 18
    (tmp_path / "u" / "joints3d" / f"{videos[0][:-4]}.npy").unlink()
    with pytest.raises(InputError, match="cannot be read"):
        run(Config(input=tmp_path / "u", data_set="uestc", output=tmp_path / "d"))


def test_a_damaged_artefact_is_refused(motions: Path, tmp_path: Path):
    run(Config(input=motions, output=tmp_path / "c"))
    manifest = json.loads((tmp_path / "c" / "manifest.json").read_text())
    path = tmp_path / "c" / manifest["data"] / "concepts.h5"
    data = bytearray(path.read_bytes())
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="damaged"), ConceptsReader(tmp_path / "c") as reader:
        reader.segmented("kick")


def test_inconsistent_clips_are_not_written(tmp_path: Path):
    from data_schemas.concepts import ConceptsWriter

    body = StoredBody(("hip", "knee"), np.array([-1, 0], np.int32), np.array([0, 3], np.int8))
    good = SegmentedClip(
        np.zeros((5, 2, 3), np.float32), np.array([0, 4], np.int32), np.zeros((1, 4, 2, 3), np.float32),
        np.array([-1, -1], np.int32), "walk", 1.0,
    )  # fmt: skip
    row = ClipRow("a", "a", "0" * 64, body.id, 5, 20.0, 0.25, "train", "CC0")
    with (
        write_artefact(tmp_path / "c", "concepts", stage="t", config={}) as draft,
        ConceptsWriter(draft.folder, 1.0) as writer,
    ):
        with pytest.raises(InputError, match="which was not added"):
            writer.add(row, good)
        writer.add_body(body)
        for change in ({"anchors": np.array([0, 3], np.int32)}, {"scale": 0.0}, {"splines": good.splines[:0]}):
            with pytest.raises(InputError):
                writer.add(row, SegmentedClip(**{**vars(good), **change}))
        writer.add(row, good)
