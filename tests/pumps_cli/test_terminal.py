"""What reaches a terminal, and what a closed, full or unread stdout and an early interrupt mean."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from data_schemas.artefact import write_artefact
from data_schemas.metrics import MetricRow, write_metrics
from pumps_cli.terminal import visible
from tests.shared.formats.bvh_texts import BvhText

ROOT = Path(__file__).resolve().parents[2]
STEERING = "\x1b]0;owned\x07\x1b[2J\x9b31m\x7f\u202e\u2066\u2028"
CONTROLS = {each for each in STEERING if not each.isprintable()}


def pumps(words: str, *, shell: str = "{}", **env: str) -> subprocess.CompletedProcess[bytes]:
    """`pumps WORDS` in a shell's line; the exit code is that of `pumps`."""
    line = shell.format(f"'{sys.executable}' -m pumps_cli {words}")
    ours = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100", **env}
    return subprocess.run(["bash", "-c", line], capture_output=True, env=ours, timeout=100)


def evil_bvh(path: Path, name: str) -> Path:
    data = BvhText(frames=8).data().replace(b"LeftHand", name.encode())
    assert name.encode() in data
    path.write_bytes(data)
    return path


def test_characters_that_steer_a_terminal_are_written_as_codes() -> None:
    assert visible("a\x1b[31m\x9b\u202e\udcff") == "a\\x1b[31m\\x9b\\u202e\\udcff"
    assert visible("a\n\tb") == "a\n\tb" and visible("a\n\tb", one_line=True) == "a\\x0a\\x09b"
    plain = "走る Ünï − ×0.5 └─ क्\u200dष 👩\u200d🚀"
    assert visible(plain, one_line=True) == plain


def test_a_joints_name_does_not_steer_the_terminal(tmp_path: Path) -> None:
    name = STEERING.replace("\u2028", "").replace("\x9b", "")
    path = evil_bvh(tmp_path / "evil.bvh", f"Left{name}Hand")
    for words in ("inspect {}", "inspect {} --map", "retarget {} --to {} -o {}.r.bvh --method turns"):
        done = pumps(words.replace("{}", str(path)))
        shown = (done.stdout + done.stderr).decode()
        assert not set(shown) & CONTROLS, words
    assert "Left\\x1b]0;owned" in pumps(f"inspect {path}").stdout.decode()


def test_an_artefacts_texts_do_not_steer_the_terminal(tmp_path: Path) -> None:
    with write_artefact(tmp_path / "m", "metrics", stage="evaluate", config={"a": STEERING}) as draft:
        write_metrics(draft.folder, [MetricRow("c", "s", "set-1", "slerp", "interpolation", 15, "l2p_m", 0.5)], "#")
        draft.summary["b"] = f"{STEERING}\nfalse line"
    for words in ("show", "lineage", "verify"):
        done = pumps(f"artefact {words} {tmp_path / 'm'}")
        assert not set((done.stdout + done.stderr).decode()) & CONTROLS, words
    assert b"\nfalse line" not in pumps(f"artefact show {tmp_path / 'm'}").stdout


def test_an_error_does_not_steer_the_terminal(tmp_path: Path) -> None:
    for name in ("a\x1b[31m.bvh", "a\x1b[31m.unknown"):
        (tmp_path / name).write_bytes(b"no motion")
        done = pumps(f"inspect $'{tmp_path}/{name}'".replace("\x1b", "\\e"))
        assert done.returncode == 3 and b"\x1b" not in done.stderr and b"\\x1b[31m" in done.stderr


@pytest.mark.parametrize("encoding", ["ascii", "cp932", "utf-8"])
def test_a_name_that_the_terminal_cannot_show_is_written_as_codes(tmp_path: Path, encoding: str) -> None:
    path = evil_bvh(tmp_path / "walk.bvh", "左手é")
    done = pumps(f"inspect {path}", PYTHONIOENCODING=encoding, PYTHONUTF8="0")
    assert done.returncode == 0 and done.stderr == b""
    shown = done.stdout.decode(encoding)
    lacking = {"ascii": "\\u5de6\\u624b\\xe9", "cp932": "左手\\xe9", "utf-8": "左手é"}
    assert lacking[encoding] in shown
    as_json = pumps(f"inspect {path} --json", PYTHONIOENCODING=encoding, PYTHONUTF8="0").stdout.decode("ascii")
    assert "左手é" in json.dumps(json.loads(as_json), ensure_ascii=False)


COMMANDS = ("stages --json", "--help", "--version", "config show --preset tiny")


@pytest.mark.parametrize("words", COMMANDS)
def test_a_closed_or_full_stdout_is_one_sentence(words: str) -> None:
    ways = {"{} > /dev/full": "No space left on device", "{} >&-": "Bad file descriptor"}
    for shell, reason in ways.items():
        if "full" in shell and not Path("/dev/full").exists():
            continue
        done = pumps(words, shell=shell)
        error = done.stderr.decode()
        assert done.returncode == 1 and reason in error and error.count("\n") == 1, (shell, error)
        assert error.startswith("pumps: ") and "Traceback" not in error


@pytest.mark.parametrize("words", COMMANDS)
def test_an_output_that_nobody_reads_ends_the_command_without_a_word(words: str) -> None:
    done = pumps(words, shell="{} | true; exit ${{PIPESTATUS[0]}}")
    assert done.stderr == b"" and done.returncode == (1 if "help" in words else 141), done.returncode


def test_a_closed_stderr_loses_only_what_goes_there(tmp_path: Path) -> None:
    done = pumps("inspect absent.bvh", shell="{} 2>&-")
    assert done.returncode == 3 and done.stdout == b"" and done.stderr == b""
    done = pumps("inspect absent.bvh --json", shell="{} > /dev/full")
    assert done.returncode == 3 and done.stderr.count(b"\n") == 1


@pytest.mark.parametrize("module", ["typer", "pydantic", "stages.registry", "rich.console"])
def test_an_interrupt_while_the_program_loads_says_nothing(tmp_path: Path, module: str) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell's background jobs have it ignored
        "class Interrupting:\n"
        "    def find_spec(self, name, *others):\n"
        f"        if name == {module!r}: os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupting())\n"
    )
    done = pumps("--help", PYTHONPATH=f"{tmp_path}:{ROOT}")
    if module == "pydantic":  # help does without it
        done = pumps("config show --preset tiny", PYTHONPATH=f"{tmp_path}:{ROOT}")
    assert b"Traceback" not in done.stderr and done.returncode == 130, done.stderr
    assert done.stderr.count(b"\n") <= 1
