"""Artefacts of older versions are read as today's; they are never changed."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from data_schemas import migrations
from data_schemas.artefact import open_artefact, verify, write_artefact
from data_schemas.errors import InputError
from data_schemas.kinds import KINDS
from data_schemas.metrics import MetricRow, read_metrics, write_metrics
from data_schemas.motion import MotionReader
from data_schemas.source_table import read_sources
from tests.data_schemas.examples import a_motion, a_skeleton, write_motion

FROZEN = Path(__file__).parent / "frozen" / "motion_version_0"  # its clips.parquet has no `flags`


def test_every_older_version_has_a_way_to_today():
    for (kind, version), step in migrations.MIGRATIONS.items():
        assert callable(step)
        for later in range(version, KINDS[kind].schema_version):
            assert (kind, later) in migrations.MIGRATIONS


def test_the_changelog_names_every_migration():
    changelog = (Path(__file__).parents[2] / "CHANGELOG.md").read_text()
    listed = re.findall(r"^ *\| (\w+) \| (\d+) \| (\d+) \|", changelog, re.M)
    assert [(kind, int(old), int(new)) for kind, old, new in listed] == [
        (kind, version, version + 1) for kind, version in migrations.MIGRATIONS
    ]


def test_frozen_motion_of_version_0_is_read():
    artefact = open_artefact(FROZEN, "motion")
    assert artefact.manifest.schema_version == 0
    with MotionReader(artefact) as reader:
        assert [(row.clip, row.frames, row.split, row.flags) for row in reader.clips] == [("walk", 4, "train", "")]
        motion = reader.motion("walk")
        assert reader.skeleton(reader.clips[0].skeleton).names == a_skeleton().names
    np.testing.assert_allclose(motion.rotations, a_motion(4).rotations, atol=1e-6)
    np.testing.assert_allclose(motion.tracks, a_motion(4).tracks, atol=1e-6)
    assert verify(FROZEN) == []  # reading changes nothing


def test_frozen_motion_of_version_2_is_read():
    folder = FROZEN.with_name("motion_version_2")  # its sources.parquet has no `flags`
    assert open_artefact(folder, "motion").manifest.schema_version == 2
    with MotionReader(folder) as reader:
        assert {row.clip: row.flags for row in reader.clips} == {
            "clips.plain": "", "clips.trimmed": "fps-override trimmed",
        }  # fmt: skip
        sources = read_sources(reader.folder)
    assert [(row.outcome, row.flags) for row in sources] == [("kept", ""), ("repaired", "")]
    assert "calibration pose" in sources[1].reason
    assert verify(folder) == []


def test_velocity_jumps_of_version_1_become_metres_a_second(tmp_path, monkeypatch):
    rows = [
        MetricRow("c", "s", "a", "slerp", "interpolation", 15, metric, value)
        for metric, value in (("l2p_m", 0.5), ("key_jump_mm", 20.0))
    ]
    with monkeypatch.context() as then:
        then.setitem(KINDS, "metrics", KINDS["metrics"]._replace(schema_version=1))
        with write_artefact(tmp_path / "m", "metrics", stage="evaluate", config={}) as draft:
            write_metrics(draft.folder, rows, "# Evaluation\n")
    found, summary = read_metrics(tmp_path / "m")
    assert [(row.metric, row.value) for row in found] == [("l2p_m", 0.5), ("key_jump_mps", pytest.approx(0.6))]
    assert summary == "# Evaluation\n"


def test_scratch_of_a_migration_goes_with_the_reader():
    reader = MotionReader(FROZEN)
    folder = reader.folder
    assert folder.is_dir() and folder != reader.artefact.folder
    reader.close()
    assert not folder.exists()


def test_copies_where_links_cannot_be_made(monkeypatch):
    def refuse(*arguments):
        raise OSError("no links here")

    monkeypatch.setattr("os.symlink", refuse)
    with MotionReader(FROZEN) as reader:
        assert reader.motion("walk").frames == 4


@pytest.mark.parametrize("version", [-1, -(10**6)])
def test_a_version_without_a_way_is_refused(tmp_path, version):
    write_motion(tmp_path / "m")
    manifest = json.loads((tmp_path / "m" / "manifest.json").read_text())
    (tmp_path / "m" / "manifest.json").write_text(json.dumps({**manifest, "schema_version": version}))
    with pytest.raises(InputError, match=f"version {version}, which pumps no longer reads"):
        MotionReader(tmp_path / "m")


def test_damage_found_on_the_way_is_an_input_error(tmp_path):
    shutil.copytree(FROZEN, tmp_path / "m")
    artefact = open_artefact(tmp_path / "m")
    artefact.file("clips.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match="data of version 0 cannot be read"):
        MotionReader(tmp_path / "m")
