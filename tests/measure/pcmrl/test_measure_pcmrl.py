"""What PC-MRL's tables measure: floors, zeros where nothing differs, errors that are those of the plain ways."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from data_schemas.artefact import write_artefact
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError, UsageError
from data_schemas.metrics import MetricRow, read_metrics
from data_schemas.tpc import BoneSet, TpcReader, TpcWriter
from stages.measure.pcmrl import paper
from stages.measure.pcmrl.config import Config
from stages.measure.pcmrl.retargeting import ORIGINAL, end_distance
from stages.measure.pcmrl.run import run
from stages.shared.inference.pose_filling import load_interpolator
from stages.shared.networks.layers.sizes import InterpolatorSizes
from stages.shared.pointcloud.sampling import draw_points
from stages.shared.statistics import metrics
from stages.shared.statistics.categories import category_of, named
from stages.train.citl.config import Config as TrainConfig
from stages.train.citl.run import run as train
from tests.shared.training.tiny_clouds import GROUPS, PARENTS, TAILS, swinging, write_clouds

SIZES = InterpolatorSizes(width=16, heads=2, key_layers=1, fill_layers=1, frame_layers=1, longest=12)
SHORT = {"window": 46, "splits": ("val",), "intervals": (5, 15), "points": 200}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("pcmrl")
    write_clouds(made / "tpc")
    train(
        TrainConfig(
            tpc=made / "tpc", output=made / "citl", steps=2, batch=2, window=32, network=SIZES, device="cpu",
            validate_every=2, checkpoint_every=2,
        )
    )  # fmt: skip
    return made


def write_moved(path: Path, shift_m: float) -> Path:
    """The clips of `write_clouds`, each figure moved along X."""
    rng = np.random.default_rng(0)
    weights = np.linalg.norm(TAILS, axis=1)
    weights = (weights / weights.sum()).astype(np.float32)
    with (
        write_artefact(path, "tpc", stage="sample-tpc", config={}, licences=["CC0"]) as draft,
        TpcWriter(draft.folder) as writer,
    ):
        bones = writer.add_bones(BoneSet(PARENTS, TAILS, GROUPS, weights, *draw_points(weights, 64, rng)))
        for clip in range(6):
            frames = 60 if clip else 12
            heads, rotations = swinging(rng, frames)
            name = f"archive{clip % 2}.zip!clip{clip}.bvh"
            split = "val" if clip % 3 == 2 else "train"
            row = ClipRow(f"clip{clip}", name, "0" * 64, bones, frames, 30.0, frames / 30, split, "CC0")
            writer.add_rigid(row, heads + np.float32([shift_m, 0, 0]), rotations)
    return path


def rows_of(output: Path) -> tuple[list[MetricRow], str]:
    return read_metrics(output)


def value(rows: list[MetricRow], method: str, metric: str, interval: int) -> float:
    found = [r.value for r in rows if (r.method, r.metric, r.interval) == (method, metric, interval)]
    assert found, (method, metric, interval)
    return float(np.mean(found))


def test_filling_is_measured_as_it_is_defined(folder: Path):
    report = run(Config(output=folder / "one", truth=folder / "tpc", weights=(f"mine={folder / 'citl'}",), **SHORT))
    rows, page = rows_of(folder / "one")
    assert report.figures["methods"] == ["lerp", "slerp", "damped", "mine"]
    # Barely trained, the network is the plain interpolation that it adds to.
    for interval in (5, 15):
        for metric in ("l2p_m", "l2q", "npss"):
            assert value(rows, "mine", metric, interval) == pytest.approx(
                value(rows, "damped", metric, interval), rel=0.05
            )
    assert value(rows, "slerp", "l2p_m", 5) < value(rows, "slerp", "l2p_m", 15)
    with TpcReader(folder / "tpc") as reader:
        heads, _ = reader.transforms("clip2", 7, 53)
    known = np.arange(46) % 15 == 0
    known[-1] = True
    keys = np.flatnonzero(known)
    line = np.stack([np.interp(np.arange(46), keys, heads[keys].reshape(len(keys), -1)[:, c]) for c in range(36)], 1)
    expected = metrics.l2p_m(line.reshape(46, 12, 3), heads)
    of_clip = [r.value for r in rows if (r.clip, r.method, r.metric, r.interval) == ("clip2", "lerp", "l2p_m", 15)]
    assert of_clip == [pytest.approx(float(expected), rel=1e-4)]
    assert "damped cubic" in page and "0.0494" in page and "2 steps of 2 windows" in page


def test_the_original_is_the_floor_and_a_move_is_seen(folder: Path):
    moved = write_moved(folder / "moved", 0.3)
    config = Config(
        output=folder / "two", source=folder / "tpc", adapted=(f"same={folder / 'tpc'}", f"moved={moved}"), **SHORT
    )
    run(config)
    rows, page = rows_of(folder / "two")
    for sigma in (0, 10, 50, 100, 200):
        floor = value(rows, ORIGINAL, "knn_cm", sigma)
        assert value(rows, "same", "knn_cm", sigma) == pytest.approx(floor, rel=0.1)
        assert value(rows, "moved", "knn_cm", sigma) > (2 if sigma < 100 else 1.1) * floor
    assert value(rows, ORIGINAL, "end_cm", 0) == value(rows, "same", "end_cm", 0) == 0
    assert value(rows, "moved", "end_cm", 0) == pytest.approx(30, rel=1e-4)
    floors = [value(rows, ORIGINAL, "knn_cm", sigma) for sigma in (0, 10, 50, 100, 200)]
    assert floors == sorted(floors)
    assert "σ = 0.05" in page and "Primal skeleton" in page


def test_ends_are_wrists_ankles_and_head_whatever_hangs_below():
    heads, rotations = (torch.from_numpy(part) for part in swinging(np.random.default_rng(1), 5))
    weights = np.ones(12, np.float32)
    none = (np.zeros(1, np.int32), np.zeros(1, np.float32), np.zeros((1, 3), np.float32))
    plain = BoneSet(PARENTS, TAILS, GROUPS, weights, *none)
    with_hands = BoneSet(
        np.append(PARENTS, [5, 7, 9, 11]).astype(np.int32),
        np.concatenate([TAILS, np.full((4, 3), 0.05, np.float32)]),
        np.append(GROUPS, [1, 2, 3, 4]).astype(np.int8), np.ones(16, np.float32), *none,
    )  # fmt: skip
    turned = Rotation.from_quat(rotations[:, [5, 7, 9, 11]].reshape(-1, 4).numpy())
    tips = heads[:, [5, 7, 9, 11]] + torch.from_numpy(
        turned.apply(np.tile(TAILS[[5, 7, 9, 11]], (5, 1))).reshape(5, 4, 3)
    )
    more = torch.cat([heads, tips.float()], dim=1)
    assert end_distance((with_hands, more, rotations), (with_hands, more, rotations)) == 0
    lifted = more.clone()
    lifted[:, 12:, 1] += 0.1  # hands and feet, four of five ends
    assert end_distance((with_hands, lifted, rotations), (with_hands, more, rotations)) == pytest.approx(0.08)
    # A skeleton whose limbs end there has a head to compare alone.
    assert end_distance((plain, heads, rotations), (with_hands, lifted, rotations)) == 0


def test_categories_and_names():
    row = ClipRow("a", "x.zip!x/walk_1.bvh", "0" * 64, "s", 9, 30.0, 0.3, "test", "")
    assert category_of(row, {}) == "x"
    assert category_of(row, {"Running": "*run*", "Walking": "*walk*", "Rest": "*"}) == "Walking"
    assert category_of(row, {"Running": "*run*"}) is None
    assert named("weights", ["a=b=c"]) == {"a": "b=c"}
    for wrong in (["a"], ["=b"], ["a="], ["a=1", "a=2"]):
        with pytest.raises(UsageError):
            named("weights", wrong)


def test_what_cannot_be_measured_is_refused(folder: Path):
    with pytest.raises(ValueError, match="truth"):
        Config(output=folder / "no")
    with pytest.raises(InputError, match="long enough"):
        run(Config(output=folder / "no", truth=folder / "tpc", splits=("test",)))
    with pytest.raises(InputError, match="no clip"):
        run(Config(output=folder / "no", source=folder / "tpc", adapted=(f"a={folder / 'tpc'}",), window=500))
    with pytest.raises(InputError, match="another hierarchy"):
        load_interpolator(folder / "citl", "cpu").check_hierarchy(PARENTS, GROUPS[::-1], "a clip")
    assert not (folder / "no").exists()


def test_the_papers_figures_are_whole():
    """The paper's own remarks on its tables hold of the figures typed here."""
    assert all(len(nine) == 9 for each in paper.TABLE_1.values() for nine in each.values())
    assert [list(each) for each in paper.TABLE_1.values()] == [list(paper.TABLE_1["Golf"])] * 4
    for category, methods in paper.TABLE_1.items():
        assert (methods["CITL"][1] < methods["PC-MRL"][1]) == (category != "Swimming")
        assert methods["PC-MRL"][2] < methods["LERP"][2]
    for sigma in range(5):
        column = [values[sigma] for values in paper.TABLE_2.values()]
        assert column[0] < column[2] < column[1]
    better = [
        one < other
        for one, other in zip(paper.TABLE_3["PC-MRL"], paper.TABLE_3["CITL, primal skeleton"], strict=True)
    ]
    assert all(better[:6])
