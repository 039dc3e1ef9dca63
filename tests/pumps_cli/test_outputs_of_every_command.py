"""Every command that writes refuses an output that exists, and an input of its own even with --overwrite."""

from __future__ import annotations

from pathlib import Path

import pytest

from data_schemas.errors import UsageError
from stages.export.config import Config as ExportConfig
from stages.export.run import run as export
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.registry import STAGES
from stages.report.config import Config as ReportConfig
from stages.report.run import run as report
from stages.retarget.config import Config as RetargetConfig
from stages.retarget.run import run as retarget
from stages.shared.contract import WritingConfig
from tests.shared.formats.bvh_texts import BvhText


def test_every_stage_with_an_output_has_the_rule() -> None:
    """What a stage writes is a field `output`; its Config is one that the rule is for."""
    for stage in STAGES:
        if "output" in stage.config_type().model_fields:
            assert issubclass(stage.config_type(), WritingConfig), stage.name


def test_a_report_asks_and_keeps_its_inputs(tmp_path: Path) -> None:
    motion = tmp_path / "walk.html"  # the page's own suffix, so that the name alone would be taken
    motion.write_bytes(BvhText(frames=20).data())
    link = tmp_path / "other.html"
    link.hardlink_to(motion)
    before = motion.read_bytes()
    for output in (motion, link):
        with pytest.raises(UsageError, match="given as motions too"):
            report(ReportConfig(motions=(f"scene/truth={motion}",), output=output, overwrite=True))
    page = tmp_path / "page.html"
    page.write_text("mine")
    with pytest.raises(UsageError, match=r"page\.html exists\. Give --overwrite"):
        report(ReportConfig(motions=(f"truth={motion}",), output=page))
    assert motion.read_bytes() == before and page.read_text() == "mine"


def test_a_folder_named_for_a_file_is_named_as_a_folder(tmp_path: Path) -> None:
    (tmp_path / "walk.bvh").write_bytes(BvhText(frames=8).data())
    walk = tmp_path / "walk.bvh"
    for overwrite in (False, True):
        with pytest.raises(UsageError, match="is a folder"):
            retarget(RetargetConfig(input=walk, to=walk, output=tmp_path, overwrite=overwrite))


def test_an_export_keeps_the_data_of_its_artefact(tmp_path: Path) -> None:
    (tmp_path / "walk.bvh").write_bytes(BvhText(frames=8).data())
    ingest(IngestConfig(sources=(str(tmp_path / "walk.bvh"),), output=tmp_path / "motion", licence="CC0", workers=1))
    (part,) = (tmp_path / "motion").glob("data-*/clips.parquet")
    before = part.read_bytes()
    with pytest.raises(UsageError, match="must not be replaced"):
        export(ExportConfig(input=str(tmp_path / "motion"), output=part, overwrite=True))
    assert part.read_bytes() == before


def test_an_export_keeps_the_body_models_it_reads(tmp_path: Path) -> None:
    walk, models = tmp_path / "walk.bvh", tmp_path / "models"
    walk.write_bytes(BvhText(frames=8).data())
    models.mkdir()
    (models / "SMPL_MALE.npz").write_bytes(b"a model")
    output = models / "SMPL_MALE.npz"
    with pytest.raises(UsageError, match="given as body-models too"):
        export(ExportConfig(input=str(walk), output=output, body_models=models, overwrite=True))
    assert output.read_bytes() == b"a model"
