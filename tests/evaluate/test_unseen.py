"""What `--unseen` measures: a training writes what it was trained on, and evaluation reads that."""

from pathlib import Path

import pytest

from data_schemas.artefact import write_artefact
from data_schemas.errors import InputError
from data_schemas.metrics import read_metrics
from data_schemas.motion import ClipRow, MotionWriter
from stages.evaluate.config import Config
from stages.evaluate.run import run
from stages.sample_tpc.config import Config as SampleConfig
from stages.sample_tpc.run import run as sample
from stages.train.ae.config import Config as AutoencoderConfig
from stages.train.ae.run import run as train_autoencoder
from stages.train.lms.config import Config as SynthesiserConfig
from stages.train.lms.run import run as train_synthesiser
from tests.evaluate.swaying import skeleton, swaying
from tests.shared.training.tiny_runs import TINY

TRAINED = "data/walks, slow.zip!a/walk.bvh"
ONE_STEP = {**TINY, "steps": 1, "validate_every": 1, "checkpoint_every": 1}
SIZES = {"width": 16, "heads": 2, "key_layers": 1, "fill_layers": 1, "frame_layers": 1}


def write_motions(path: Path, sources: dict[str, str]) -> Path:
    """A motion artefact with one clip of 8 seconds for each source, and the split it is in."""
    with (
        write_artefact(path, "motion", stage="ingest", config={}, licences=["CC0"]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        name = writer.add_skeleton(skeleton())
        for seed, (source, split) in enumerate(sources.items()):
            clip = source.replace("!", "/").rsplit("/", 1)[-1].removesuffix(".bvh")
            row = ClipRow(clip, source, f"{seed:064x}", name, 240, 30.0, 8.0, split, "CC0")
            writer.add_clip(row, swaying(seed, 240))
    return path


def train(motions: Path, folder: Path) -> Path:
    """Weights of one step, trained on the training clips of `motions`."""
    tpc, ae, lms = folder / "tpc", folder / "train-ae", folder / "train-lms"
    sample(SampleConfig(motion=motions, output=tpc, points=24))
    train_autoencoder(AutoencoderConfig(tpc=tpc, output=ae, **ONE_STEP))
    synthesiser = {name: value for name, value in ONE_STEP.items() if name not in ("encoder", "decoder")}
    train_synthesiser(
        SynthesiserConfig(tpc=tpc, ae=ae, output=lms, **{**synthesiser, "window": 24}, synthesiser=SIZES)
    )
    return folder


def unseen_clips(motions: Path, weights: Path) -> set[str]:
    """The clips that `pumps evaluate --unseen` measures."""
    output = weights / "metrics"
    only = {"tasks": ("interpolation",), "intervals": (30,), "points": 24, "max_windows": 1, "unseen": True}
    run(Config(motion=motions, output=output, weights=(f"mine={weights}",), **only))
    return {row.clip for row in read_metrics(output)[0]}


def test_an_archive_with_a_comma_in_its_name_is_known_as_trained_on(tmp_path: Path) -> None:
    sources = {TRAINED: "train", "data/walks, slow.zip!a/held_back.bvh": "test", "data/slow.zip!other.bvh": "test"}
    weights = train(write_motions(tmp_path / "learnt", {TRAINED: "train"}), tmp_path / "run")
    assert unseen_clips(write_motions(tmp_path / "measured", sources), weights) == {"other"}


def test_a_copy_of_the_archive_in_another_folder_is_known_too(tmp_path: Path) -> None:
    weights = train(write_motions(tmp_path / "learnt", {TRAINED: "train"}), tmp_path / "run")
    with pytest.raises(InputError, match="trained on clips of every archive"):
        unseen_clips(write_motions(tmp_path / "measured", {"elsewhere/walks, slow.zip!walk.bvh": "test"}), weights)
