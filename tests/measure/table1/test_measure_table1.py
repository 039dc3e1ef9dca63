"""From motions to Table 1: a method is trained, measured beside the plain interpolations, and joined with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.manifest import open_artefact
from data_schemas.metrics import read_metrics
from data_schemas.motion import MotionWriter
from data_schemas.skeleton import NO_GROUP
from stages.evaluate.config import Config as EvaluateConfig
from stages.evaluate.pose_methods import whole_skeleton
from stages.evaluate.run import run as evaluate
from stages.measure.table1.config import Config
from stages.measure.table1.run import run
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample
from stages.shared.networks.layers.sizes import MethodSizes
from stages.shared.pointcloud.bones import body_joints
from stages.shared.statistics.baselines import Poses, damped, slerp
from stages.train.baseline.config import Config as TrainConfig
from stages.train.baseline.run import run as train
from tests.evaluate.swaying import skeleton, swaying

TASKS = {"tasks": ("interpolation",), "intervals": (15, 30), "window": 61}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Motions, a method that was trained on them, and two evaluations."""
    made = tmp_path_factory.mktemp("table1")
    with (
        write_artefact(made / "motions", "motion", stage="ingest", config={}, licences=["CC0"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        rig = writer.add_skeleton(skeleton())
        for number, split in enumerate(["train", "train", "val", "test", "test"]):
            name = f"{'walk' if number % 2 else 'dance'}{number}"
            row = ClipRow(name, f"set.zip!{name}.bvh", "0" * 64, rig, 150, 30.0, 5.0, split, "CC0")
            writer.add_clip(row, swaying(number, 150))
    sample(SampleConfig(motion=made / "motions", output=made / "tpc", points=32))
    train(
        TrainConfig(
            tpc=made / "tpc", output=made / "delta", method="delta", steps=3, batch=2, window=31, device="cpu",
            network=MethodSizes(width=16, layers=1, heads=2), validate_every=3,
        )
    )  # fmt: skip
    evaluate(EvaluateConfig(motion=made / "motions", output=made / "plain", **TASKS))
    evaluate(
        EvaluateConfig(
            motion=made / "motions",
            output=made / "measured",
            weights=(f"delta={made / 'delta'}",),
            plain=False,
            **TASKS,
        )
    )
    return made


def test_methods_are_joined_and_compared_pair_by_pair(folder: Path, tmp_path: Path):
    report = run(Config(metrics=(folder / "plain", folder / "measured"), output=tmp_path / "joined", ours=("delta",)))
    rows, page = read_metrics(tmp_path / "joined")
    assert report.figures["methods"] == ["lerp", "slerp", "cubic", "damped", "delta"]
    assert len({(r.clip, r.method, r.interval, r.metric) for r in rows}) == len(rows)
    assert "| delta | native |" in page and "| slerp | untrained |" in page
    values = {(r.clip, r.method): r.value for r in rows if (r.metric, r.interval) == ("l2p_m", 15)}
    ratio = sum(v for (_, m), v in values.items() if m == "delta") / min(
        sum(v for (_, m), v in values.items() if m == other) for other in ("lerp", "slerp", "cubic", "damped")
    )
    assert f"×{ratio:.2f} [" in page
    summary = open_artefact(tmp_path / "joined").manifest.summary
    assert summary["milliseconds_per_frame"]["delta"] > 0  # pyright: ignore
    assert summary["weights"][0]["native"] is True  # pyright: ignore


def test_other_windows_and_methods_that_come_twice_are_refused(folder: Path, tmp_path: Path):
    with pytest.raises(InputError, match="measures cubic again"):
        run(Config(metrics=(folder / "plain", folder / "plain"), output=tmp_path / "twice"))
    other = TASKS | {"intervals": (15,)}
    evaluate(EvaluateConfig(motion=folder / "motions", output=tmp_path / "other", plain=False,
                            weights=(f"delta={folder / 'delta'}",), **other))  # fmt: skip
    with pytest.raises(InputError, match="other windows"):
        run(Config(metrics=(folder / "plain", tmp_path / "other"), output=tmp_path / "joined"))
    with pytest.raises(UsageError, match="No evaluation measured 'mine'"):
        run(Config(metrics=(folder / "plain",), output=tmp_path / "joined", ours=("mine",)))


def test_the_curve_takes_one_method_several_times_on_the_same_windows(folder: Path, tmp_path: Path):
    measured = folder / "measured"
    run(Config(metrics=(folder / "plain", measured), curve=(measured, measured), output=tmp_path / "curve"))
    _, page = read_metrics(tmp_path / "curve")
    curve = page[page.index("minutes of training") :].splitlines()
    assert sum("|" in line and "0." in line for line in curve) >= 3
    other = TASKS | {"intervals": (15,)}
    evaluate(EvaluateConfig(motion=folder / "motions", output=tmp_path / "other", **other))
    with pytest.raises(InputError, match="other windows"):
        run(Config(metrics=(folder / "plain",), curve=(tmp_path / "other",), output=tmp_path / "joined"))


def test_every_category_is_compared_on_its_own_clips(folder: Path, tmp_path: Path):
    kinds = ("Walking=*walk*", "Others=*")
    for name, more in (("plain", {}), ("measured", {"weights": (f"delta={folder / 'delta'}",), "plain": False})):
        evaluate(EvaluateConfig(motion=folder / "motions", output=tmp_path / name, category=kinds, **more, **TASKS))
    run(Config(metrics=(tmp_path / "plain", tmp_path / "measured"), output=tmp_path / "joined", ours=("delta",)))
    rows, page = read_metrics(tmp_path / "joined")
    lines = [line for line in page[page.index("By category:") : page.index("## Time")].splitlines() if "L2P" in line]
    assert len(lines) == 2 * 2 and lines[0].startswith("| Others (1 clip) | Interpolation | L2P 15 |")
    assert lines[2].startswith("| Walking (1 clip) |")
    of_walk = {r.method: r.value for r in rows if (r.archive, r.metric, r.interval) == ("Walking", "l2p_m", 15)}
    best = min((name for name in of_walk if name != "delta"), key=lambda name: of_walk[name])
    assert lines[2].endswith(f"| {best} | ×{of_walk['delta'] / of_walk[best]:.2f} p 1 |")  # of one clip


def test_categories_take_the_place_of_archives(folder: Path, tmp_path: Path):
    evaluate(
        EvaluateConfig(motion=folder / "motions", output=tmp_path / "kinds", category=("Walking=*walk*",), **TASKS)
    )
    rows, _ = read_metrics(tmp_path / "kinds")
    assert {row.archive for row in rows} == {"Walking"} and {row.clip for row in rows} == {"walk3"}


def test_joints_that_are_no_bones_follow_and_keys_stay_bit_for_bit():
    rig = skeleton()
    poses = Poses.of(rig, [swaying(3, 61)])
    known = np.arange(61) % 15 == 0
    joints = body_joints(rig)
    plain_places, plain_turns = (torch.from_numpy(part) for part in damped(poses, known))
    same = whole_skeleton(poses, known, joints, (plain_places[:, :, joints], plain_turns[:, :, joints]))
    np.testing.assert_allclose(same[0], plain_places.numpy(), atol=1e-5)
    places, turns = (torch.from_numpy(part) for part in slerp(poses, known))
    found = whole_skeleton(poses, known, joints, (places[:, :, joints], turns[:, :, joints]))
    assert (found[0][:, known] == poses.positions.numpy()[:, known]).all()
    assert (found[1][:, known] == poses.rotations.numpy()[:, known]).all()
    np.testing.assert_allclose(found[0][:, :, joints], places[:, :, joints].numpy(), atol=1e-5)
    assert (rig.groups == NO_GROUP).any() or len(joints) == rig.joints
