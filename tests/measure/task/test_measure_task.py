"""`pumps measure task`: networks of any task on the same windows; several trainings of one name are a curve."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import read_metrics
from data_schemas.tpc import TpcReader
from stages.measure.task import run as stage
from stages.measure.task.config import Config
from stages.measure.task.run import CURVE_PICTURE, run
from stages.measure.task.summary import BASE
from stages.shared.inference import pose_model
from stages.shared.inference.held_out_tasks import made_of_batch, task_batch
from stages.shared.inference.pose_model import load_pose_model
from stages.shared.statistics.line_chart import line_chart
from stages.shared.statistics.metrics import acceleration_mm, mpjae_deg, mpjpe_mm, mpjve_mm
from stages.train.finetune.config import Config as TrainConfig
from stages.train.finetune.run import run as finetune
from tests.train.finetune.rig_clouds import RIG, SMALL, write_rig_clouds


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clouds; networks of the task trackers, of its other corruption, and of another task."""
    made = tmp_path_factory.mktemp("measure-task")
    write_rig_clouds(made)
    for name, others in {
        "trackers": {}, "again": {"seed": 1}, "jitter": {"corruption": "jitter"}, "noise": {"task": "denoise"},
    }.items():  # fmt: skip
        given = {**SMALL, "task": "trackers", "skeleton": RIG, "tpc": made / "tpc", "output": made / name, **others}
        finetune(TrainConfig(**{**given, "steps": 1}))
    return made


def config(folder: Path, *weights: str, **others) -> Config:
    given = {"output": folder / "measured", "window": 48, "device": "cpu", "overwrite": True, **others}
    return Config(
        tpc=folder / "tpc", weights=tuple(f"{each.replace('=', f'={folder}/')}" for each in weights), **given
    )


def test_networks_are_measured_beside_the_base(folder: Path):
    report = run(config(folder, "mine=trackers", "other=again"))
    assert report.figures["methods"] == [BASE, "mine", "other"]
    rows, page = read_metrics(folder / "measured")
    assert all(np.isfinite(row.value) and row.value > 0 for row in rows)
    assert "| mine |" in page and "MPJPE, mm" in page and "Angles, degrees" in page
    assert not list(folder.glob(f"measured/*/{CURVE_PICTURE}"))


def test_several_trainings_of_one_name_are_a_curve(folder: Path, monkeypatch: pytest.MonkeyPatch):
    minutes = {
        "trackers": 0.5,
        "again": 2.0,
    }  # the trainings were too short for a tenth of a minute, the least that is stored

    def timed(path: Path, *others):
        return replace(load_pose_model(path, *others), minutes=minutes[path.name])

    monkeypatch.setattr(stage, "load_pose_model", timed)
    report = run(config(folder, "mine=again", "mine=trackers"))
    assert report.figures["methods"] == [BASE, "mine, 2 min", "mine, 0.5 min"]
    (picture,) = folder.glob(f"measured/*/{CURVE_PICTURE}")
    root = ElementTree.parse(picture).getroot()
    assert len([each for each in root.iter() if each.tag.endswith("polyline")]) == 2, "the networks and the base"
    words = {"".join(each.itertext()) for each in root.iter() if each.tag.endswith("text")}
    assert {"mine", BASE, "0.5", "2"} <= words


def test_figures_are_those_of_the_plain_metrics(folder: Path):
    model = load_pose_model(folder / "trackers", None, "cpu")
    with TpcReader(folder / "tpc") as reader:
        clip = next(row for row in reader.clips if row.split == "test")
        batch = task_batch(reader, model.task, clip, 0, 48, seed=0)
    made = made_of_batch(model, batch)
    heads = [pose.heads(model.rig.body)[0].double().numpy() for pose in (made, batch.target)]
    turns = [pose.rotations[0].double().numpy() for pose in (made, batch.target)]
    found = model.task.measures(made, batch)
    for name, expected in {
        "mpjpe_mm": mpjpe_mm(*heads), "mpjve_mm": mpjve_mm(*heads), "acceleration_mm": acceleration_mm(*heads),
        "mpjae_deg": mpjae_deg(*turns),
    }.items():  # fmt: skip
        assert found[name] == pytest.approx(float(expected), rel=2e-3, abs=0.02), name
    assert (made_of_batch(None, batch).roots == batch.base.roots).all()


def test_what_does_not_belong_together_is_refused(folder: Path):
    with pytest.raises(InputError, match="see different inputs"):
        run(config(folder, "a=trackers", "b=jitter"))
    with pytest.raises(InputError, match="different tasks"):
        run(config(folder, "a=trackers", "b=noise"))
    with pytest.raises(UsageError, match="Two rows are called"):
        run(config(folder, "a=trackers", "a=trackers"))
    with pytest.raises(InputError, match="900 frames"):
        run(config(folder, "a=trackers", window=900))


@pytest.mark.parametrize("task", [None, ["trackers"], "a-task-of-no-package"])
def test_a_checkpoint_of_no_known_task_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch, task: object):
    kept = read_checkpoint(open_artefact(folder / "trackers", "checkpoint"), optimiser=False)
    damaged = replace(kept, config={**kept.config, "task": task})
    monkeypatch.setattr(pose_model, "read_checkpoint", lambda *others, **more: damaged)
    with pytest.raises(InputError, match="no such task here"):
        load_pose_model(folder / "trackers", None, "cpu")


def test_a_chart_holds_every_point_between_its_ends():
    lines = {"a <b>": [(1.0, 4.0), (2.0, 2.0), (4.0, 1.0)], "level": [(1.0, 3.0), (4.0, 3.0)]}
    text = line_chart("Error & time", lines, {1.0: "1", 2.0: "2", 4.0: "4"}, shown=np.log2, dots=True)
    root = ElementTree.fromstring(text)
    dots = [each for each in root.iter() if each.tag.endswith("circle")]
    across = [float(each.get("cx", "")) for each in dots[:3]]
    down = [float(each.get("cy", "")) for each in dots[:3]]
    assert len(dots) == 5 and across[1] - across[0] == pytest.approx(across[2] - across[1], abs=0.2)
    assert down[0] < down[1] < down[2], "a larger error lies higher"
    assert "a &lt;b&gt;" in text
