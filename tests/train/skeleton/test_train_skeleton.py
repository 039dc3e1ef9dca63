"""`pumps train skeleton`: it learns without pairs, its checkpoint carries the rig, batches follow from seeds."""

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.tpc import TpcReader
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.inference.skeleton_decoding import decode_cloud, load_rig_network
from stages.shared.kinematics.forward import positions_of
from stages.shared.pointcloud.knn_loss import nearest_trajectories
from stages.shared.pointcloud.rig import rig_of_motion
from stages.shared.settings.layers import settle_file_part
from stages.shared.settings.presets import preset_layers
from stages.shared.training.task import step_generator, step_random
from stages.shared.training.windows import draw_clouds
from stages.train.skeleton.config import Config
from stages.train.skeleton.run import run
from stages.train.skeleton.sources import pools_of
from stages.train.skeleton.task import SkeletonTask, is_of_rig, resized
from tests.shared.inference.examples import humanoid, swinging
from tests.shared.training.tiny_clouds import write_clouds

RIG = "stages/shared/clips/walk.bvh"
TINY = {
    "steps": 4,
    "batch": 3,
    "window": 8,
    "points": 40,
    "loss_points": 60,
    "warmup": 2,
    "validate_every": 2,
    "device": "cpu",
    "encoder": {"width": 8, "blocks": 2, "neighbours": 4, "heads": 2},
    "network": {"width": 32, "layers": 1, "heads": 2},
}


@pytest.fixture(scope="module")
def clouds(tmp_path_factory) -> Path:
    return write_clouds(tmp_path_factory.mktemp("clouds") / "tpc")


def config_for(clouds: Path, output: Path, **changes) -> Config:
    return Config(**{**TINY, "skeleton": RIG, "tpc": (clouds,), "output": output, **changes})


def test_it_learns_clouds_of_another_skeleton(clouds, tmp_path):
    report = run(config_for(clouds, tmp_path / "net", steps=60, learning_rate=5e-3, average=0.9, augment=False))
    log = read_checkpoint(tmp_path / "net").log
    found = [row["knn_mm"] for row in log if row["split"] == "val"]
    floor = next(row["reference_mm"] for row in log if row["split"] == "val")
    assert report.figures["finished"] and floor < found[-1] < 0.93 * found[0]


def test_every_term_is_logged_and_turned_off_by_its_weight(clouds, tmp_path):
    run(config_for(clouds, tmp_path / "all", steps=2, back_weight=0.5))
    run(config_for(clouds, tmp_path / "few", steps=2, shape_weight=0, velocity_weight=0, roll_weight=0, end_weight=0))
    every, few = (
        set(next(row for row in read_checkpoint(tmp_path / name).log if row["split"] == "train"))
        for name in ("all", "few")
    )
    assert every - few == {"shape", "velocity", "roll", "end", "back"} and {"knn", "unit"} <= few


def test_the_checkpoint_carries_the_rig_and_the_licences(clouds, tmp_path):
    run(config_for(clouds, tmp_path / "net", steps=2))
    network = load_rig_network(tmp_path / "net", "cpu")
    rig = rig_of_file(RIG)
    assert network.rig.skeleton.header == rig.skeleton.header != ""
    np.testing.assert_allclose(network.rig.rest_local, rig.rest_local, atol=1e-6)
    assert network.licences == ("CC0",) and "archive0.zip" in network.trained_on
    with TpcReader(clouds) as reader:
        points, groups = reader.points("clip1")
    motion = decode_cloud(network, points, groups)
    assert motion.frames == 60 and motion.rotations.shape[1] == rig.skeleton.joints
    middle = positions_of(rig.skeleton, motion)[:, rig.body.joints].mean(1)
    assert np.linalg.norm(middle - points.mean(1), axis=-1).max() < 0.5  # where the cloud is


