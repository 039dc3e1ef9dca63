"""The packages use nothing that only POSIX has, unless they look first whether it is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODULES = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog", "posix"}
SIGNALS = {"SIGINT", "signal", "getsignal", "default_int_handler"}  # what Windows has of them
OF_OS = {
    "fork", "forkpty", "fchmod", "fchown", "chown", "lchown", "getuid", "geteuid", "getgid", "getpgid", "killpg",
    "setsid", "mkfifo", "mknod", "posix_fallocate", "posix_fadvise", "pread", "pwrite", "sched_getaffinity",
    "sched_setaffinity", "statvfs", "fstatvfs", "uname", "nice", "getloadavg", "wait", "wait3", "wait4", "sysconf",
    "O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "SIGKILL",
}  # fmt: skip
_MAYBE = re.compile(rf"\b(?:{'|'.join(sorted(MODULES | OF_OS))})\b|\bsignal\.")


def _posix_only(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    if not _MAYBE.search(text):
        return []
    tree = ast.parse(text)
    guarded: set[ast.AST] = set()
    for node in ast.walk(tree):
        looks = isinstance(node, ast.If | ast.IfExp) and "hasattr(" in ast.unparse(node.test)
        fails = isinstance(node, ast.Try) and any("ImportError" in ast.unparse(each) for each in node.handlers)
        if looks or fails:
            guarded |= {*ast.walk(node)}
    found = []
    for node in ast.walk(tree):
        if node in guarded:
            continue
        if isinstance(node, ast.Import):
            found += [each.name for each in node.names if each.name in MODULES]
        if isinstance(node, ast.ImportFrom) and node.module in MODULES:
            found.append(node.module)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "os" and node.attr in OF_OS:
                found.append(f"os.{node.attr}")
            if node.value.id == "signal" and node.attr not in SIGNALS:
                found.append(f"signal.{node.attr}")
    return [f"{path.relative_to(ROOT)}: {each}" for each in found]


def test_no_package_needs_posix():
    assert [
        each
        for package in ("data_schemas", "pumps", "pumps_cli", "stages")
        for path in sorted((ROOT / package).rglob("*.py"))
        for each in _posix_only(path)
    ] == []
