"""The command on a page repeats what was done: its own parser reads the same settings from it."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from pumps_cli import stage_command
from pumps_cli.app import main
from stages.segment.config import Config
from stages.shared.contract import StageReport
from stages.shared.settings.command_line import command_line


def test_a_command_with_an_argument_and_a_setting_named_like_a_keyword(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    config = Config(input=tmp_path / "my clips", output=tmp_path / "out", lambda_=400.0, cluster="kmeans")
    line = command_line("pumps segment", config, arguments=("input",))
    seen = []

    def runner(stage: object):
        return lambda given, *, progress: seen.append(given) or StageReport()

    monkeypatch.setattr(stage_command.Stage, "runner", runner)
    with pytest.raises(SystemExit) as leaving:
        main(shlex.split(line)[1:])
    assert leaving.value.code in (None, 0)
    assert seen == [config]
