"""An unfinished training marks the folder of its files; a person's own NAME.partial is refused and kept."""

from __future__ import annotations

import pytest

from data_schemas.artefact import open_artefact, partial_folder
from data_schemas.errors import UsageError
from data_schemas.own_folders import MARKER_NAME, is_own_folder
from stages.train.ae.config import Config
from stages.train.ae.run import run
from tests.shared.training.small_trainings import KillAt, Killed
from tests.shared.training.tiny_clouds import write_clouds
from tests.shared.training.tiny_runs import TINY


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    return write_clouds(tmp_path_factory.mktemp("clouds") / "tpc")


def test_a_persons_folder_is_refused_and_kept(clouds, tmp_path):
    partial = partial_folder(tmp_path / "ae")
    partial.mkdir()
    (partial / "thesis.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"ae\.partial has a name that pumps uses"):
        run(Config(tpc=clouds, output=tmp_path / "ae", **TINY))
    assert [each.name for each in partial.iterdir()] == ["thesis.txt"] and not (tmp_path / "ae").exists()
    partial.rename(tmp_path / "mine")
    run(Config(tpc=clouds, output=tmp_path / "ae", **TINY))
    assert not partial.exists() and open_artefact(tmp_path / "ae")


def test_a_folder_that_was_set_aside_by_a_person_is_kept(clouds, tmp_path):
    with pytest.raises(Killed):
        run(Config(tpc=clouds, output=tmp_path / "ae", **TINY), progress=KillAt(4))
    aside = tmp_path / "ae.set-aside"
    aside.mkdir()
    (aside / "thesis.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"ae\.set-aside has a name"):
        run(Config(tpc=clouds, output=tmp_path / "ae", **{**TINY, "seed": 99}))
    assert (aside / "thesis.txt").read_text() == "mine" and is_own_folder(partial_folder(tmp_path / "ae"))


def test_a_folder_of_an_older_pumps_is_taken_over(clouds, tmp_path):
    with pytest.raises(Killed):
        run(Config(tpc=clouds, output=tmp_path / "ae", **TINY), progress=KillAt(4))
    partial = partial_folder(tmp_path / "ae")
    (partial / MARKER_NAME).unlink()
    run(Config(tpc=clouds, output=tmp_path / "ae", **TINY))
    assert not partial.exists()
