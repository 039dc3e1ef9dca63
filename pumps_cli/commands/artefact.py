"""`pumps artefact`: what an artefact is, whether it is as it was written, what it was made from; several into one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pumps_cli.help_page import HelpCommand, HelpGroup
from pumps_cli.outcome import Manner, errors_reported, show
from pumps_cli.stage_command import AsJson, Debug, Quiet

if TYPE_CHECKING:
    from data_schemas.artefact import Artefact, LineageNode

BAD_INPUT = 3
_WIDEST_VALUE = 200
_OLDER = (
    "An older pumps wrote it: its config, inputs, licences and summary are not covered by a digest. Run the stage "
    "that made it again to cover them."
)

app = typer.Typer(cls=HelpGroup, no_args_is_help=True, epilog="Example: pumps artefact show runs/demo/ingest")

ArtefactPath = Annotated[Path, typer.Argument(help="Folder of the artefact.", show_default=False)]


@app.callback()
def _group() -> None:
    """Show an artefact, check its digests, draw what it came from."""


@app.command("show", cls=HelpCommand, epilog="Example: pumps artefact show runs/demo/ingest")
def show_artefact(path: ArtefactPath, quiet: Quiet = False, as_json: AsJson = False, debug: Debug = False) -> None:
    """Print what an artefact is: kind, stage, config, inputs, licences, files and summary."""
    from data_schemas.artefact import open_artefact

    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps artefact show"):
        artefact = open_artefact(path)
        show(manner, lambda: list(_description(artefact)), artefact.manifest.model_dump)


@app.command("verify", cls=HelpCommand, epilog="Example: pumps artefact verify runs/demo/ingest")
def verify_artefact(path: ArtefactPath, quiet: Quiet = False, as_json: AsJson = False, debug: Debug = False) -> None:
    """Compare every file and the manifest's own fields with their digests; exit code 3 if any has changed."""
    from data_schemas.artefact import covers_manifest, open_artefact, verify

    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps artefact verify"):
        problems = verify(path)
        manifest = open_artefact(path).manifest
        covered = covers_manifest(manifest)
        whole = f"{len(manifest.files)} files{' and the manifest' if covered else ''} are as they were written."
        verdict = [*(problems or [whole]), *([] if covered else [_OLDER])]
        lines = [f"{path}: {sentence}" for sentence in verdict]
        data = {"path": str(path), "problems": problems, "manifest_covered": covered}
        show(manner, lambda: lines, lambda: data)
        if problems:
            raise typer.Exit(BAD_INPUT)


@app.command("lineage", cls=HelpCommand, epilog="Example: pumps artefact lineage runs/demo/evaluate")
def draw_lineage(path: ArtefactPath, quiet: Quiet = False, as_json: AsJson = False, debug: Debug = False) -> None:
    """Draw what an artefact was made from, and say which inputs have changed since or are gone."""
    from data_schemas.artefact import lineage

    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps artefact lineage"):
        tree = lineage(path)
        show(manner, lambda: list(_drawing(tree)), lambda: _as_data(tree))


@app.command("merge", cls=HelpCommand, epilog="Example: pumps artefact merge part-1 part-2 part-3 -o whole")
def merge(
    paths: Annotated[list[Path], typer.Argument(help="Artefacts of clips, of one kind.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="PATH", help="Folder of the artefact to write.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an output that exists.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Join several artefacts of clips into one: the parts that stages made with --shard."""
    from data_schemas.manifest import MANIFEST_NAME
    from data_schemas.merging import merge_artefacts
    from stages.shared.outputs import check_replaceable

    manner = Manner(quiet=quiet, json=as_json, debug=debug)
    with errors_reported(manner, "pumps artefact merge"):
        if (output / MANIFEST_NAME).exists():
            check_replaceable(output, overwrite, [("an input", path) for path in paths])
        rows = merge_artefacts(paths, output)
        figures = {"clips": len(rows), "frames": sum(row.frames for row in rows), "output": str(output)}
        line = f"{output}: {len(rows)} clips, {figures['frames']} frames of {len(paths)} artefacts."
        show(manner, lambda: [line], lambda: figures)


def _description(artefact: Artefact) -> Iterator[str]:
    from data_schemas.kinds import KINDS

    manifest = artefact.manifest
    yield f"{artefact.path}: {manifest.kind}, version {manifest.schema_version} ({KINDS[manifest.kind].what})"
    yield f"  made by   {manifest.stage} ({manifest.created_by})"
    yield f"  digest    {manifest.digest}"
    for title, items in (
        ("licences", manifest.licences),
        ("inputs", [f"{item.path} ({item.kind} {item.digest[:12]})" for item in manifest.inputs]),
        ("files", [f"{manifest.data}/{n} ({_size((artefact.folder / n).stat().st_size)})" for n in manifest.files]),
        ("summary", [f"{name} = {_short(value)}" for name, value in manifest.summary.items()]),
        ("config", [f"{name} = {_short(value)}" for name, value in manifest.config.items()]),
    ):
        yield f"  {title}" if items else f"  {title:<9} none"
        for item in items:
            yield f"    {item}"


def _drawing(node: LineageNode) -> Iterator[str]:
    """The tree in lines; what several stages read is followed once."""
    followed: set[tuple[Path, str]] = set()

    def lines(node: LineageNode, first: str, rest: str) -> Iterator[str]:
        key = (node.path.resolve() if node.state != "missing" else node.path, node.digest)
        known = bool(node.inputs) and key in followed
        followed.add(key)
        yield first + _node_text(node) + (" (see above)" if known else "")
        inputs = () if known else node.inputs
        for index, item in enumerate(inputs):
            last = index == len(inputs) - 1
            yield from lines(item, rest + ("└─ " if last else "├─ "), rest + ("   " if last else "│  "))

    return lines(node, "", "")


def _node_text(node: LineageNode) -> str:
    state = {
        "same": "",
        "changed": ": CHANGED since it was read",
        "missing": ": MISSING",
        "damaged": ": DAMAGED",
        "cyclic": ": its own input, which cannot be",
        "unchecked": ": not checked",
    }[node.state]
    stage = f" by {node.stage}" if node.stage else ""
    return f"{_near(node.path)}  {node.kind}{stage} {node.digest[:12]}{state}"


def _near(path: Path) -> str:
    """The path as seen from the current folder, if it lies below it."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


def _as_data(node: LineageNode) -> dict[str, Any]:
    return {
        "path": str(node.path),
        "kind": node.kind,
        "stage": node.stage,
        "digest": node.digest,
        "state": node.state,
        "created_by": node.created_by,
        "licences": list(node.licences),
        "inputs": [_as_data(item) for item in node.inputs],
    }


def _short(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _WIDEST_VALUE else f"{text[:_WIDEST_VALUE]}... (--json shows all)"


def _size(size: float) -> str:
    for unit in ("bytes", "kB", "MB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} GB"
