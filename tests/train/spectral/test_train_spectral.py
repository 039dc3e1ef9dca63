"""Training, prediction, completion and measures of mesh sequences, end to end on arms that bend."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import numpy as np
import pygltflib
import pytest

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.mesh import MeshReader
from data_schemas.metrics import read_metrics
from stages.complete_mesh.config import Config as CompleteConfig
from stages.complete_mesh.run import run as complete
from stages.export_mesh.config import Config as ExportConfig
from stages.export_mesh.run import run as export
from stages.measure.spectral.config import Config as MeasureConfig
from stages.measure.spectral.run import run as measure
from stages.predict_mesh.config import Config as PredictConfig
from stages.predict_mesh.run import run as predict
from stages.shared.inference.spectral import load_spectral
from stages.train.spectral.config import Config
from stages.train.spectral.run import run
from tests.shared.meshes.figures import write_arms

SIZES = {"channels": (8, 8), "latent": 16, "heads": 2, "layers": 1, "feedforward": 32, "dropout": 0.0}


def _config(folder: Path, output: str, **given) -> Config:
    settings = {
        "eigenvectors": 24, "window": 15, "known": 10, "steps": 30, "static_steps": 10, "batch": 4, "warmup": 5,
        "learning_rate": 5e-3, "average": 0.9, "validate_every": 15, "device": "cpu", "network": SIZES,
        "joint_network": {"blocks": 2},
    }  # fmt: skip
    return Config(mesh=folder / "arms", output=folder / output, **{**settings, **given})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("spectral")
    write_arms(folder / "arms", clips=5, frames=60)
    run(_config(folder, "predictor"))
    run(_config(folder, "completer", task="complete"))
    run(_config(folder, "joints", method="joints"))
    return folder


def test_training_lowers_the_error_and_logs_both_measures(folder: Path) -> None:
    rows = [row for row in read_checkpoint(folder / "predictor").log if row["split"] == "val"]
    assert rows[-1]["static_rmse_mm"] < rows[0]["static_rmse_mm"] and rows[-1]["rmse_mm"] < rows[0]["rmse_mm"]
    assert all(row["mpjpe_mm"] > 0 and row["melv_mm"] > 0 for row in rows)
    assert "frames, seed" in (next(folder.glob("predictor/data-*/MODEL_CARD.md"))).read_text()


def test_a_resumed_run_takes_the_same_steps(folder: Path) -> None:
    run(_config(folder, "whole", steps=6, static_steps=2, checkpoint_every=3))
    stopped = run(_config(folder, "parts", steps=6, static_steps=2, checkpoint_every=1, max_time=1e-9))
    assert not stopped.figures["finished"]
    run(_config(folder, "parts", steps=6, static_steps=2, checkpoint_every=3))
    one, other = (read_checkpoint(folder / name).weights for name in ("whole", "parts"))
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_the_last_weights_are_kept_if_asked_for(folder: Path) -> None:
    run(_config(folder, "last", steps=8, validate_every=4, keep="last"))
    kept = read_checkpoint(folder / "last")
    assert float(kept.weights["steps"]) == 8


def test_one_training_keeps_the_best_and_the_last_weights(folder: Path, tmp_path: Path) -> None:
    """Both are those of two trainings that keep one each; one alone holds no last weights beside others."""
    given = {"steps": 12, "validate_every": 2, "learning_rate": 1.0, "average": 0.5}
    for keep in ("best", "last", "both"):
        run(_config(folder, f"keep-{keep}", keep=keep, **given))
    one, other = (read_checkpoint(folder / f"keep-{keep}").weights for keep in ("best", "last"))
    assert float(one["steps"]) < float(other["steps"]) == 12
    for true, last in ((one, False), (other, True)):
        found = load_spectral(folder / "keep-both", "cpu", last=last)
        state = found.model.state_dict()
        assert all(np.array_equal(state[name].numpy(), true[name]) for name in state)
        assert np.array_equal(found.basis.vectors, true["basis.vectors"])
    with pytest.raises(InputError, match="does not hold the last weights"):
        load_spectral(folder / "keep-best", "cpu", last=True)
    both = folder / "keep-both"
    given = {"mesh": folder / "arms", "known": 10, "ahead": 5, "max_windows": 4, "device": "cpu"}
    measure(MeasureConfig(**given, weights=(f"early={both}",), last=(f"end={both}",), output=tmp_path / "metrics"))
    value = {
        (row.method, row.metric, row.interval, row.clip): row.value for row in read_metrics(tmp_path / "metrics")[0]
    }
    assert value["early", "mpjpe_mm", 4, "arm-3"] != value["end", "mpjpe_mm", 4, "arm-3"]
    poses = {}
    for kept in ("best", "last"):
        predict(PredictConfig(mesh=folder / "arms", weights=both, kept=kept, output=tmp_path / kept, device="cpu"))
        with MeshReader(tmp_path / kept) as reader:
            poses[kept] = reader.vertices("arm-0", 10, 15)
    assert np.abs(poses["best"] - poses["last"]).max() > 1e-4


def test_the_log_of_joints_holds_their_error_and_no_share_of_the_steps(folder: Path) -> None:
    run(_config(folder, "joints-last", method="joints", steps=8, validate_every=4, keep="last"))
    shown = [row for row in read_checkpoint(folder / "joints-last").log if row["split"] == "val"]
    assert shown and all("mpjpe_mm" in row and "steps_left" not in row for row in shown)


def test_predictions_go_on_as_long_as_asked_and_read_no_later_frame(folder: Path) -> None:
    given = {"mesh": folder / "arms", "weights": folder / "predictor", "device": "cpu"}
    report = predict(PredictConfig(**given, output=folder / "long", frames=23, until=30))
    assert report.figures["times_real_time"] > 1
    weights = load_spectral(folder / "predictor", "cpu")
    with MeshReader(folder / "long") as made, MeshReader(folder / "arms") as true:
        assert {row.frames for row in made.clips} == {33} and not made.is_skinned("arm-0")
        assert np.abs(made.vertices("arm-0", 0, 10) - true.vertices("arm-0", 20, 30)).max() < 1e-6
        known = weights.basis.coefficients(true.vertices("arm-0", 20, 30))[None]
        first = weights.predict(known, 5)
        second = weights.predict(np.concatenate([known, first], axis=1), 5)
        assert np.allclose(weights.predict(known, 8)[0], np.concatenate([first, second], axis=1)[0, :8], atol=1e-5)
        assert np.abs(made.vertices("arm-0", 10, 15) - weights.basis.vertices(first[0])).max() < 1e-4


def test_completion_keeps_what_is_known(folder: Path) -> None:
    given = {"mesh": folder / "arms", "weights": folder / "completer", "device": "cpu"}
    complete(CompleteConfig(**given, output=folder / "completed", start=7))
    with MeshReader(folder / "completed") as made, MeshReader(folder / "arms") as true:
        one, other = made.vertices("arm-1"), true.vertices("arm-1", 7, 22)
        assert len(one) == 15 and np.abs(one[:10] - other[:10]).max() < 1e-6
        assert np.abs(one[-1] - other[-1]).max() < 1e-6 and np.isfinite(one).all()


def test_tables_hold_every_method_at_the_papers_times(folder: Path) -> None:
    given = {"mesh": folder / "arms", "known": 10, "ahead": 5, "max_windows": 6, "device": "cpu"}
    weights = (f"ours={folder / 'predictor'}", f"joints={folder / 'joints'}")
    measure(MeasureConfig(**given, weights=weights, output=folder / "metrics"))
    rows, summary = read_metrics(folder / "metrics")
    assert {row.method for row in rows} == {"truth", "repeat last", "constant velocity", "ours", "joints"}
    assert {row.interval for row in rows} == {2, 4} and "80 ms" in summary and "Table 3" in summary
    value = {(row.method, row.metric, row.interval): row.value for row in rows if row.clip == "arm-3"}
    assert ("joints", "melv_mm", 2) not in value and ("truth", "mpjpe_mm", 2) not in value
    assert value["repeat last", "melv_mm", 4] < 1e-4 and value["truth", "melv_mm", 4] > 0
    assert value["repeat last", "mpjpe_until_mm", 4] < value["repeat last", "mpjpe_mm", 4]


def test_weights_of_another_task_or_mesh_are_refused(folder: Path, tmp_path: Path) -> None:
    given = {"mesh": folder / "arms", "output": tmp_path / "x", "device": "cpu"}
    with pytest.raises(InputError, match="was trained to complete"):
        predict(PredictConfig(**given, weights=folder / "completer"))
    with pytest.raises(InputError, match="does not hold a network of mesh sequences"):
        predict(PredictConfig(**given, weights=folder / "joints"))
    from stages.simulate_cloth.config import Config as ClothConfig
    from stages.simulate_cloth.run import run as simulate

    simulate(ClothConfig(output=tmp_path / "cloth", count=1, seconds=0.04, rows=5, size_m=0.3))
    with pytest.raises(InputError, match="another connectivity"):
        predict(PredictConfig(**{**given, "mesh": tmp_path / "cloth"}, weights=folder / "predictor"))
    with pytest.raises(InputError, match=r"No clip of .* has the 10 known frames"):
        predict(PredictConfig(**given, weights=folder / "predictor", until=9))
    assert not (tmp_path / "x").exists()


def test_what_cannot_be_trained_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="1000 eigenvectors are asked for, and a mesh of 96 vertices has 96"):
        run(_config(folder, "bad", eigenvectors=1000))
    with pytest.raises(InputError, match="No clip has the 99 frames of a window"):
        run(_config(folder, "bad", window=99))
    with pytest.raises(ValueError, match="does not complete"):
        _config(folder, "bad", method="joints", task="complete")
    assert not (folder / "bad").exists()


def test_a_glb_holds_the_skin_and_no_baked_frames(folder: Path, tmp_path: Path) -> None:
    export(ExportConfig(input=folder / "arms", output=tmp_path / "arm.glb"))
    found = pygltflib.GLTF2.load(str(tmp_path / "arm.glb"))
    assert found is not None and len(found.skins) == 1 and len(found.skins[0].joints) == 2
    primitive = found.meshes[0].primitives[0]
    assert primitive.attributes.JOINTS_0 is not None and not primitive.targets
    assert found.accessors[primitive.attributes.POSITION].count == 96
    assert {channel.target.path for channel in found.animations[0].channels} == {"rotation", "translation"}
    with pytest.raises(InputError, match="stored as vertices, and a GLB with skin needs bones"):
        export(ExportConfig(input=folder / "arms", output=tmp_path / "dense.glb", clip=("arm-4",)))
    with pytest.raises(UsageError, match="A GLB holds one clip"):
        export(ExportConfig(input=folder / "arms", output=tmp_path / "two.glb", clip=("arm-0", "arm-1")))


def test_a_page_holds_the_vertices_of_all_that_play(folder: Path, tmp_path: Path) -> None:
    beside = (f"again={folder / 'arms'}",)
    export(ExportConfig(input=folder / "arms", output=tmp_path / "a.html", clip=("arm-0",), beside=beside, frames=8))
    text = (tmp_path / "a.html").read_text()
    data = json.loads(re.search(r"const DATA = (.*?);</script>", text).group(1))
    one, other = data["scenes"]["arm-0"]
    assert (one["whose"], other["whose"], one["frames"]) == ("meshes", "again", 8)
    values = np.frombuffer(base64.b64decode(one["data"]), "<u2").reshape(8, -1, 3)
    with MeshReader(folder / "arms") as reader:
        assert np.abs(values * one["scale"] + one["low"] - reader.vertices("arm-0", 0, 8)).max() < 1e-4
    assert "http" not in text.replace("http://www.w3.org", "")
