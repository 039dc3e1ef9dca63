"""`pumps train concepts` and `pumps refine` on embedded clips: small networks, whole paths, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import read_checkpoint
from data_schemas.errors import InputError, UsageError
from data_schemas.motion import ClipRow, MotionWriter
from stages.refine.config import Config
from stages.refine.run import run
from stages.shared.concepts.body_positions import body_of, body_positions
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.inference.refining import judged, load_concepts, refine, sampled_transition

pytest.importorskip("sklearn")
from stages.segment.config import Config as SegmentConfig
from stages.segment.run import run as segment
from stages.train.concepts.config import Config as TrainConfig
from stages.train.concepts.run import run as train

CLIPS = Path(__file__).resolve().parents[2] / "stages" / "shared" / "clips"


def read(name: str):
    return motion_of(read_bvh((CLIPS / f"{name}.bvh").read_bytes(), name))


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("concepts")
    with (
        write_artefact(folder / "m", "motion", stage="test", config={}) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for name, action in (("dance_a", "dance"), ("dance_b", "dance"), ("kick", "kick"), ("spinkick", "kick")):
            skeleton, motion, _ = read(name)
            row = ClipRow(
                clip=name, source=f"set.zip!dataset-1_{action}_a_001.bvh", sha256="0" * 64,
                skeleton=writer.add_skeleton(skeleton), frames=motion.frames, fps=motion.fps,
                seconds=motion.frames / motion.fps, split="train", licence="CC0",
            )  # fmt: skip
            writer.add_clip(row, motion)
        draft.licences.add("CC0")
    segment(SegmentConfig(input=folder / "m", output=folder / "c", fps=20, cluster="kmeans"))
    train(
        TrainConfig(
            concepts=folder / "c", output=folder / "w", steps=4, batch=4, window=24, width=16, latent=4, warmup=1,
            validate_every=2, checkpoint_every=2, device="cpu",
        )
    )  # fmt: skip
    return folder / "w"


def test_the_checkpoint_says_what_it_knows(weights: Path):
    stored = read_checkpoint(weights)
    assert stored.config["actions"] == ["dance", "kick"] and stored.config["fps"] == 20
    assert {row["split"] for row in stored.log} == {"train", "val"}
    assert "CC0" in stored.card


@pytest.mark.parametrize("only", [None, "anchors", "transitions"])
def test_a_motion_comes_back_on_its_rig(weights: Path, tmp_path: Path, only: str | None):
    out, table = tmp_path / "out.bvh", tmp_path / "t.csv"
    report = run(
        Config(
            input=CLIPS / "kick.bvh", output=out, action="kick", weights=weights, table=table, only=only, device="cpu"
        )  # pyright: ignore[reportArgumentType]
    )
    before, after = (read_bvh(path.read_bytes(), path.name) for path in (CLIPS / "kick.bvh", out))
    assert [j.name for j in before.joints] == [j.name for j in after.joints] and before.frames == after.frames
    assert np.isfinite(after.values).all()
    rows = report.figures["anchors"]
    assert rows[0]["frame"] == 0 and report.figures["flawed"] == sum(row["flawed"] for row in rows)
    assert len(table.read_text().splitlines()) == len(rows) + 1


def test_anchors_that_are_not_flawed_and_their_transitions_stay(weights: Path):
    """With --only anchors, frames beside no flawed anchor are the given ones, to the bit."""
    model = load_concepts(weights, "cpu")
    skeleton, motion, _ = read("dance_a")
    body = body_of(skeleton)
    given = body_positions(skeleton, motion, body)[:120] * body.scale
    found = refine(model, given, "dance", only="anchors")
    touched = np.zeros(len(given), bool)
    for at in np.flatnonzero(found.flawed):
        low, high = found.anchors[max(at - 1, 0)], found.anchors[min(at + 1, len(found.anchors) - 1)]
        touched[low : high + 1] = True
    np.testing.assert_array_equal(found.positions[~touched], given[~touched])
    same = refine(model, given, "dance", only="anchors")
    np.testing.assert_array_equal(found.positions, same.positions)


def test_place_and_heading_do_not_change_the_judgement(weights: Path):
    from stages.shared.kinematics.rotations import turned_about_y

    model = load_concepts(weights, "cpu")
    skeleton, motion, _ = read("kick")
    body = body_of(skeleton)
    given = body_positions(skeleton, motion, body) * body.scale
    moved = turned_about_y(given, np.asarray(0.8)) + np.array([5.0, 0.0, -3.0])
    one, two = judged(model, given, 1), judged(model, moved, 1)
    np.testing.assert_array_equal(one[0], two[0])
    np.testing.assert_allclose(one[1], two[1], atol=0.05)
    a, b = (refine(model, each, "kick").positions for each in (given, moved))
    np.testing.assert_allclose(turned_about_y(a, np.asarray(0.8)) + np.array([5.0, 0.0, -3.0]), b, atol=2e-3)


def test_sampled_transitions_meet_their_anchors_and_differ(weights: Path):
    import torch

    model = load_concepts(weights, "cpu")
    skeleton, motion, _ = read("kick")
    body = body_of(skeleton)
    given = body_positions(skeleton, motion, body) * body.scale
    samples = [
        sampled_transition(model, given[0], given[12], 12, torch.Generator().manual_seed(seed)) for seed in (0, 1)
    ]
    for sample in samples:
        np.testing.assert_allclose(sample[[0, -1]], given[[0, 12]], atol=1e-9)
    assert np.abs(samples[0] - samples[1]).max() > 1e-6


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"action": "swim"}, UsageError, "dance, kick"),
        ({"input": "short"}, InputError, "are the fewest"),
        ({"input": "rig"}, InputError, "another rig"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_is_lost(
    weights: Path, tmp_path: Path, settings: dict, error: type, words: str
):
    out = tmp_path / "out.bvh"
    out.write_text("old")
    if settings.get("input") == "short":
        text = (CLIPS / "kick.bvh").read_text().splitlines()
        at = next(i for i, line in enumerate(text) if line.startswith("Frames:"))
        (tmp_path / "short.bvh").write_text("\n".join([*text[:at], "Frames: 5", *text[at + 1 : at + 7]]) + "\n")
        settings = {"input": tmp_path / "short.bvh"}
    elif settings.get("input") == "rig":
        settings = {"input": CLIPS.parents[2] / "docs" / "examples" / "other_rig.bvh"}
    given = {"input": CLIPS / "kick.bvh", "action": "kick", "weights": weights, "output": out, "overwrite": True}
    with pytest.raises(error, match=words):
        run(Config(**{**given, **settings}, device="cpu"))
    assert out.read_text() == "old"


def train_as(weights: Path, output: Path, method: str) -> Path:
    train(
        TrainConfig(
            concepts=weights.parent / "c", output=output, steps=3, batch=4, window=24, width=16, latent=4, warmup=1,
            validate_every=3, checkpoint_every=3, device="cpu", method=method,
        )  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    return output


def test_transitions_that_are_no_splines_refine_too(weights: Path, tmp_path: Path):
    """The checkpoint says what it is, and holds other networks than one of splines."""
    other = train_as(weights, tmp_path / "w", "frames")
    one, two = (read_checkpoint(each) for each in (weights, other))
    assert (one.config["settings"]["method"], two.config["settings"]["method"]) == ("splines", "frames")
    shapes = [{name: value.shape for name, value in each.weights.items()} for each in (one, two)]
    assert shapes[0].keys() == shapes[1].keys() and shapes[0] != shapes[1]
    given = {"input": CLIPS / "kick.bvh", "action": "kick", "device": "cpu"}
    for folder, name in ((weights, "a"), (other, "b")):
        run(Config(**given, weights=folder, output=tmp_path / f"{name}.bvh"))
    made = [read_bvh((tmp_path / f"{name}.bvh").read_bytes(), name).values for name in "ab"]
    assert np.isfinite(made[1]).all() and not np.array_equal(*made)


def test_reconstruction_refines_whole_motions_and_knows_no_concepts(weights: Path, tmp_path: Path):
    other = train_as(weights, tmp_path / "w", "reconstruction")
    stored = read_checkpoint(other)
    assert "anchor_limit" not in stored.config and not any(name.startswith("quality/") for name in stored.weights)
    given = {"input": CLIPS / "kick.bvh", "action": "kick", "weights": other, "device": "cpu"}
    report = run(Config(**given, output=tmp_path / "out.bvh"))
    assert report.figures["flawed"] == 0 and len(report.figures["anchors"]) == 2
    with pytest.raises(UsageError, match="--only anchors needs concepts"):
        run(Config(**given, output=tmp_path / "no.bvh", only="anchors"))
    assert not (tmp_path / "no.bvh").exists()
    with pytest.raises(UsageError, match="hold no concepts"):
        judged(load_concepts(other, "cpu"), np.zeros((20, 4, 3)), 0)


def test_the_limit_of_anchors_is_chosen_by_the_training(weights: Path):
    """Held-back clips, here the training clips, then have as many anchors as they were segmented into, or as many as
    the lowest limit finds; all chances of this network lie under 0.5."""
    from data_schemas.concepts import ConceptsReader
    from stages.shared.concepts.sequences import concept_set

    model = load_concepts(weights, "cpu")
    assert model.anchor_limit == read_checkpoint(weights).config["anchor_limit"]
    with ConceptsReader(weights.parent / "c") as reader:
        found = concept_set(reader)
    clips = found.of("train")
    anchors = [len(judged(model, each.positions.astype(np.float64), each.action)[0]) for each in clips]
    assert sum(anchors) > 2 * len(clips) and 0.01 <= model.anchor_limit < 0.5
    assert sum(anchors) >= sum(len(each.anchors) for each in clips) or model.anchor_limit == 0.01


def test_a_batch_without_a_known_concept_has_a_finite_loss(weights: Path):
    """Windows whose masked anchors are all first or last frames, which need not be anchors of the clip."""
    import torch

    from data_schemas.concepts import ConceptsReader
    from stages.shared.concepts.sequences import concept_set
    from stages.shared.networks.layers.row_generator import row_generator
    from stages.train.concepts.run import new_networks
    from stages.train.concepts.task import ConceptTask

    config = TrainConfig(concepts=weights.parent / "c", output=weights, window=24, width=16, latent=4, device="cpu")
    with ConceptsReader(config.concepts) as reader:
        found = concept_set(reader)
    task = ConceptTask(config, new_networks(found, 16, 4), found, torch.device("cpu"))
    batch = task.held_back
    unknown = type(batch)(**{**vars(batch), "concept": torch.full_like(batch.concept, -1)})
    value, _ = task.loss(unknown, row_generator(0, [1] * len(batch.motion), torch.device("cpu")))
    value.backward()
    assert torch.isfinite(value)
    assert all(torch.isfinite(p.grad).all() for p in task.networks.parameters() if p.grad is not None)


def test_an_artefact_is_refined_clip_by_clip_with_its_page(weights: Path, tmp_path: Path):
    """Each clip by its own action; a clip of an unknown action stays, to the bit."""
    from data_schemas.motion import MotionReader

    with (
        MotionReader(weights.parent / "m") as reader,
        write_artefact(tmp_path / "in", "motion", stage="test", config={}) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        for row in reader.clips[:3]:
            writer.add_skeleton(reader.skeleton(row.skeleton))
            source = "swim.bvh" if row.clip == "dance_b" else row.source
            writer.add_clip(ClipRow(**{**vars(row), "source": source}), reader.motion(row.clip))
    out, page, table = tmp_path / "out", tmp_path / "p.html", tmp_path / "t.csv"
    report = run(Config(input=tmp_path / "in", output=out, weights=weights, page=page, table=table, device="cpu"))
    assert report.figures["clips"] == 2 and report.figures["left"] == 1
    assert any("dance_b is left as it is" in line for line in report.lines)
    with MotionReader(tmp_path / "in") as before, MotionReader(out) as after:
        assert [row.clip for row in after.clips] == ["dance_a", "dance_b", "kick"]
        for clip, same in (("dance_a", False), ("dance_b", True), ("kick", False)):
            one, two = before.motion(clip), after.motion(clip)
            assert one.frames == two.frames and np.array_equal(one.rotations, two.rotations) == same
    assert len(table.read_text().splitlines()) == report.figures["anchors"] + 1
    text = page.read_text()
    assert text.count("<h2>") == 2 and "&lt;" not in text.split("<pre>")[0] and "<script" not in text


def test_an_artefact_of_which_no_clip_is_refined_is_refused(weights: Path, tmp_path: Path):
    with write_artefact(tmp_path / "in", "motion", stage="test", config={}) as draft, MotionWriter(draft.folder):
        pass
    with pytest.raises(UsageError, match=r"was refined\. It holds none"):
        run(Config(input=tmp_path / "in", output=tmp_path / "out", weights=weights, device="cpu"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [{"fps_override": 30.0}, {"skeleton_map": Path("map.toml")}])
def test_an_artefact_takes_no_options_of_files(weights: Path, tmp_path: Path, options: dict):
    with pytest.raises(UsageError, match="is for files"):
        run(Config(input=weights.parent / "m", output=tmp_path / "out", weights=weights, device="cpu", **options))
    assert not (tmp_path / "out").exists()


def test_a_file_needs_an_action(weights: Path, tmp_path: Path):
    with pytest.raises(UsageError, match="does not say its action"):
        run(Config(input=CLIPS / "kick.bvh", output=tmp_path / "o.bvh", weights=weights, device="cpu"))
    assert not (tmp_path / "o.bvh").exists()
