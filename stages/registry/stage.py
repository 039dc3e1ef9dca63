"""What is known about one stage: its command, what it reads and writes, and its place in a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stages.shared.contract import StageConfig, StageReport


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline, or a tool beside it.

    command:   the words after `pumps` ("train", "ae"). `auto` at their end means the stage itself, beside its forms.
    summary:   one sentence for help and tables.
    reads:     kinds of artefacts or files that it reads.
    writes:    kind of artefact or file that it writes; "" for a tool that only prints.
    example:   a command line that a user would type.
    arguments: fields of its Config that are given by position, not by flag.
    needs:     in a run, the stages whose outputs it reads.
    inputs:    in a run, how those outputs are given to it: (field of its Config, place). A place is a path in the
               run's folder that begins with a stage's name, "." for the folder itself, or {weights} for weights to
               compare; {clip} stands for each of the run's clips in turn. "LABEL=" may come before a place.
    target:    in a run, the file in its folder that is there when the stage is done.
    writes_file: whether its output is that file instead of the folder.
    pipeline:  False for a tool that is not a node of a run.
    form_of:   for a further command of a stage, the stage's name: the two share their settings.
    fixed:     settings that this command fixes, which have no flags.
    without:   settings that have no meaning for this command, and have no flags.
    """

    command: tuple[str, ...]
    summary: str
    reads: tuple[str, ...]
    writes: str
    example: str
    arguments: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    target: str = "manifest.json"
    writes_file: bool = False
    pipeline: bool = True
    form_of: str = ""
    fixed: tuple[tuple[str, str], ...] = ()
    without: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Its table in a preset, its config file and its folder in a run: the words typed ("train-ae")."""
        return "-".join(word for word in self.command if word != "auto")

    @property
    def package(self) -> str:
        """The package that holds `config.Config` and `run.run`: the words typed again ("stages.train.ae")."""
        words = (self.form_of,) if self.form_of else self.command
        return ".".join(("stages", *(word.replace("-", "_") for word in words if word != "auto")))

    def config_type(self) -> type[StageConfig]:
        """The stage's Config. Loads no torch."""
        return import_module(f"{self.package}.config").Config

    def runner(self) -> Callable[..., StageReport]:
        """The stage's `run(config, *, progress)`. Loads whatever the stage computes with."""
        return import_module(f"{self.package}.run").run
