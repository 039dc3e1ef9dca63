"""Issue templates have what a code host needs, and name commands that exist."""

from __future__ import annotations

import re

import pytest

from pumps_cli.app import tool_words
from stages.registry import STAGES
from tests.docs.pages import ROOT

TEMPLATES = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.md"))


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.name)
def test_a_template_has_a_head_and_names_commands_that_exist(path):
    _, head, body = path.read_text().split("---\n", 2)
    assert re.findall(r"^(\w+): \S", head, re.M) == ["name", "about", "labels"]
    words = {" ".join(stage.command) for stage in STAGES} | {*tool_words()}
    assert all(each in words for each in re.findall(r"`pumps ([a-z -]+)`", body))


def test_there_are_templates_for_faults_motions_and_wishes():
    assert [path.stem for path in TEMPLATES] == ["fault", "format_or_method", "wrong_motion"]
