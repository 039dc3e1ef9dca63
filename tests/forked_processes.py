"""Python processes that begin with torch and all of pumps imported, for tests that run many commands.

Importing torch takes seconds, most commands of the tests a fraction of one. So a process imports everything once and
forks for each command: each has a process, environment, working directory and outputs of its own, as from a shell,
and shares only the imports. Tests of what is imported, or when, start real processes.

    python -m tests.forked_processes SOCKET everything | settings
"""

from __future__ import annotations

import atexit
import gc
import io
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@contextmanager
def forked_python(folder: Path, imports: str) -> Iterator[tuple[str, ...]]:
    """The words of a command that stands for `python`; on other systems than Linux, Python itself.

    Args:
        folder: gets a socket. imports: "everything", or "settings" for what `pumps config` needs.
    """
    if not hasattr(os, "pidfd_open"):
        yield (sys.executable,)
        return
    path = folder / "socket"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}
    server = subprocess.Popen(
        [sys.executable, "-m", "tests.forked_processes", str(path), imports],
        cwd=ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    assert server.stdin and server.stdout and server.stdout.readline() == b"ready\n"
    yield (sys.executable, "-I", "-S", str(ROOT / "tests" / "forked_client.py"), str(path))
    server.stdin.close()  # which ends it
    server.wait(60)


def import_everything() -> None:
    """Load what commands load, once; for an optimiser, torch loads its compiler."""
    import torch

    import pumps_cli.app  # noqa: F401
    from stages.registry import STAGES

    for stage in STAGES:
        stage.runner()
    torch.optim.AdamW([torch.zeros(1, requires_grad=True)])


def import_settings() -> None:
    """Load what `pumps config` loads; without torch, a fork takes a fraction of the time."""
    import pumps_cli.app
    import pumps_cli.commands.config  # noqa: F401
    from stages.registry import STAGES

    for stage in STAGES:
        stage.config_type()


def serve(path: str, imports: str) -> None:
    """Fork for each connection to the socket, until the standard input ends."""
    {"everything": import_everything, "settings": import_settings}[imports]()
    gc.freeze()  # the forked processes shall not go through, and so copy, all objects of the imports
    running: dict[int, tuple[int, socket.socket]] = {}  # by the file that becomes readable when the process ends
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen(64)
        print("ready", flush=True)
        while True:
            stop, asked = sys.stdin.fileno(), listener.fileno()
            askers = {asker.fileno(): process for process, asker in running.values()}
            ready = set(select.select([stop, asked, *running, *askers], [], [])[0])
            if stop in ready:
                os._exit(0)  # unloading torch takes seconds
            for file in ready & set(askers):  # an asker that was killed
                os.killpg(askers[file], signal.SIGKILL)
            for file in ready & set(running):
                process, asker = running.pop(file)
                code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
                with suppress(OSError), asker:
                    asker.sendall(f"{code}\n".encode())
                os.close(file)
            if asked in ready:
                asker, _ = listener.accept()
                process = _started(asker, listener)
                running[os.pidfd_open(process)] = process, asker


def _started(asker: socket.socket, listener: socket.socket) -> int:
    """The process of what is asked for."""
    _, files, _, _ = socket.recv_fds(asker, 1, 3)
    words, folder, environment = json.loads(asker.makefile().readline())
    begun, begins = os.pipe()
    process = os.fork()
    if process == 0:
        os.setsid()
        for file in (begun, begins, asker.fileno(), listener.fileno()):
            os.close(file)
        _become(words, folder, environment, files)
    os.close(begins)
    os.read(begun, 1)  # until it has a process group of its own, which can be killed
    for file in (begun, *files):  # whoever reads the output waits until all have closed it
        os.close(file)
    return process


def _become(words: list[str], folder: str, environment: dict[str, str], files: list[int]) -> None:
    """In a new process: run Python's arguments `words` and end with the exit code."""
    code = 1
    try:
        for number, file in enumerate(files):
            os.dup2(file, number)
            os.close(file)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        sys.stdin = io.TextIOWrapper(open(0, "rb", closefd=False), encoding="utf-8")  # noqa: SIM115
        sys.stdout, sys.stderr = (
            io.TextIOWrapper(open(number, "wb", closefd=False), encoding="utf-8", line_buffering=os.isatty(number))  # noqa: SIM115
            for number in (1, 2)
        )
        _run(words)
        code = 0
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
        if isinstance(leaving.code, str):
            print(leaving.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _run(words: list[str]) -> None:
    if words[0] == "-m":
        sys.argv = words[1:]
        runpy.run_module(words[1], run_name="__main__", alter_sys=True)
    elif words[0] == "-c":
        sys.argv = ["-c", *words[2:]]
        exec(compile(words[1], "<string>", "exec"), {"__name__": "__main__"})
    else:
        sys.argv = words
        runpy.run_path(words[0], run_name="__main__")


if __name__ == "__main__":
    serve(*sys.argv[1:])
