"""Python processes that begin with torch and all of pumps imported, for tests that run many commands.

Importing torch takes seconds, most commands of the tests a fraction of one. So a process imports everything once and
forks for each command: each has a process, environment, working directory and outputs of its own, as from a shell,
and shares only the imports. Tests of what is imported, or when, start real processes.

    python -m tests.forked_processes SOCKET
"""

from __future__ import annotations

import atexit
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
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@contextmanager
def forked_python(folder: Path) -> Iterator[tuple[str, ...]]:
    """The words of a command that stands for `python`; `folder` gets a socket. Where there is no fork, Python itself."""
    if not hasattr(os, "pidfd_open"):
        yield (sys.executable,)
        return
    path = folder / "socket"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}
    server = subprocess.Popen(
        [sys.executable, "-m", "tests.forked_processes", str(path)],
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


def serve(path: str) -> None:
    """Fork for each connection to the socket, until the standard input ends."""
    import_everything()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen(64)
        print("ready", flush=True)
        minders: set[int] = set()
        while True:
            ready, _, _ = select.select([listener, sys.stdin], [], [], 1.0)
            minders -= {minder for minder in minders if os.waitpid(minder, os.WNOHANG)[0]}
            if sys.stdin in ready:
                return
            if listener in ready:
                connection, _ = listener.accept()
                minder = os.fork()
                if minder == 0:
                    listener.close()
                    _mind(connection)
                connection.close()
                minders.add(minder)


def _mind(connection: socket.socket) -> None:
    """In a process of its own: start what is asked for, answer with its exit code, end it if the asker ends."""
    _, files, _, _ = socket.recv_fds(connection, 1, 3)
    words, folder, environment = json.loads(connection.makefile().readline())
    process = os.fork()
    if process == 0:
        connection.close()
        _become(words, folder, environment, files)
    for file in (*files, 0, 1):  # whoever reads the output waits until all have closed it
        os.close(file)
    ended = os.pidfd_open(process)
    ready, _, _ = select.select([ended, connection], [], [])
    if ended not in ready:
        os.killpg(process, signal.SIGKILL)
    _, status = os.waitpid(process, 0)
    if ended in ready:
        connection.sendall(f"{os.waitstatus_to_exitcode(status)}\n".encode())
    os._exit(0)


def _become(words: list[str], folder: str, environment: dict[str, str], files: list[int]) -> None:
    """In a new process: run Python's arguments `words` and end with the exit code."""
    code = 1
    try:
        os.setsid()
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
    serve(sys.argv[1])