def test_a_killed_run_and_parts_of_batches_draw_the_same(clouds, tmp_path):
    """What a step draws follows from its seed alone, window by window."""
    readers = [TpcReader(clouds), TpcReader(clouds)]
    config = config_for(clouds, tmp_path)
    rig = rig_of_file(RIG)
    task = SkeletonTask(config, rig, *pools_of(readers, config), torch.device("cpu"))
    whole = task.draw(step_random(0, 1, 5, range(3)))
    part = task.draw(step_random(0, 1, 5, range(1, 3)))
    torch.testing.assert_close(whole.points[1:], part.points)
    torch.testing.assert_close(whole.ends[1:], part.ends)
    loss, _ = task.loss(whole, step_generator(0, 2, 5, range(3), torch.device("cpu")))
    parts = [
        task.loss(task.draw(step_random(0, 1, 5, [row])), step_generator(0, 2, 5, [row], torch.device("cpu")))[0]
        for row in range(3)
    ]
    assert float(loss.detach()) == pytest.approx(float(torch.stack(parts).mean().detach()), rel=1e-3)
    for reader in readers:
        reader.close()


def test_own_windows_are_known_and_measured(clouds, tmp_path):
    """Windows of the rig's own skeleton: found by their bones, and the joints' error falls as poses come true."""
    skeleton = humanoid()
    rig = rig_of_motion(skeleton, swinging(skeleton, 9))
    with TpcReader(clouds) as reader:
        config = config_for(clouds, tmp_path)
        _, held_back = pools_of([reader], config)
        windows = held_back.draw(2, 8, np.random.default_rng(0), augment=False)
        assert not is_of_rig(windows, rig).any()
        body = rig.body
        windows.parents = torch.from_numpy(body.parents).expand(2, -1)
        windows.tails, windows.weights = body.tails.expand(2, -1, 3), body.weights.expand(2, -1)
        assert is_of_rig(windows, rig).all()
        windows.tails = windows.tails * torch.tensor([1.0, 1.1]).view(2, 1, 1)
        assert is_of_rig(windows, rig).tolist() == [True, False]


def test_sizes_are_set_whatever_was_drawn_before(clouds, tmp_path):
    with TpcReader(clouds) as reader:
        pool, _ = pools_of([reader], config_for(clouds, tmp_path))
        windows = pool.draw(4, 8, np.random.default_rng(0), augment=True)
        cloud = draw_clouds(windows, 20, (0.05, 0.05), np.random.default_rng(0), augment=True)
        size = torch.tensor([0.5, 0.9, 1.0, 1.3])
        torch.testing.assert_close(torch.linalg.det(resized(cloud, size).turn).abs().pow(1 / 3), size)


def test_the_validations_reference_is_two_draws_of_one_motion(clouds, tmp_path):
    config = config_for(clouds, tmp_path)
    with TpcReader(clouds) as reader:
        task = SkeletonTask(config, rig_of_file(RIG), *pools_of([reader], config), torch.device("cpu"))
    one, two = task.held_back, task.redrawn
    assert not torch.allclose(one.points, two.points)
    near = nearest_trajectories(one.points, two.points, one.groups, two.groups, one.valid)
    with torch.no_grad():
        assert task.validate()["reference_mm"] == pytest.approx(1000 * float(near.mean()))


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"skeleton": "stages/shared/clips/none.bvh"}, InputError, "none.bvh"),
        ({"skeleton": "stages/shared/clips/splits.json"}, InputError, "splits.json"),
        ({"tpc": ()}, UsageError, "nothing to learn from"),
        ({"size_min": 2.0}, UsageError, "size_min"),
        ({"tpc": (Path("nowhere"),)}, InputError, "nowhere"),
    ],
)
def test_refusals(clouds, tmp_path, changes, error, says):
    with pytest.raises(error, match=says):
        run(config_for(clouds, tmp_path / "net", **changes))


@pytest.mark.parametrize("preset", ["tiny", "small", "paper"])
def test_presets_have_its_settings(preset):
    (layer,) = preset_layers(preset, "train-skeleton")
    assert layer.values["steps"] > 1000
    settle_file_part(Config, [layer], what=preset)
