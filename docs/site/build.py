"""The documentation site: pages of docs/, a reference from docstrings, a gallery that plays. Opens offline.

    python docs/site/build.py [-o runs/site] [--clips dance_b jump]

Each page has one source: the Markdown files and notebooks of the repository, which are copied with their links turned
to the places that pages have on the site. Linked files that are no pages come along. Any warning of the generator is
an error.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
AT_THE_TOP = ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
CLIPS = ("dance_b", "jump", "spinkick", "cartwheel")
KEYS = "every:15"
PLAYER = "gallery_player.html"
SETTINGS = "zensical.toml"  # a copy lies in every site
_LINK = re.compile(r"(\]\()([^)#:\s]+)(#[^)\s]*)?(\))")
_WARNINGS = re.compile(r"^(griffe|mkdocs_autorefs|mkdocstrings|warning)\b", re.I | re.M)  # --strict lets some pass
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_TEXTS = (".py", ".toml", ".mk", "")


def build(output: Path, player: Path) -> Path:
    """Build the site; returns its folder, whose index.html is the first page.

    Args:
        output: a folder of the site alone: a new or empty one, or one of an earlier build, which is replaced.
        player: the page that the gallery plays.

    Raises:
        SystemExit: the folder holds something else, a link leads nowhere, or the generator warned of something.
    """
    pages = output / "pages"
    if output.exists():
        if any(output.iterdir()) and not (output / SETTINGS).is_file():
            raise SystemExit(f"{output} holds something else than a site. Give another folder: -o FOLDER.")
        shutil.rmtree(output)
    pages.mkdir(parents=True)
    collect(pages)
    shutil.copy(player, pages / PLAYER)
    shutil.copy(HERE / SETTINGS, output)
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    made = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--strict", "--clean"], cwd=output,
        env={**os.environ, "PYTHONPATH": paths}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    said = _COLOUR.sub("", made.stdout).partition("Traceback")[0]
    if made.returncode or _WARNINGS.search(said):
        raise SystemExit(f"{said}\nThe site was not built: mend what is listed above.")
    return output / "html"


def places() -> dict[Path, Path]:
    """The pages: file of the repository -> place on the site."""
    found = {ROOT / "README.md": Path("index.md"), **{ROOT / name: Path(name) for name in AT_THE_TOP}}
    found |= {path: path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md") if path.parent != HERE}
    notebooks = {path: Path("notebooks", f"{path.stem}.md") for path in (ROOT / "docs" / "notebooks").glob("*.ipynb")}
    return found | notebooks | {path: Path(path.name) for path in HERE.glob("*.md")}


def collect(pages: Path) -> None:
    """Copy all pages and what they link to into the folder that the generator reads."""
    placed = places()
    for path, place in placed.items():
        moved = partial(_moved, page=path, placed=placed, pages=pages)
        target = pages / place
        target.parent.mkdir(parents=True, exist_ok=True)
        written = path.read_text(encoding="utf-8")
        text = notebook_page(written, target) if path.suffix == ".ipynb" else _LINK.sub(moved, written)
        target.write_text(text.replace("GALLERY", PLAYER), encoding="utf-8")
    for asset in ("site.css", "iframe-worker.js"):
        shutil.copy(HERE / asset, pages)


def notebook_page(notebook: str, target: Path) -> str:
    """A notebook as Markdown: text, code, and what this printed and drew. Pictures are written beside `target`."""
    parts, pictures = [], 0
    for cell in json.loads(notebook)["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for made in cell.get("outputs", []):
            if "text" in made:
                parts.append(f"```text\n{''.join(made['text']).rstrip()}\n```")
            elif picture := made.get("data", {}).get("image/png"):
                pictures += 1
                file = target.with_name(f"{target.stem}-{pictures}.png")
                file.write_bytes(base64.b64decode("".join(picture)))
                parts.append(f"![What the code above draws]({file.name})")
    return "\n\n".join(parts) + "\n"


def make_player(clips: Sequence[str], work: Path) -> Path:
    """Fill embedded clips with the default weights; returns the page that plays them beside truth and slerp."""
    source, filled, page = work / "clips", work / "filled", work / PLAYER
    source.mkdir()
    for clip in clips:
        shutil.copy(ROOT / "stages" / "shared" / "clips" / f"{clip}.bvh", source)
    _pumps("infill", str(source), "--keyframes", KEYS, "-o", str(filled), "--jobs", "1")
    words = ["report", "--keyframes", KEYS, "--title", "Filled between keyframes", "-o", str(page)]
    for clip in clips:
        words += ["--motions", f"{clip}/truth={source / clip}.bvh", "--motions", f"{clip}/filled={filled / clip}.bvh"]
    _pumps(*words)
    return page


def _pumps(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "pumps_cli", *words, "--quiet"], cwd=ROOT, check=True)


def _moved(link: re.Match[str], page: Path, placed: dict[Path, Path], pages: Path) -> str:
    """A link of a page, from its place on the site; files that are no pages are copied to the site."""
    before, target, anchor, after = link[1], link[2], link[3] or "", link[4]
    linked = (page.parent / target).resolve()
    if not linked.is_file():  # code that looks like a link; the generator warns of links that lead nowhere
        return link[0]
    place = placed.get(linked)
    if place is None:
        name = linked.relative_to(ROOT)
        place = Path("files", *name.parts[1:]) if name.parts[0] == "docs" else Path("files", name)
        if linked.suffix in _TEXTS:
            place = place.with_name(f"{place.name}.txt")  # so that browsers show it
        (pages / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(linked, pages / place)
    return f"{before}{os.path.relpath(place, placed[page].parent).replace(os.sep, '/')}{anchor}{after}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/site"), metavar="FOLDER")
    parser.add_argument("--clips", nargs="+", default=CLIPS, metavar="CLIP")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        print(f"Site: {build(given.output.resolve(), make_player(given.clips, Path(work))) / 'index.html'}")
