"""Markup in any text of any artefact that `pumps report` reads is text in the page, or the artefact is refused."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import write_checkpoint
from data_schemas.errors import PumpsError
from data_schemas.metrics import MetricRow, write_metrics
from data_schemas.motion import ClipRow, MotionWriter
from data_schemas.skeleton import Skeleton
from stages.report.config import Config
from stages.report.run import run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from tests.shared.formats.bvh_texts import BvhText

EVIL = "pwn\"'><img src=x onerror=alert(1)><script>alert(2)<\\u002fscript><!--${title}{0}\u202e"
ENDING = f"{EVIL}</script></title></style>"  # where a slash may stand


class _Page(HTMLParser):
    """All elements, and everything in the page that is not text."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: Counter[str] = Counter()
        self.not_text: list[str] = []
        self.text = ""
        self._inside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements[tag] += 1
        self.not_text += [tag, *(name for name, _ in attrs)]
        assert not any(name.startswith("on") for name, _ in attrs)
        self._inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        self._inside.pop()

    def handle_data(self, data: str) -> None:
        if self._inside and self._inside[-1] in ("script", "style"):
            self.elements[f"{self._inside[-1]} of {'<' in data}"] += 1
        else:
            self.text += data

    def handle_comment(self, data: str) -> None:
        self.not_text.append(data)

    def unknown_decl(self, data: str) -> None:
        self.not_text.append(data)


def page_of(folder: Path, output: Path) -> _Page:
    motions = (f"SCENE/truth={folder / 'motion'}", f"SCENE/again={folder / 'motion'}")
    run(
        Config(
            metrics=folder / "metrics", checkpoints=(folder / "ae",), motions=motions, output=output,
            picture=output.with_suffix(".svg"), overwrite=True, max_seconds=0.5,
        )
    )  # fmt: skip
    page = _Page()
    page.feed(output.read_text(encoding="utf-8"))
    page.close()
    return page


def write_artefacts(folder: Path, evil: dict[str, str] | None = None) -> None:
    """The three artefacts; `evil` names texts in their tables that are replaced."""
    words = {name: name for name in ("clip", "skeleton", "archive", "method", "task", "metric", "figure", "split")}
    words |= {"source": "a.zip!x.bvh", "joint": "", "licence": "CC", "task": "interpolation", "metric": "l2p_m"}
    words |= {"split": "train"} | (evil or {})
    log = [{"step": s, "seconds": s / 10, "split": words["split"], words["figure"]: 9.0 / s} for s in range(1, 9)]
    log += [{"step": s, "seconds": s / 10, "split": "val", words["figure"]: 12.0 / s} for s in range(2, 9, 2)]
    with write_artefact(
        folder / "ae", "checkpoint", stage="train-ae", config={"steps": "9"}, licences=["CC"]
    ) as draft:
        weights = {"w": np.zeros(1, np.float32)}
        write_checkpoint(draft.folder, weights=weights, config={"a": "b"}, optimiser=None, log=log, card="card")
    with write_artefact(folder / "metrics", "metrics", stage="evaluate", config={"splits": ["test"]}) as draft:
        where = (words["skeleton"], words["archive"])
        rows = [
            MetricRow(f"{words['clip']}{n}", *where, method, words["task"], 15, words["metric"], value + n)
            for method, value in (("slerp", 0.5), (words["method"], 0.4))
            for n in range(3)
        ]
        write_metrics(draft.folder, rows, "# Evaluation")
        draft.summary["weights"] = [{"name": "mine", "source": "runs/a"}]
        draft.summary["borrowed_statistics"] = ["abc"]
    skeleton, motion, _ = motion_of(read_bvh(BvhText(frames=40).data(), "walk.bvh"))
    skeleton = _renamed(skeleton, words["joint"])
    with (
        write_artefact(folder / "motion", "motion", stage="ingest", config={}, licences=[words["licence"]]) as draft,
        MotionWriter(draft.folder) as writer,
    ):
        name = writer.add_skeleton(skeleton)
        row = ClipRow(words["clip"], words["source"], "0" * 64, name, 40, motion.fps, 40 / motion.fps, "test", "CC")
        writer.add_clip(row, motion)


