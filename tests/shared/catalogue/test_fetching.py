"""Downloads from a local server that cuts connections, changes its file, or does not support ranges."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from data_schemas.errors import InputError, PumpsError, UsageError
from stages.data.fetch.config import Config
from stages.data.fetch.run import run
from stages.shared.catalogue.catalogue import DataFile, read_catalogue
from stages.shared.catalogue.download import _BLOCK, fetch_file
from stages.shared.progress import SILENT
from tests.shared.catalogue.loopback import Behaviour, loopback_server

CONTENT = bytes(range(256)) * 4000  # 1 MB


@pytest.fixture
def server() -> Iterator[tuple[Behaviour, str]]:
    with loopback_server(CONTENT) as (behaviour, address):
        yield behaviour, f"{address}/walks.zip"


def _file(url: str, content: bytes = CONTENT, **changes: object) -> DataFile:
    checksum = "sha256:" + hashlib.sha256(content).hexdigest()
    values: dict[str, object] = {"name": "walks.zip", "url": url, "bytes": len(content), "checksum": checksum}
    return DataFile.model_validate(values | changes)


def _fetch(file: DataFile, folder: Path) -> bytes:
    return fetch_file(file, folder, progress=SILENT, pause_s=0.001).read_bytes()


def test_a_plain_download_leaves_the_file_and_nothing_else(server, tmp_path: Path):
    _, url = server
    assert _fetch(_file(url), tmp_path) == CONTENT
    assert [path.name for path in tmp_path.iterdir()] == ["walks.zip"]


def test_a_complete_file_is_not_requested_again(server, tmp_path: Path):
    behaviour, url = server
    _fetch(_file(url), tmp_path)
    behaviour.asked.clear()
    assert _fetch(_file(url), tmp_path) == CONTENT
    assert behaviour.asked == []


def test_another_file_of_that_name_is_replaced_on_request_only(server, tmp_path: Path):
    _, url = server
    (tmp_path / "walks.zip").write_bytes(b"mine")
    with pytest.raises(UsageError, match=r"walks\.zip exists, but .*Give --overwrite"):
        _fetch(_file(url), tmp_path)
    assert (tmp_path / "walks.zip").read_bytes() == b"mine"
    assert fetch_file(_file(url), tmp_path, progress=SILENT, overwrite=True).read_bytes() == CONTENT


def test_cut_connections_go_on_where_they_broke_off(server, tmp_path: Path):
    behaviour, url = server
    behaviour.cut_after = [5 * _BLOCK, 3 * _BLOCK + 10, 0, 1]
    assert _fetch(_file(url), tmp_path) == CONTENT
    assert behaviour.asked == [None, f"bytes={5 * _BLOCK}-"] + 3 * [f"bytes={8 * _BLOCK}-"]


def test_a_second_call_goes_on_from_what_the_first_left(server, tmp_path: Path):
    behaviour, url = server
    behaviour.cut_after = [6 * _BLOCK] + [0] * 20
    with pytest.raises(PumpsError, match="broke"):
        _fetch(_file(url), tmp_path)
    assert (tmp_path / "walks.zip.part").stat().st_size == 6 * _BLOCK
    assert not (tmp_path / "walks.zip").exists()
    behaviour.cut_after, behaviour.asked = [], []
    assert _fetch(_file(url), tmp_path) == CONTENT
    assert behaviour.asked == [f"bytes={6 * _BLOCK}-"]


def test_a_part_of_another_program_is_refused_and_kept(server, tmp_path: Path):
    _, url = server
    part = tmp_path / "walks.zip.part"
    part.write_bytes(b"of a browser")
    with pytest.raises(UsageError, match="is not of a download by pumps"):
        _fetch(_file(url), tmp_path)
    assert part.read_bytes() == b"of a browser"


def test_a_file_that_changed_meanwhile_is_taken_whole(server, tmp_path: Path):
    behaviour, url = server
    behaviour.cut_after = [6 * _BLOCK] + [0] * 20
    with pytest.raises(PumpsError):
        _fetch(_file(url), tmp_path)
    behaviour.cut_after = []
    behaviour.content, behaviour.etag = CONTENT[::-1], '"two"'
    assert _fetch(_file(url, CONTENT[::-1]), tmp_path) == CONTENT[::-1]


@pytest.mark.parametrize("etag", ['"one"', ""])
def test_a_server_without_ranges_or_marks_starts_again(server, tmp_path: Path, etag: str):
    behaviour, url = server
    behaviour.ranges, behaviour.etag, behaviour.cut_after = False, etag, [5 * _BLOCK]
    assert _fetch(_file(url), tmp_path) == CONTENT


def test_a_wrong_checksum_keeps_nothing_and_the_next_try_can_succeed(server, tmp_path: Path):
    behaviour, url = server
    behaviour.content = CONTENT[:-1] + b"x"
    with pytest.raises(PumpsError, match="checksum"):
        _fetch(_file(url), tmp_path)
    assert list(tmp_path.iterdir()) == []
    behaviour.content = CONTENT
    assert _fetch(_file(url), tmp_path) == CONTENT


def test_a_wrong_checksum_leaves_an_older_file_as_it_was(server, tmp_path: Path):
    behaviour, url = server
    (tmp_path / "walks.zip").write_bytes(b"older")
    behaviour.content = b"wrong" * 10
    with pytest.raises(PumpsError, match="checksum"):
        _fetch(_file(url), tmp_path)
    assert (tmp_path / "walks.zip").read_bytes() == b"older"


def test_more_than_was_stated_is_refused(server, tmp_path: Path):
    behaviour, url = server
    behaviour.content = CONTENT * 3
    with pytest.raises(PumpsError, match="sends more"):
        _fetch(_file(url), tmp_path)
    assert not list(tmp_path.glob("*.part"))


def test_the_servers_refusal_is_reported(server, tmp_path: Path):
    behaviour, url = server
    behaviour.status = 404
    with pytest.raises(PumpsError, match="404"):
        _fetch(_file(url), tmp_path)


def test_too_little_space_is_reported_before_any_request(server, tmp_path: Path):
    behaviour, url = server
    with pytest.raises(PumpsError, match="free"):
        _fetch(_file(url, bytes=10**18), tmp_path)
    assert behaviour.asked == []


def _catalogue(folder: Path, url: str, **changes: str) -> Path:
    digest = hashlib.sha256(CONTENT).hexdigest()
    table = {
        "title": "Walks", "format": "BVH", "home": "http://example.org", "licence": "CC BY 4.0",
        "licence_url": "http://example.org/licence", "terms": "Name us.", "ingest": "pumps ingest bvh {file} -o out",
    } | changes  # fmt: skip
    text = "[walks]\n" + "".join(f'{name} = "{value}"\n' for name, value in table.items())
    text += f'[[walks.files]]\nname = "walks.zip"\nurl = "{url}"\nbytes = {len(CONTENT)}\n'
    text += f'checksum = "sha256:{digest}"\n'
    path = folder / "catalogue.toml"
    path.write_text(text)
    return path


def test_the_licence_is_shown_and_accepted_once(server, tmp_path: Path):
    behaviour, url = server
    settings = {"name": "walks", "output": tmp_path / "data", "acceptances": tmp_path / "settings" / "accepted.json"}
    asked = Config.model_validate(settings | {"catalogue": _catalogue(tmp_path, url)})
    with pytest.raises(UsageError, match=r"CC BY 4\.0") as refused:
        run(asked)
    assert "--accept-licence" in str(refused.value.hint)
    assert behaviour.asked == []
    report = run(asked.model_copy(update={"accept_licence": True}))
    assert (tmp_path / "data" / "walks.zip").read_bytes() == CONTENT
    assert any("checksum right" in line for line in report.lines)
    run(asked)  # remembered
    _catalogue(tmp_path, url, licence="CC BY-NC 4.0")
    with pytest.raises(UsageError, match="CC BY-NC"):
        run(asked)  # another licence is another question


def test_what_only_a_person_can_fetch_is_explained():
    with pytest.raises(PumpsError, match="cannot be fetched by a program") as refused:
        run(Config(name="amass"))
    assert "account" in str(refused.value.hint)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(UsageError) as refused:
        run(Config(name="walks"))
    assert "lafan1" in str(refused.value.hint)


def test_our_catalogue_states_a_checksum_and_a_licence_for_every_file():
    for name, data_set in read_catalogue().items():
        assert data_set.licence and data_set.licence_url.startswith("http"), name
        assert all(each.checksum and each.checksum_from for each in data_set.files), name


@pytest.mark.parametrize(
    "name", ["../walks.zip", "a/b.zip", ".hidden", "", "/etc/passwd", "con.zip", "walks.", "walks.zip.part"]
)
def test_a_catalogue_whose_file_names_lead_out_of_the_folder_is_refused(tmp_path: Path, name: str):
    path = _catalogue(tmp_path, "http://127.0.0.1/x")
    path.write_text(path.read_text().replace('name = "walks.zip"', f'name = "{name}"'))
    with pytest.raises(InputError, match="plain file name"):
        read_catalogue(path)


@pytest.mark.parametrize("text", ["", "walks = 1", "[walks]\nurl = 3", "\xff", "[walks"])
def test_a_catalogue_that_is_none_is_refused_or_empty(tmp_path: Path, text: str):
    path = tmp_path / "catalogue.toml"
    path.write_bytes(text.encode("latin-1"))
    if text:
        with pytest.raises(InputError):
            read_catalogue(path)
    else:
        assert read_catalogue(path) == {}
