"""Processes that share their imports behave as processes of their own."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = """
import os, sys
print(sys.argv[1:], os.getcwd(), os.environ["HERE"], sys.stdin.read(), "stages" in sys.modules)
print("wrong", file=sys.stderr)
sys.exit({code})
"""


@pytest.mark.parametrize("code", ["0", "3", "'a sentence'"])
def test_it_has_its_own_words_folder_environment_input_outputs_and_exit_code(
    fast_python: tuple[str, ...], tmp_path: Path, code: str
):
    given = {"cwd": tmp_path, "env": {"HERE": "it"}, "input": "in", "capture_output": True, "text": True}
    ran, plain = (
        subprocess.run([*python, "-c", PROGRAM.format(code=code), "a", "b c"], **given)
        for python in (fast_python, (sys.executable,))
    )
    assert (ran.returncode, ran.stderr) == (plain.returncode, plain.stderr)
    assert ran.stdout == plain.stdout.replace("False", "True" if len(fast_python) > 1 else "False")


def test_scripts_and_modules_run_too(fast_python: tuple[str, ...], tmp_path: Path):
    (tmp_path / "script.py").write_text("import sys; print(__name__, sys.argv)")
    ran = subprocess.run([*fast_python, "script.py", "x"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert ran.stdout == "__main__ ['script.py', 'x']\n"
    ran = subprocess.run([*fast_python, "-m", "pumps_cli", "infill"], capture_output=True, text=True)
    assert ran.returncode == 2 and "Traceback" not in ran.stderr


def test_a_fault_is_shown(fast_python: tuple[str, ...]):
    ran = subprocess.run([*fast_python, "-c", "import os; os.abort()"], capture_output=True, text=True)
    assert ran.returncode < 0
    ran = subprocess.run([*fast_python, "-c", "1 / 0"], capture_output=True, text=True)
    assert ran.returncode == 1 and "ZeroDivisionError" in ran.stderr


def test_it_is_killed_with_the_process_that_asked_for_it(fast_python: tuple[str, ...], tmp_path: Path):
    code = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    asker = subprocess.Popen([*fast_python, "-c", code], stdout=subprocess.PIPE, text=True)
    assert asker.stdout
    process = int(asker.stdout.readline())
    asker.kill()
    asker.communicate()  # ends when the process has closed its output
    deadline = time.monotonic() + 20
    while Path(f"/proc/{process}").exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
