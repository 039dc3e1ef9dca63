"""What the repository hands on says nothing of the machine that it was made on."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[1]
_REGISTRY = re.compile(rb"pypi\.org|pythonhosted\.org|registry\.npmjs|anaconda\.org|/simple/")
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
    texts = [path for path in _tracked() if path.is_file() and path != Path(__file__)]
    assert [str(path.relative_to(_ROOT)) for path in texts if _REGISTRY.search(path.read_bytes())] == []