def _renamed(skeleton: Skeleton, end: str) -> Skeleton:
    return replace(skeleton, names=tuple(f"{name}{end}" for name in skeleton.names), header="")


def _texts(value: Any, path: tuple = ()) -> Iterator[tuple]:
    """The place of every text in JSON, keys of objects included (as a place that ends with None)."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _texts(inner, (*path, key))
            if path:
                yield (*path, key, None)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _texts(inner, (*path, index))
    elif isinstance(value, str):
        yield path


def _with(value: Any, path: tuple, text: str) -> Any:
    if not path:
        return text
    if path[1:] == (None,):
        return {text if key == path[0] else key: inner for key, inner in value.items()}
    copy = value.copy()
    copy[path[0]] = _with(value[path[0]], path[1:], text)
    return copy


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    write_artefacts(folder)
    return folder


def test_markup_in_every_text_of_every_manifest_is_text(folder: Path, tmp_path: Path) -> None:
    plain = page_of(folder, tmp_path / "plain.html")
    shown = []
    for kind in ("metrics", "ae", "motion"):
        manifest = folder / kind / "manifest.json"
        before = manifest.read_text()
        for path in _texts(json.loads(before)):
            manifest.write_text(json.dumps(_with(json.loads(before), path, ENDING)))
            try:
                page = page_of(folder, tmp_path / "page.html")
            except PumpsError:
                continue  # refused: what it says is not such a text
            finally:
                manifest.write_text(before)
            assert "pwn" not in " ".join(page.not_text), (kind, path)
            extra = page.elements - plain.elements
            assert set(extra) <= {"dt", "dd", "li", "code", "details", "summary"}, (kind, path, extra)
            if "pwn" in page.text:
                assert EVIL[:16] in page.text  # of a digest no more is shown
                shown.append((kind, path[0]))
    # Names such as `stage` and `created_by` are refused when the manifest is opened; free texts are shown as text.
    free = {("ae", "licences"), ("metrics", "config"), ("metrics", "summary"), ("motion", "licences")}
    assert free <= {*shown}


@pytest.mark.parametrize(
    "field", ["clip", "skeleton", "archive", "method", "task", "metric", "figure", "source", "joint", "licence"]
)
def test_markup_in_every_text_of_the_tables_is_text(folder: Path, tmp_path: Path, field: str) -> None:
    plain = page_of(folder, tmp_path / "plain.html")
    evil = EVIL.replace("\u202e", "") if field == "clip" else EVIL
    write_artefacts(tmp_path, {field: evil})
    page = page_of(tmp_path, tmp_path / "page.html")
    assert "pwn" not in " ".join(page.not_text)
    # Rows and sections depend on the names; nothing that runs or loads may come with them.
    for element in ("script", "img", "iframe", "object", "link", "style", "script of True", "script of False"):
        assert page.elements[element] == plain.elements[element], element
    if field in ("archive", "method", "figure", "licence"):
        assert "pwn" in page.text
    picture = (tmp_path / "page.svg").read_text(encoding="utf-8")
    assert "<img" not in picture and "<script" not in picture


def test_two_manifests_cannot_make_a_script_between_them(folder: Path, tmp_path: Path) -> None:
    for name, digest, by in (("x1", "<script>/*", "*/document.title=`RAN`/*"), ("x2", "*/</script>", "pumps 0.1.0")):
        shutil.copytree(folder / "ae", tmp_path / name)
        manifest = json.loads((tmp_path / name / "manifest.json").read_text())
        (tmp_path / name / "manifest.json").write_text(json.dumps(manifest | {"digest": digest, "created_by": by}))
    page = tmp_path / "page.html"
    try:
        run(Config(checkpoints=(tmp_path / "x1", tmp_path / "x2"), output=page))
    except PumpsError:
        assert not page.exists()
        return
    text = page.read_text(encoding="utf-8")
    assert text.count("<script") == 2 and "&lt;script&gt;/*" in text
