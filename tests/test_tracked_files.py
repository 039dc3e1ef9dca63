"""What the repository hands on says nothing of the machine that it was made on."""

import hashlib
import re
import shutil
import subprocess
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[1]
# SHA-256 of the hosts of registries, the first half of its digits: this file names none itself.
_HOSTS = {
    "a4aa2ac280bb8d1a0ce7a1be5a7bfb10",
    "8b5bb5eb9d758455b8635855cf8aaf05",
    "51c6b9f69c48a75b146d2785c3d70d33",
    "8743857e3ea00fd1c64bbc68b8af2419",
    "3ca29e55be4befa48f875d24c27f9bed",
}
_OF_AN_IMAGE = ("Containerfile", "tests/test_containerfile.py")  # their paths are in the image
_DOTTED = re.compile(rb"[\w-]+(?:\.[\w-]+)+")
_INDEX = re.compile(rb"/s[i]mple/")  # the usual path of an index of packages
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
    allowed = {
        Path("tests/weights/pack/test_pack.py"),
        Path("Containerfile"),
        Path("tests/test_containerfile.py"),
    }  # an image's
    assert [str(path) for path in found if path not in allowed] == []


def _named_hosts(content: bytes, hosts: set[str]) -> set[bytes]:
    """The hosts among dotted names, by the digests of their last two parts."""
    ends = {b".".join(name.lower().rsplit(b".", 2)[-2:]) for name in _DOTTED.findall(content)}
    return {end for end in ends if _digest(end) in hosts}


def _digest(host: bytes) -> str:
    return hashlib.sha256(host).hexdigest()[:32]


def test_no_tracked_file_names_the_host_of_a_registry():
    """A package's name is enough: where packages come from is the user's choice."""
    assert _named_hosts(b"from https://files.Registry.example/x", {_digest(b"registry.example")})
    assert not _named_hosts(b"from https://registry.example.net/x", {_digest(b"registry.example")})
    found = [
        str(path.relative_to(_ROOT))
        for path in _tracked()
        if path.is_file() and (_named_hosts(content := path.read_bytes(), _HOSTS) or _INDEX.search(content))
    ]
    assert found == []
