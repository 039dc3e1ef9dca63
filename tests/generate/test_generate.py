"""`pumps train generator`, `generate`, `refine` of an artefact and `measure concepts`, one after the other."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact, write_artefact
from data_schemas.concepts import ConceptsReader
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import read_metrics
from data_schemas.motion import ClipRow, MotionReader, MotionWriter
from stages.generate.config import Config
from stages.generate.run import run
from stages.measure.concepts.config import Config as MeasureConfig
from stages.measure.concepts.run import run as measure
from stages.shared.concepts.actions import action_of
from stages.shared.concepts.body_positions import relative_poses
from stages.shared.concepts.sequences import concept_set
from stages.shared.inference.generating import generated_motions, load_generator
from stages.shared.inference.recognising import load_recogniser
from stages.shared.kinematics.forward_numpy import positions_of
from stages.train.generator.config import Config as GeneratorConfig
from stages.train.generator.run import run as train_generator
from stages.train.recogniser.config import Config as RecogniserConfig
from stages.train.recogniser.run import run as train_recogniser
from tests.shared.concepts.two_actions import ACTIONS, write_two_actions

QUICK = {"batch": 4, "window": 16, "warmup": 1, "average": 0.5, "device": "cpu"}


class _Counted:
    """The steps of the last bar: how many were announced, and how many came."""

    total, steps = 0.0, 0.0

    def start(self, label: str, total: float | None = None) -> None:
        self.total, self.steps = total or 0.0, 0.0

    def advance(self, steps: float = 1, note: str = "") -> None:
        self.steps += steps

    def message(self, text: str) -> None: ...


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two generators of a few steps, a recogniser, and motions."""
    path = tmp_path_factory.mktemp("generate")
    write_two_actions(path / "c")
    for network, steps in (("actor", 60), ("recurrent", 4)):
        train_generator(
            GeneratorConfig(
                concepts=path / "c", output=path / network, network=network,  # pyright: ignore[reportArgumentType]
                steps=steps, width=16, blocks=1,
                latent=4, learning_rate=3e-3, validate_every=steps, checkpoint_every=steps, **QUICK,
            )
        )  # fmt: skip
    train_recogniser(
        RecogniserConfig(
            concepts=path / "c",
            output=path / "r",
            steps=20,
            width=16,
            validate_every=20,
            checkpoint_every=20,
            **QUICK,
        )
    )
    run(Config(weights=path / "actor", output=path / "m", count=3, device="cpu"))
    return path


@pytest.mark.parametrize("network", ["actor", "recurrent"])
def test_motions_are_bodies_on_the_ground_and_depend_on_seed_and_number_alone(folder: Path, network: str):
    model = load_generator(folder / network, "cpu")
    assert model.actions == ACTIONS and model.fps == 20 and set(model.frames) == {16}
    few = list(generated_motions(model, "walk", 2, None, seed=1))
    more = list(generated_motions(model, "walk", 3, None, seed=1))
    other = list(generated_motions(model, "walk", 2, None, seed=2))
    assert (len(few), len(more)) == (2, 3)
    for one, same, another in zip(few, more, other, strict=False):
        np.testing.assert_allclose(one.rotations, same.rotations, atol=1e-5)
        assert np.abs(one.rotations - another.rotations).max() > 1e-4
        np.testing.assert_allclose(np.linalg.norm(one.rotations, axis=-1), 1, atol=1e-5)
    lows = [positions_of(model.skeleton, each)[..., 1].min() for each in few]
    np.testing.assert_allclose(lows, 0, atol=1e-5)
    assert few[0].frames == 16 and next(generated_motions(model, "walk", 1, 24, seed=1)).frames == 24


def test_training_finds_the_actions_poses(folder: Path):
    """After some steps, generated frames are nearer to the action's mean frame than to the other action's."""
    model = load_generator(folder / "actor", "cpu")
    with ConceptsReader(folder / "c") as reader:
        found = concept_set(reader)
    clips = {found.actions[clip.action]: clip.positions.astype(np.float64) for clip in found.of("train")}

    def mean_pose(positions: np.ndarray) -> np.ndarray:
        return relative_poses(positions, found.body.groups).mean(0)

    for action in ACTIONS:
        (made,) = generated_motions(model, action, 1, None, seed=1)
        pose = mean_pose(positions_of(model.skeleton, made).astype(np.float64))
        apart = {name: np.linalg.norm(pose - mean_pose(clip), axis=-1).mean() for name, clip in clips.items()}
        assert min(apart, key=apart.__getitem__) == action, apart


