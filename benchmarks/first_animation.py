"""The README's animation: embedded clips on three rigs, their keys, plain interpolation, and pumps. Reads no archive.

    python benchmarks/first_animation.py [runs/first-animation] [--weights NAME] [--animation FILE.svg]

The rigs are the clips' own, one of other names and proportions in a T-pose (docs/examples/other_rig.bvh), and one
with twice the spine, twist joints, fingers and other local axes. Each --weights has a column: shipped names, or
folders of weights, such as those adapted to one's own recordings.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gallery import cut, on_changed_rig

from data_schemas.errors import PumpsError
from data_schemas.whole_file import write_whole
from stages.infill import config as infill_config
from stages.infill import run as infill_run
from stages.report import config as report_config
from stages.report import run as report_run
from stages.retarget import config as retarget_config
from stages.retarget import run as retarget_run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.weights.shipped import default_weights

ROOT = Path(__file__).resolve().parents[1]
OTHER_RIG = ROOT / "docs" / "examples" / "other_rig.bvh"
OWN, OTHER, CHANGED = "its own rig", "other names and proportions", "fingers, twists, turned axes"
MOST_BYTES = 2_000_000


@dataclass(frozen=True)
class Animated:
    """A row: an embedded clip, the rig that it is on, and the frames that are known."""

    title: str
    clip: str
    rig: str
    keyframes: str

    @property
    def name(self) -> str:
        return f"{self.title}: {self.rig}"


ROWS = (
    Animated("dance", "dance_b", OWN, "0:45,76:"),
    Animated("run", "run", OTHER, "every:10"),
    Animated("cartwheel", "cartwheel", CHANGED, "every:15"),
)


def main() -> None:
    """Read the arguments, make the animation, and say what was made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("runs/first-animation"))
    parser.add_argument("--weights", action="append", metavar="NAME")
    parser.add_argument("--animation", type=Path, default=Path("docs/pictures/first-animation.svg"))
    options = parser.parse_args()
    try:
        print("\n".join(animate(ROWS, options.folder, options.weights or [default_weights()], options.animation)))
    except PumpsError as error:
        sys.exit(f"{error} {error.hint or ''}".strip())


def animate(rows: Sequence[Animated], folder: Path, weights: Sequence[str], animation: Path) -> list[str]:
    """Write the motions, a page that plays them, and the animation; returns lines on what was made."""
    motions, keys = [], []
    for row in rows:
        truth = true_motion(row, folder)
        motions.append(f"{row.name}/truth={truth}")
        keys.append(f"{row.name}={row.keyframes}")
        for each in weights:
            filled = folder / Path(each).name / truth.name
            filled.parent.mkdir(parents=True, exist_ok=True)
            infill_run.run(
                infill_config.Config(
                    input=truth, output=filled, keyframes=row.keyframes, weights=each, overwrite=True
                )
            )
            motions.append(f"{row.name}/{Path(each).name}={filled}")
    report = report_run.run(
        report_config.Config(
            title="Three rigs, filled", motions=tuple(motions), scene_keyframes=tuple(keys), animation=animation,
            output=folder / "page.html", overwrite=True,
        )
    )  # fmt: skip
    if animation.stat().st_size > MOST_BYTES:
        raise PumpsError(f"{animation} has {animation.stat().st_size} bytes.", "Give fewer --weights.")
    return list(report.lines)


def true_motion(row: Animated, folder: Path) -> Path:
    """The middle of the clip on the row's rig, as a BVH in `folder`."""
    source = ROOT / "stages" / "shared" / "clips" / f"{row.clip}.bvh"
    skeleton, motion = motion_of(read_bvh(source.read_bytes(), source.name))[:2]
    motion = cut(motion)
    shown, truth = folder / "clips" / f"{row.clip}.bvh", folder / "truth" / f"{row.clip}.bvh"
    for path in (shown, truth):
        path.parent.mkdir(parents=True, exist_ok=True)
    if row.rig == CHANGED:
        skeleton, motion = on_changed_rig(skeleton, motion)
    write_whole(truth if row.rig != OTHER else shown, bvh_of_motion(skeleton, motion, row.clip, decimals=4))
    if row.rig == OTHER:
        retarget_run.run(retarget_config.Config(input=shown, to=OTHER_RIG, output=truth, overwrite=True))
    return truth


if __name__ == "__main__":
    main()
