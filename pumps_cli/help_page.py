"""The help page of a command: usage, what it does, panels of arguments, options or commands, an example."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

EVERY_COMMAND = "Every command"
_WIDEST_PAGE = 120
_WIDEST_LEFT = 34  # columns for names; a longer name has its text on the next lines
_NARROW, _NARROW_LEFT = 100, 28
_GAP = 2


@dataclass(frozen=True)
class ShownAs:
    """How help shows parameters, by their names.

    needed: those that must be given, though the parser does not ask for them.
    rare:   those that are shown by `--help-all` only.
    on:     flags that are on by default, and are shown as --[no-]NAME.
    """

    needed: frozenset[str] = frozenset()
    rare: frozenset[str] = frozenset()
    on: frozenset[str] = frozenset()


class HelpCommand(TyperCommand):
    """A command with the help page of this module."""

    shown_as = ShownAs()

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        params = [param for param in self.get_params(ctx) if not _is_hidden(param)]
        places = [_place(param, self._is_needed(param)) for param in params if _is_argument(param)]
        flags = [
            f"{_long_name(param, self.shown_as)} {param.metavar or 'PATH'}"
            for param in params
            if not _is_argument(param) and self._is_needed(param)
        ]
        return [*places, *flags, "[OPTIONS]"]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        self.print_help(ctx, everything=False)

    def print_help(self, ctx: Any, *, everything: bool) -> None:
        """Print the page, with the rarely set options or without them."""
        params: list[Any] = [param for param in self.get_params(ctx) if not _is_hidden(param)]
        shown = [param for param in params if everything or param.name not in self.shown_as.rare]
        arguments = [(_argument_name(param), param.help or "") for param in shown if _is_argument(param)]
        options = [param for param in shown if not _is_argument(param)]
        _print_page(ctx, self, [("Arguments", arguments), *_option_panels(options, self.shown_as)])

    def _is_needed(self, param: Any) -> bool:
        return param.required or param.name in self.shown_as.needed


class HelpGroup(TyperGroup):
    """A group of commands with the help page of this module."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        return ["COMMAND"]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        panels: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            if command is not None and not command.hidden:
                panel = getattr(command, "rich_help_panel", None)
                panels.setdefault(panel if isinstance(panel, str) else "Commands", []).append(
                    (name, command.help or "")
                )
        options = [param for param in self.get_params(ctx) if not _is_hidden(param)]
        below = _option_panels(options, ShownAs()) if len(options) > 1 else []
        _print_page(ctx, self, [*panels.items(), *below])


def _is_argument(param: Any) -> bool:
    return param.param_type_name == "argument"


def _is_hidden(param: Any) -> bool:
    return getattr(param, "hidden", False)


def _argument_name(param: Any) -> str:
    name = param.metavar or param.name.upper()
    return f"{name}..." if param.nargs != 1 else name


def _place(param: Any, needed: bool) -> str:
    return _argument_name(param) if needed else f"[{_argument_name(param)}]"


def _long_name(param: Any, shown_as: ShownAs) -> str:
    """ "--steps", or "--[no-]augment" for a flag that is on by default."""
    name = next(opt for opt in param.opts if opt.startswith("--"))
    if param.name not in shown_as.on:
        return name
    before, _, after = param.secondary_opts[0].rpartition("no-")
    return f"{before}[no-]{after}"


def _option_panels(params: Iterable[Any], shown_as: ShownAs) -> list[tuple[str, list[tuple[str, str]]]]:
    """Title and rows of each panel; the options of every command come last."""
    panels: dict[str, list[Any]] = {"Options": []}
    for param in params:
        own = getattr(param, "rich_help_panel", None)
        panels.setdefault(own if isinstance(own, str) else "Options", []).append(param)
    if EVERY_COMMAND in panels:
        helps = [param for param in panels["Options"] if param.name == "help"]
        panels["Options"] = [param for param in panels["Options"] if param.name != "help"]
        panels[EVERY_COMMAND] = [*panels.pop(EVERY_COMMAND), *helps]
    return [(title, [_option_row(param, among, shown_as) for param in among]) for title, among in panels.items()]


def _option_row(param: Any, among: Sequence[Any], shown_as: ShownAs) -> tuple[str, str]:
    shorts = [opt for opt in param.opts if not opt.startswith("--")]
    some_short = any(not opt.startswith("--") for each in among for opt in each.opts)
    first = f"{shorts[0]}, " if shorts else "    " if some_short else ""
    metavar = "" if param.is_flag else f" {param.metavar or 'TEXT'}"
    return f"{first}{_long_name(param, shown_as)}{metavar}", param.help or ""


def _print_page(
    ctx: Any, command: TyperCommand | TyperGroup, panels: Sequence[tuple[str, Sequence[tuple[str, str]]]]
) -> None:
    """Print a page. In a group, the names of all commands take the same width."""
    from rich.console import Console
    from rich.panel import Panel
    from rich.text import Text

    console = Console(highlight=False)
    width = min(console.width, _WIDEST_PAGE)
    room = width - 4
    pieces = " ".join(command.collect_usage_pieces(ctx))
    usage = textwrap.wrap(
        f"Usage: {ctx.command_path} {pieces}", width - 1, subsequent_indent="       ", break_on_hyphens=False
    )
    console.print(Text("\n".join(usage), style="bold"), soft_wrap=True)
    for paragraph in (command.help or "").split("\n\n"):
        console.print()
        console.print(Text("\n".join(textwrap.wrap(paragraph, width - 1))), soft_wrap=True)
    console.print()
    limit = _WIDEST_LEFT if width >= _NARROW else _NARROW_LEFT
    lefts = [name for _, rows in panels for name, _ in rows]
    commands = [name for name in lefts if isinstance(command, TyperGroup) and not name.strip().startswith("-")]
    for title, rows in panels:
        if rows:
            names = [name for name, _ in rows]
            left = min(limit, max(len(name) for name in (commands if names[0] in commands else names)))
            text = Text("\n").join(line for row in rows for line in _lines(*row, left, room))
            console.print(Panel(text, title=title, title_align="left", border_style="dim", width=width))
    if command.epilog:
        console.print()
        console.print(Text(command.epilog), soft_wrap=True)


def _lines(name: str, text: str, left: int, room: int) -> Iterator[Any]:
    """One row: the name and beside it, or below it where the name is long, the text."""
    from rich.text import Text

    wrapped = textwrap.wrap(text, room - left - _GAP, break_on_hyphens=False) or [""]
    beside = name.ljust(left + _GAP) if len(name) <= left else name
    first = Text(beside)
    first.highlight_regex(r"(?<![\w.])--?[\w\[\].-]+|^[a-z][\w-]*", "bold cyan")
    if len(name) <= left:
        first.append(wrapped.pop(0))
    yield first
    for line in wrapped:
        yield Text(" " * (left + _GAP) + line)


def print_everything(ctx: typer.Context, asked: bool) -> None:
    """The callback of `--help-all`."""
    if asked and isinstance(ctx.command, HelpCommand):
        ctx.command.print_help(ctx, everything=True)
        raise typer.Exit
