"""Count the rooms (modules of `stages`) that a BVH enters in `pumps infill`, and a window in `pumps train lms`.

    python benchmarks/rooms.py [infill] [train-lms] [--json]

The run is traced call by call. A room counts when one of its functions is called; code that runs while modules are
imported does not count. A climb is a room that calls into a room which was entered before it: a reader who follows
the calls goes back up. Each pair of rooms counts once, however often one calls the other. To compare with another
version of the code, give its folder as PYTHONPATH.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import stages
import stages.shared.clips
from stages.infill import config as infill_config
from stages.infill import run as infill
from stages.ingest import config as ingest_config
from stages.ingest import run as ingest
from stages.sample_tpc import config as sample_config
from stages.sample_tpc import run as sample_tpc
from stages.train.ae import config as ae_config
from stages.train.ae import run as train_ae
from stages.train.lms import config as lms_config
from stages.train.lms import run as train_lms

_ROOT = str(Path(stages.__path__[0])) + "/"
_CLIPS = Path(stages.shared.clips.__file__).parent


@dataclass
class Walk:
    """rooms: in the order in which they are entered. doors: (from, to), each pair once, in the order of first use."""

    rooms: list[str] = field(default_factory=list)
    doors: list[tuple[str, str]] = field(default_factory=list)

    @property
    def climbs(self) -> list[tuple[str, str]]:
        """Doors that lead to a room entered earlier."""
        order = {room: place for place, room in enumerate(self.rooms)}
        return [(here, there) for here, there in self.doors if order[there] < order[here]]


def walk_of(run: Callable[[], object]) -> Walk:
    """Trace a run, in all its threads."""
    rooms: dict[str, None] = {}
    doors: dict[tuple[str, str], None] = {}

    def trace(frame: FrameType, event: str, _: Any) -> None:
        if event != "call" or (room := _room(frame.f_code)) is None:
            return
        rooms.setdefault(room)
        caller = frame.f_back
        while caller is not None and (before := _room(caller.f_code)) is None:
            caller = caller.f_back
        if caller is not None and before is not None and before != room:
            doors.setdefault((before, room))

    threading.setprofile(trace)
    sys.setprofile(trace)
    try:
        run()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return Walk(list(rooms), list(doors))


def _room(code: CodeType) -> str | None:
    """The module of `stages` that a function is of; None for others and for what runs at import."""
    if not code.co_filename.startswith(_ROOT) or code.co_name == "<module>":
        return None
    return code.co_filename[len(_ROOT) : -len(".py")]


def infill_walk(folder: Path) -> Walk:
    """A BVH with a keyframe every fifteen frames, with the default weights."""
    settings = {"input": _CLIPS / "walk.bvh", "output": folder / "walk.bvh", "keyframes": "every:15", "device": "cpu"}
    config = infill_config.Config.model_validate(settings)
    return walk_of(lambda: infill.run(config))


def train_lms_walk(folder: Path) -> Walk:
    """One step of the synthesiser's training, behind an autoencoder that was trained for one step."""
    clips = [str(_CLIPS / f"{name}.bvh") for name in ("walk", "run", "jump")]
    motion, tpc, ae, lms = (folder / name for name in ("motion", "tpc", "ae", "lms"))
    ingest.run(ingest_config.Config.model_validate({"sources": clips, "output": motion, "workers": 1}))
    sample_tpc.run(sample_config.Config.model_validate({"motion": motion, "output": tpc}))
    tiny = {"tpc": tpc, "steps": 1, "batch": 2, "window": 24, "points": 32, "device": "cpu"}
    sizes = {
        "encoder": {"width": 8, "heads": 2, "blocks": 2, "neighbours": 4},
        "decoder": {"width": 16, "heads": 2, "layers": 1},
    }
    train_ae.run(ae_config.Config.model_validate({**tiny, **sizes, "output": ae}))
    config = lms_config.Config.model_validate({**tiny, "ae": ae, "output": lms})
    return walk_of(lambda: train_lms.run(config))


WALKS = {"infill": infill_walk, "train-lms": train_lms_walk}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("walks", nargs="*", metavar="WALK", help=", ".join(WALKS))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if unknown := set(options.walks) - set(WALKS):
        parser.error(f"no walks: {', '.join(sorted(unknown))}; there are {', '.join(WALKS)}")
    found = {}
    for name in options.walks or WALKS:
        with tempfile.TemporaryDirectory() as folder:
            found[name] = WALKS[name](Path(folder))
    if options.json:
        print(json.dumps({name: {"rooms": walk.rooms, "climbs": walk.climbs} for name, walk in found.items()}))
        return
    for name, walk in found.items():
        print(f"{name}: {len(walk.rooms)} rooms, {len(walk.climbs)} climbs")
        print("".join(f"  {room}\n" for room in walk.rooms), end="")
        print("".join(f"  climb: {here} -> {there}\n" for here, there in walk.climbs), end="")


if __name__ == "__main__":
    main()