def test_the_artefact_names_actions_and_licences(folder: Path):
    with MotionReader(folder / "m") as reader:
        assert [action_of(row) for row in reader.clips] == [name for name in ACTIONS for _ in range(3)]
        assert {row.split for row in reader.clips} == {"test"}
    assert open_artefact(folder / "m", "motion").manifest.licences == ["CC0"]


def test_actions_that_are_named_twice_are_made_once(folder: Path, tmp_path: Path):
    counted = _Counted()
    config = Config(weights=folder / "actor", output=tmp_path / "x", action=("walk", "walk"), count=2, device="cpu")
    report = run(config, progress=counted)
    assert report.figures["clips"] == counted.steps == counted.total == 2


@pytest.mark.parametrize(("key", "value"), [("test_accuracy", "high"), ("fps", float("inf")), ("joints", 3)])
def test_a_recogniser_with_a_damaged_config_is_refused(folder: Path, tmp_path: Path, key: str, value: object):
    shutil.copytree(folder / "r", tmp_path / "r")
    path = open_artefact(tmp_path / "r").folder / "config.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    with pytest.raises(InputError, match="is damaged"):
        load_recogniser(tmp_path / "r", "cpu")


def test_unknown_actions_and_other_checkpoints_are_refused(folder: Path, tmp_path: Path):
    with pytest.raises(UsageError, match="getup_faceup, walk"):
        run(Config(weights=folder / "actor", output=tmp_path / "x", action=("swim",), device="cpu"))
    with pytest.raises(InputError, match="no generator"):
        run(Config(weights=folder / "r", output=tmp_path / "x", device="cpu"))
    with pytest.raises(InputError, match="no recogniser"):
        measure(
            MeasureConfig(concepts=folder / "c", recogniser=folder / "actor", output=tmp_path / "x", device="cpu")
        )
    assert not (tmp_path / "x").exists()


def test_real_and_made_motions_are_measured(folder: Path, tmp_path: Path):
    """The measures of two copies are equal, and worse motions are further from the real ones."""
    with (
        MotionReader(folder / "m") as reader,
        write_artefact(tmp_path / "still", "motion", stage="t", config={}) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for row in reader.clips:
            writer.add_skeleton(reader.skeleton(row.skeleton))
            whole = reader.motion(row.clip)
            writer.add_clip(row, whole.at(np.full(row.frames, row.frames // 2)))
    counted = _Counted()
    report = measure(
        MeasureConfig(
            concepts=folder / "c", recogniser=folder / "r", splits=("train", "test"), repetitions=2, device="cpu",
            made=(f"made={folder / 'm'}", f"made + still={tmp_path / 'still'}"), fits=(f"real={folder / 'c'}",),
            output=tmp_path / "x",
        ),
        progress=counted,
    )  # fmt: skip
    assert counted.steps == counted.total > 0
    found = report.figures["measured"]
    assert set(found) == {"real", "made", "made + still"} and "fid" not in found["real"]
    assert 0 <= found["made"]["accuracy"]["value"] <= 1 and found["made"]["fid"]["value"] > 0
    assert found["made + still"]["fid"]["value"] != found["made"]["fid"]["value"]
    assert 0 < report.figures["fit_error_cm"]["real"] < 2
    rows, page = read_metrics(tmp_path / "x")
    assert {row.metric for row in rows} >= {"a_fid", "fid", "accuracy", "diversity", "multimodality", "fit_error_cm"}
    assert "| made + still | 6 |" in page and "×" in page and "with replacement" in page


def test_clips_of_unknown_actions_are_named(folder: Path, tmp_path: Path):
    with (
        MotionReader(folder / "m") as reader,
        write_artefact(tmp_path / "m", "motion", stage="t", config={}) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        row = reader.clips[0]
        writer.add_skeleton(reader.skeleton(row.skeleton))
        writer.add_clip(ClipRow(**{**vars(row), "source": "swim.bvh"}), reader.motion(row.clip))
    given = {"concepts": folder / "c", "recogniser": folder / "r", "splits": ("train",), "device": "cpu"}
    with pytest.raises(InputError, match="of no known action"):
        measure(MeasureConfig(**given, made=(f"a={tmp_path / 'm'}",), output=tmp_path / "x"))
    with pytest.raises(InputError, match="action 'swim'"):
        measure(MeasureConfig(**given, made=(f"a={tmp_path / 'm'}",), actions="([a-z]+).bvh", output=tmp_path / "x"))
    assert not (tmp_path / "x").exists()
