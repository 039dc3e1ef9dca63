"""Putting parts together: overwriting and blending connectors, parts left out, damaged checkpoints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from data_schemas.errors import InputError, UsageError
from stages.shared.inference.part_models import PartBody, load_part_body
from stages.train.body_parts.run import run as train
from tests.train.body_parts.small_parts import ingested, settings


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    motion = ingested(folder)
    train(settings(motion, folder / "5", parts=5))
    train(settings(motion, folder / "3", parts=3))
    train(settings(motion, folder / "other", parts=5, window=20))
    return folder


@pytest.fixture
def body(trained: Path) -> PartBody:
    return load_part_body(str(trained / "5"), "cpu")


def _made(body: PartBody) -> list[torch.Tensor]:
    """Columns whose every number is the part's index."""
    return [torch.full((1, 2, len(m.part.joints), 6), float(i)) for i, m in enumerate(body.parts)]


def test_the_spine_s_rotation_of_a_connector_is_kept(body: PartBody):
    joined = body.joined(_made(body))
    for index, model in enumerate(body.parts):
        assert (joined[:, :, model.part.own] == index).all()
        assert (joined[:, :, model.part.joints[: model.part.connectors]] == 0).all()


def test_blending_moves_connectors_alone(body: PartBody):
    joined = replace(body, blend=0.5).joined(_made(body))
    for index, model in enumerate(body.parts):
        if index:  # of the spine's own joints some are connectors
            assert (joined[:, :, model.part.own] == index).all()
    left_arm = body.parts[1].part
    connector = left_arm.joints[0]
    assert float(joined[0, 0, connector, 0]) not in (0.0, 1.0)


def joints_of_no_part(body: PartBody) -> list[int]:
    held = {int(joint) for each in body.parts for joint in each.part.joints}
    return [joint for joint in range(len(body.body.joints)) if joint not in held]


def test_a_part_left_out_stands_still_and_the_others_do_not_notice(body: PartBody):
    columns = torch.randn(1, 16, len(body.body.joints), 6)
    whole = body.decode(body.encode(columns))
    left = replace(body, parts=tuple(each for each in body.parts if each.part.name != "left_leg"))
    made = left.decode(left.encode(columns))
    missing = joints_of_no_part(left)
    assert set(missing) == set(body.parts[3].part.own)
    assert (made[:, :, missing] == torch.tensor([1.0, 0, 0, 0, 1, 0])).all()
    kept = [joint for joint in range(columns.shape[2]) if joint not in missing]
    assert torch.equal(made[:, :, kept], whole[:, :, kept])


def test_parts_of_two_decompositions_make_one_body(trained: Path):
    source = f"{trained / '3'}:arms+{trained / '3'}:spine+{trained / '5'}:left_leg+{trained / '5'}:right_leg"
    body = load_part_body(source, "cpu")
    assert [model.part.name for model in body.parts] == ["spine", "arms", "left_leg", "right_leg"]
    assert not joints_of_no_part(body) and len(body.inputs) == 4


def test_what_cannot_be_put_together_is_refused(trained: Path, body: PartBody):
    with pytest.raises(UsageError, match="two models of one joint, in arms and left_arm"):
        load_part_body(f"{trained / '3'}:arms+{trained / '5'}:left_arm", "cpu")
    with pytest.raises(InputError, match="windows of 16 and 20 frames"):
        load_part_body(f"{trained / '5'}:spine+{trained / 'other'}:left_arm", "cpu")
