"""What the repository hands on says nothing of the machine that it was made on."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[1]
# Put together here, so that this file names no host itself.
_HOSTS = [b".".join(parts) for parts in ((b"pypi", b"org"), (b"pythonhosted", b"org"), (b"anaconda", b"org"))]
_HOSTS += [b"registry" + b".npmjs", b"/sim" + b"ple/"]
_REGISTRY = re.compile(b"|".join(map(re.escape, _HOSTS)))
_PLACE = re.compile(rb"(?<![\w.~)\]}-])/(?:home|Users|root|mnt|media|srv|work|data|tmp|var)/[\w.-]+/")


def _tracked():
    git = shutil.which("git")
    if git is None or not (_ROOT / ".git").exists():
        pytest.skip("not a clone")
    names = subprocess.run([git, "ls-files", "-z"], cwd=_ROOT, capture_output=True, check=True).stdout
    return [_ROOT / name for name in names.decode().split("\0") if name]


def test_no_tracked_file_holds_a_path_of_a_machine():
    texts = [path for path in _tracked() if path.is_file() and path != Path(__file__)]
    assert len(texts) > 300
    here = bytes(_ROOT) + b"/"
    found = [
        path.relative_to(_ROOT) for path in texts if _PLACE.search(content := path.read_bytes()) or here in content
    ]
    assert [str(path) for path in found if path != Path("tests/weights/pack/test_pack.py")] == []


def test_no_tracked_file_names_the_host_of_a_registry():
    """A package's name is enough: where packages come from is the user's choice."""
    assert _REGISTRY.search(b"from https://" + _HOSTS[0] + b"/")
    texts = [path for path in _tracked() if path.is_file()]
    assert [str(path.relative_to(_ROOT)) for path in texts if _REGISTRY.search(path.read_bytes())] == []
