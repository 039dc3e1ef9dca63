"""Weights fetched from a server on this machine: whole and checked, or not at all."""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from data_schemas.errors import InputError, PumpsError, UsageError
from data_schemas.own_folders import make_own_folder
from data_schemas.write_lock import write_lock
from pumps_cli.completion import _weights
from stages.shared.catalogue.weights_registry import read_registry
from stages.shared.formats import archives
from stages.shared.weights import fetched
from stages.shared.weights.facts import facts_of
from stages.shared.weights.shipped import weights_folder
from stages.weights.fetch.config import Config
from stages.weights.fetch.run import run
from stages.weights.list.config import Config as ListConfig
from stages.weights.list.run import run as list_weights
from tests.shared.catalogue.loopback import Behaviour, loopback_server
from tests.shared.inference.examples import write_random_weights
from tests.weights.fetch.archives_made import checksum_of, files_of, registry_of, tar, tar_of, zip_of


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("weights")
    write_random_weights(folder)
    return folder


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(fetched, "fetched_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr("stages.weights.fetch.run.fetched_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr("stages.shared.weights.facts.fetched_folder", lambda: tmp_path / "cache")
    monkeypatch.setattr("stages.shared.catalogue.download._TRIES", 1)
    return tmp_path / "cache"


@pytest.fixture
def server(weights: Path) -> Iterator[tuple[Behaviour, str]]:
    with loopback_server(tar_of(weights, "small/")) as served:
        yield served


class Asked:
    """`pumps weights fetch` with a registry of what a server has."""

    def __init__(self, folder: Path, behaviour: Behaviour, address: str) -> None:
        self.behaviour, self.address = behaviour, address
        self.registry, self.accepted = folder / "weights.toml", folder / "accepted.json"
        self.write()

    def write(self, **changes: object) -> None:
        self.registry.write_text(registry_of(self.behaviour.content, **{"url": f"{self.address}/some.tar"} | changes))  # type: ignore[arg-type]

    def __call__(self, source: str = "walks", **settings: object):
        values = {"registry": str(self.registry), "accept_licence": True, "acceptances": self.accepted}
        return run(Config.model_validate({"source": source} | values | settings))


@pytest.fixture
def fetch(cache: Path, server: tuple[Behaviour, str], tmp_path: Path) -> Asked:
    return Asked(tmp_path, *server)


def test_fetched_weights_are_found_by_their_name(fetch: Asked, cache: Path, weights: Path):
    report = fetch()
    assert any("test only" in line for line in report.lines)
    assert weights_folder("walks") == cache / "walks" and facts_of("walks")["name"] == "walks"
    sent = {name: data for name, data in files_of(weights).items() if "/." not in name}
    assert sent.items() <= files_of(cache / "walks").items()
    assert [path.name for path in cache.iterdir()] == ["walks"]
    assert "walks" in _weights() and "walks" in list_weights(ListConfig()).figures["weights"]
    fetch.behaviour.asked.clear()
    assert "is there already" in fetch().lines[0] and fetch.behaviour.asked == []


def test_an_output_folder_keeps_them_elsewhere(fetch: Asked, cache: Path, tmp_path: Path):
    report = fetch(output=tmp_path / "mine")
    assert weights_folder(tmp_path / "mine" / "walks") == report.output and not cache.exists()


def test_the_licence_is_shown_before_anything_is_requested(fetch: Asked, cache: Path):
    with pytest.raises(UsageError, match=r"weights/walks has its own licence: test only\."):
        fetch(accept_licence=False)
    assert fetch.behaviour.asked == [] and not cache.exists()
    fetch()
    fetch(accept_licence=False)  # it was accepted


def test_an_address_needs_a_checksum_and_shows_the_licence_of_what_came(fetch: Asked, cache: Path, weights: Path):
    address = f"{fetch.address}/walks%2Dtwo.zip"
    settings: dict[str, object] = {"registry": None}
    fetch.behaviour.content = zip_of(weights)
    with pytest.raises(UsageError, match="needs its checksum"):
        fetch(address, **settings)
    settings["checksum"] = checksum_of(fetch.behaviour.content)
    with pytest.raises(UsageError, match="licence: test only"):
        fetch(address, accept_licence=False, **settings)
    assert not (cache / "walks-two").exists() and len(fetch.behaviour.asked) == 1
    fetch(address, **settings)
    assert weights_folder("walks-two") == cache / "walks-two"
    assert len(fetch.behaviour.asked) == 1  # what was downloaded was kept
    assert [path.name for path in cache.iterdir()] == ["walks-two"]


def test_an_interrupted_download_leaves_no_weights_and_goes_on(fetch: Asked, cache: Path):
    fetch.behaviour.cut_after = [1 << 16]
    with pytest.raises(PumpsError, match="run the command again to continue"):
        fetch()
    assert sorted(path.name for path in cache.rglob("*") if path.is_file()) == [
        "walks.tar.part",
        "walks.tar.part.mark",
    ]
    with pytest.raises(InputError):
        weights_folder("walks")
    fetch()
    assert fetch.behaviour.asked == [None, f"bytes={1 << 16}-"]
    assert weights_folder("walks") == cache / "walks"


def test_a_wrong_checksum_keeps_nothing(fetch: Asked, cache: Path):
    fetch.behaviour.content = fetch.behaviour.content[:-1] + b"x"
    with pytest.raises(PumpsError, match="does not match its checksum"):
        fetch()
    assert not cache.exists()


def test_more_than_was_stated_is_refused(fetch: Asked, cache: Path):
    fetch.write(bytes=1000)
    with pytest.raises(PumpsError, match="1,000 bytes at most"):
        fetch()
    assert not cache.exists()


def test_a_registry_that_states_another_licence_is_refused(fetch: Asked, cache: Path):
    fetch.write(licences="MIT")
    with pytest.raises(InputError, match=r"states the licences MIT, and the weights state test only"):
        fetch()
    assert not cache.exists()


def test_others_of_that_name_are_replaced_on_request_only(fetch: Asked, cache: Path, weights: Path):
    fetch()
    before = files_of(cache / "walks")
    fetch.behaviour.content = tar_of(weights)
    fetch.write()
    with pytest.raises(UsageError, match="--overwrite"):
        fetch()
    assert files_of(cache / "walks") == before
    fetch(overwrite=True)
    assert files_of(cache / "walks").keys() == before.keys()
    assert [path.name for path in cache.iterdir()] == ["walks"]


def test_a_persons_own_folder_stays(fetch: Asked, cache: Path):
    (cache / "walks").mkdir(parents=True)
    (cache / "walks" / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="pumps did not make it"):
        fetch(overwrite=True)
    assert (cache / "walks" / "notes.txt").read_text() == "mine"


HOSTILE = {
    "a way out": ({"../../evil.json": b"{}"}, "leads out"),
    "a way out of the drive": ({"C:/evil.json": b"{}"}, "leads out"),
    "code": ({"small/ae/run.py": b""}, "have only"),
    "a pickle": ({"small/ae/model.pt": b""}, "have only"),
    "a device": ({"small/con.json": b"{}"}, "not every system takes"),
    "one file on some systems": ({"small/AE/manifest.json": b"{}"}, "one file on some systems"),
    "accents that are one file on some systems": (
        {"small/caf\u00e9.json": b"{}", "small/cafe\u0301.json": b"{}"}, "one file on some systems",
    ),
    "a file and a folder": ({"small/x.json": b"{}", "small/x.json/y.json": b"{}"}, "a folder of that name"),
    "a file and a folder on some systems": (
        {"small/x.json/y/z.json": b"{}", "small/X.json": b"{}"}, "a folder of that name",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("files", "told"), HOSTILE.values(), ids=HOSTILE)
def test_hostile_archives_write_nothing(fetch: Asked, cache: Path, weights: Path, tmp_path: Path, files, told: str):
    sound = {f"small/{name}": data for name, data in files_of(weights).items()}
    fetch.behaviour.content = tar(sound | files)
    fetch.write()
    before = {path for path in tmp_path.rglob("*") if path != fetch.accepted}
    with pytest.raises(InputError, match=told):
        fetch()
    assert {path for path in tmp_path.rglob("*") if path != fetch.accepted} == before


def test_a_fetch_that_is_refused_leaves_what_another_unpacks(fetch: Asked, cache: Path):
    staging = cache / ".walks.unpacking"
    make_own_folder(staging)
    (staging / "card.md").write_text("of the other")
    (cache / ".downloads").mkdir()
    with write_lock(cache / ".downloads"), pytest.raises(PumpsError, match="is being written by another pumps"):
        fetch()
    assert (staging / "card.md").read_text() == "of the other"
    fetch()
    assert [path.name for path in cache.iterdir()] == ["walks"]


@pytest.mark.parametrize("pack", [tar_of, zip_of])
@pytest.mark.parametrize("sound", [True, False])
def test_an_archive_is_closed_before_it_is_removed(
    fetch: Asked, cache: Path, weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pack, sound: bool
):
    """Windows removes no open file."""
    packed = tmp_path / "packed"
    shutil.copytree(weights, packed)
    if not sound:
        (packed / "run.py").touch()
    fetch.behaviour.content = pack(packed)
    fetch.write(url=f"{fetch.address}/some{'.tar' if pack is tar_of else '.zip'}")
    opened, removed, unlink = [], [], Path.unlink
    for module, name in ((archives, "_Unpacked"), (archives.zipfile, "ZipFile")):
        monkeypatch.setattr(module, name, _remembered(getattr(module, name), opened))

    def unlink_closed(path: Path, missing_ok: bool = False) -> None:
        if path.name in ("walks.tar", "walks.zip"):
            removed.append(path)
            assert opened and not [each for each in opened if each() is not None and not _is_closed(each())]
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", unlink_closed)
    with nullcontext() if sound else pytest.raises(InputError, match="have only"):
        fetch()
    assert removed


def _remembered(kind: type, opened: list[Callable[[], Any]]) -> Callable[..., Any]:
    def make(*arguments: Any, **options: Any) -> Any:
        made = kind(*arguments, **options)
        opened.append(weakref.ref(made))
        return made

    return make


def _is_closed(file: Any) -> bool:
    return file.fp is None if hasattr(file, "fp") else file.closed


def test_weights_that_were_fetched_can_be_published_again(fetch: Asked, cache: Path):
    fetch()
    fetch.behaviour.content = tar_of(cache / "walks")
    fetch.write()
    fetch(overwrite=True)
    assert checksum_of(fetch.behaviour.content) in (cache / "walks" / "fetched.json").read_text()


def test_links_of_an_archive_are_not_made(fetch: Asked, cache: Path, weights: Path, tmp_path: Path):
    fetch.behaviour.content = tar(files_of(weights), links={"card": str(tmp_path), "confidence.json": "../../x"})
    fetch.write()
    fetch()
    assert not [path for path in cache.rglob("*") if path.is_symlink()]
    assert not (cache / "walks" / "card").exists()


@pytest.mark.parametrize("files", [{}, {"readme.md": b"hello"}, {"ae/manifest.json": b"{}"}])
def test_an_archive_without_weights_is_refused(fetch: Asked, cache: Path, files: dict[str, bytes]):
    fetch.behaviour.content = tar(files)
    fetch.write()
    with pytest.raises(InputError):
        fetch()
    assert not cache.exists()


def test_names_that_come_with_pumps_are_not_fetched(fetch: Asked, cache: Path):
    fetch.registry.write_text(fetch.registry.read_text().replace("[walks]", "[small-free]"))
    with pytest.raises(UsageError, match="small-free come with pumps"):
        fetch("small-free")


def test_a_registry_may_be_at_an_address(fetch: Asked, cache: Path):
    with loopback_server(fetch.registry.read_bytes()) as (_, address):
        fetch(registry=f"{address}/weights.toml")
    assert weights_folder("walks") == cache / "walks"
    with pytest.raises(UsageError, match="changed on its way"):
        fetch(registry="http://example.org/weights.toml")
    with pytest.raises(UsageError, match="no registry is given"):
        fetch(registry=None)
    with pytest.raises(UsageError, match="It has walks"):
        fetch("runs")


def test_a_registry_is_not_read_from_where_it_can_be_changed_on_its_way(fetch: Asked, monkeypatch):
    monkeypatch.setattr("stages.shared.catalogue.weights_registry._ON_THIS_MACHINE", ("127.0.0.1",))
    with loopback_server(fetch.registry.read_bytes()) as (behaviour, address):
        behaviour.redirects = [f"{address}/moved.toml"]
        assert list(read_registry(f"{address}/weights.toml")) == ["walks"]
        other = address.replace("127.0.0.1", "localhost")
        behaviour.redirects = [f"{other}/moved.toml"]
        with pytest.raises(UsageError, match=r"localhost:\d+/moved\.toml can be changed on its way"):
            read_registry(f"{address}/weights.toml")
        behaviour.redirects = [f"{other}/moved.toml", f"{address}/weights.toml"]
        with pytest.raises(UsageError, match="can be changed on its way"):
            read_registry(f"{address}/weights.toml")


def test_a_registry_of_any_length_is_not_read(fetch: Asked):
    with loopback_server(b"#" * (2 << 20)) as (_, address), pytest.raises(InputError, match="more than"):
        read_registry(f"{address}/weights.toml")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"bytes": 0}, "from 1 to"), ({"bytes": 1 << 40}, "from 1 to"), ({"checksum": "md5:" + "0" * 32}, "sha256"),
        ({"url": "file:///x.tar"}, "http"), ({"url": "http://127.0.0.1/x.exe"}, "not an archive"),
        ({"extra": 1}, "xtra"),
    ],
)  # fmt: skip
def test_a_registry_that_is_wrong_is_refused(fetch: Asked, cache: Path, changes: dict[str, object], told: str):
    fetch.write(**changes)
    with pytest.raises(PumpsError, match=told):
        fetch()
    assert fetch.behaviour.asked == [] and not cache.exists()
