"""A body with four arms: a BVH that is read back with all joints, arms that move by themselves, bad recipes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from data_schemas.errors import InputError
from stages.body_parts.compose.config import Config
from stages.body_parts.compose.limbs import AddedLimb, body_with_limbs
from stages.body_parts.compose.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.rig_file import rig_of_file
from stages.shared.humanoid.body_parts import body_part
from stages.shared.humanoid.clips_on_rig import body_joints_of
from stages.shared.kinematics.forward import positions_of
from stages.train.body_parts.run import run as train
from tests.train.body_parts.small_parts import CLIPS, ingested, settings


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("composed")
    motion = ingested(folder)
    train(settings(motion, folder / "ae"))
    train(settings(motion, folder / "vae", network="vae"))
    return folder


def _recipe(folder: Path, trained: Path, limbs: str = "", motion: str = "walk") -> Path:
    path = folder / "body.toml"
    text = f'weights = "{trained / "ae"}"\nmotion = "{CLIPS / motion}.bvh"\n{limbs}'
    path.write_text(text)
    return path


def _arm(trained: Path, side: str, more: str = "") -> str:
    return f'[[limbs]]\npart = "{side}_arm"\nweights = "{trained / "vae"}"\noffset_m = [0.0, -0.2, 0.0]\n{more}\n'


def test_a_body_with_four_arms_is_written_as_bvh_and_glb(trained: Path, tmp_path: Path):
    limbs = _arm(trained, "left", "noise = 0.5") + _arm(trained, "right", f'motion = "{CLIPS / "kick.bvh"}"')
    recipe = _recipe(tmp_path, trained, limbs)
    for name in ("four.bvh", "four.glb"):
        picture = tmp_path / f"{name}.svg"
        report = run(Config(recipe=recipe, output=tmp_path / name, picture=picture, device="cpu"))
        assert picture.read_text().count("#17a2c2") == 5 * 4  # five frames of four joints
        assert report.figures["limbs"] == ["left_arm second", "right_arm second"]
    made = read_bvh((tmp_path / "four.bvh").read_bytes(), "four.bvh")
    plain = read_bvh((CLIPS / "walk.bvh").read_bytes(), "walk.bvh")
    second = [joint.name for joint in made.joints if joint.name.endswith("_second")]
    assert len(second) == 4 and len(made.joints) == len(plain.joints) + 4
    assert (tmp_path / "four.glb").read_bytes()[:4] == b"glTF"


def test_an_added_limb_with_the_body_s_own_rotations_moves_beside_it():
    rig = rig_of_file(str(CLIPS / "walk.bvh"))
    body = body_joints_of(rig.skeleton, 1.6)
    generator = np.random.default_rng(3)
    local = generator.normal(size=(5, len(body.joints), 4)).astype(np.float32)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    pelvis = generator.normal(size=(5, 3))
    part = body_part("left_arm", body.parents, body.groups)
    limb = AddedLimb(part, "second", (0.0, 0.0, 0.0), local[:, part.joints])
    skeleton, motion = body_with_limbs(body, local, pelvis, [limb], 30.0)
    places = dict(zip(skeleton.names, positions_of(skeleton, motion).swapaxes(0, 1), strict=True))
    np.testing.assert_allclose(places[skeleton.names[skeleton.root]], pelvis, atol=1e-5)
    for joint in part.own:
        name = rig.skeleton.names[body.joints[joint]]
        np.testing.assert_allclose(places[f"{name}_second"], places[name], atol=1e-5)
    moved = AddedLimb(part, "second", (0.0, -0.2, 0.0), local[:, part.joints])
    skeleton, motion = body_with_limbs(body, local, pelvis, [moved], 30.0)
    places = dict(zip(skeleton.names, positions_of(skeleton, motion).swapaxes(0, 1), strict=True))
    name = rig.skeleton.names[body.joints[part.own[-1]]]
    apart = np.linalg.norm(places[f"{name}_second"] - places[name], axis=1)
    np.testing.assert_allclose(apart, 0.2, atol=1e-5)


def test_latent_noise_moves_the_added_limb_alone(trained: Path, tmp_path: Path):
    rows = []
    for noise in ("0.0", "2.0"):
        output = tmp_path / f"{noise}.bvh"
        recipe = _recipe(tmp_path, trained, _arm(trained, "left", f"noise = {noise}"))
        run(Config(recipe=recipe, output=output, device="cpu"))
        rows.append(read_bvh(output.read_bytes(), output.name))
    first, second = (torch.from_numpy(np.asarray(each.values)) for each in rows)
    changed = (first != second).any(dim=0)
    columns = [joint.name for joint in rows[0].joints for _ in joint.channels]
    assert {name for name, is_changed in zip(columns, changed.tolist(), strict=True) if is_changed} <= {
        joint.name for joint in rows[0].joints if joint.name.endswith("_second")
    }
    assert changed.any()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("limb = 1", "limb: Extra inputs"),
        ('[[limbs]]\npart = "spine"\nweights = "x"', "must be one of lower, arms, legs"),
        ("= 1", "TOML"),
    ],
)
def test_a_bad_recipe_is_refused_in_one_sentence(trained: Path, tmp_path: Path, text: str, words: str):
    with pytest.raises(InputError, match=words):
        run(Config(recipe=_recipe(tmp_path, trained, text), output=tmp_path / "out.bvh"))
    assert not (tmp_path / "out.bvh").exists()
