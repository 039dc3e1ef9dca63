"""The pages say what is true: every command in them can be typed, tables match the code, links lead somewhere.

That the commands also do what they say is shown by tests/pipeline/test_end_to_end.py, which runs them.
"""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path

import pytest
from accelerate.commands.launch import launch_command_parser
from torch.distributed.run import get_args_parser as torchrun_parser

from pumps_cli import stage_command
from pumps_cli.app import main
from stages.registry import STAGES
from stages.shared.contract import StageReport
from tests.docs.pages import PAGES, ROOT, blocks, commands, launchers

SHELL = [pytest.param(line, id=f"{page.name}: {line[:60]}") for page, line in commands()]


@pytest.mark.parametrize("line", [each for each in SHELL if each.values[0].startswith("pumps ")])
def test_every_pumps_command_is_understood(line: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Stages are not run here; tools are, in an empty folder, where what they read may be missing (3)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stage_command.Stage, "runner", lambda stage: lambda config, *, progress: StageReport())
    with pytest.raises(SystemExit) as leaving:
        main(shlex.split(line)[1:])
    tool = not any(line.split()[1] == stage.command[0] for stage in STAGES)
    assert leaving.value.code in ((None, 0, 3) if tool else (None, 0))


@pytest.mark.parametrize("line", [each for each in SHELL if each.values[0].startswith("make ")])
def test_every_make_target_and_variable_exists(line: str):
    text = (ROOT / "Makefile").read_text() + (ROOT / "tables.mk").read_text()
    phony = re.search(r"^\.PHONY: (.*)$", text, re.M)
    assert phony
    targets = phony[1].split()
    variables = {each for each in re.findall(r"[A-Z][A-Z0-9_]*", text) if f"$({each}" in text or f"{each} ?=" in text}
    for word in shlex.split(line)[1:]:
        name, given, _ = word.partition("=")
        assert name in (variables if given else targets) or name.startswith("-j"), word


def test_launchers_flags_are_theirs():
    parsers = {"torchrun": torchrun_parser, "accelerate launch": launch_command_parser}
    shown = launchers()
    assert {program for program, _ in shown} == set(parsers)
    for program, flags in shown:
        parsers[program]().parse_args([*flags, "script"])


def test_no_other_programs_are_shown():
    assert {line.split()[0] for _, line in commands()} <= {"pumps", "make"}


def test_the_table_of_commands_is_the_registry():
    expected = [
        f"| `{' '.join(('pumps', *s.command))}` | {', '.join(s.reads)} | {s.writes} | {s.summary} |" for s in STAGES
    ]
    shown = [line for line in (ROOT / "docs" / "commands.md").read_text().splitlines() if line.startswith("| `pumps")]
    assert shown == expected


@pytest.mark.parametrize("method", ["damped", "small-free"])
def test_the_readme_says_what_the_results_say(method: str):
    """Shares of slerp's L2P over all archives that the default weights never saw."""
    name = "weights small-free on what it never saw, by archive"
    table = (ROOT / "docs" / "results.md").read_text().partition(f"<!-- {name}: begin -->")[2].partition("<!--")[0]
    all_archives = table.partition("| all archives |")[2].partition("L2P as a share of that of zero-velocity")[0]
    row = next(line for line in all_archives.splitlines() if f"| {method} |" in line)
    shares = [cell.split()[0] for cell in row.partition(f"| {method} |")[2].strip(" |").split("|")]
    readme = (ROOT / "README.md").read_text().splitlines()
    shown = next(line for line in readme if f"`{method}`)" in line and "| 0." in line)
    assert [cell.strip() for cell in shown.strip(" |").split("|")[1:]] == shares


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_to_files_lead_somewhere(page: Path):
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target


def _anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as code hosts make them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_to_headings_lead_to_one(page: Path):
    for target, anchor in re.findall(r"\]\(([\w./-]*\.md)?#([^)]+)\)", page.read_text()):
        assert anchor in _anchors(page.parent / target if target else page), f"{target}#{anchor}"


@pytest.mark.parametrize(("page", "code"), blocks("python"))
def test_python_in_the_pages_is_python(page: Path, code: str):
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("stages", "data_schemas")):
            module = ROOT / (node.module or "").replace(".", "/")
            assert module.with_suffix(".py").exists() or module.is_dir(), f"{page.name}: {node.module}"
