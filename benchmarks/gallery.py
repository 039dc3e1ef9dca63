"""Twelve clips on six rigs, filled: truth, slerp and pumps side by side on one page, and some of them as a picture.

    python benchmarks/gallery.py [../shared/data [runs/gallery]] [--weights NAME] [--picture docs/gallery.svg]

The clips are test clips of public archives and embedded ones, four seconds from the middle of each at 30 frames a
second. They are written as BVH, filled as `pumps infill` fills any file, and played by `pumps report`. The sixth rig
is one that nobody has: test clips on a skeleton with twice the spine, twist joints, fingers and other local axes.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

import stages.shared.clips
from data_schemas.errors import InputError, PumpsError
from data_schemas.skeleton import Motion, Skeleton
from data_schemas.whole_file import write_whole
from stages.infill import config as infill_config
from stages.infill import run as infill_run
from stages.ingest.licences import licence_of
from stages.report import config as report_config
from stages.report import run as report_run
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.bvh_of_motion import bvh_of_motion
from stages.shared.formats.readers import read_recordings, recognise
from stages.shared.formats.recording import Asked, recording_of
from stages.shared.formats.source_body import SourcePoses, SourceRig
from stages.shared.formats.sources import source_named
from stages.shared.humanoid.rig_changes import RIGS, Rigged
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward import local_rotations
from stages.shared.kinematics.resampling import resample
from stages.shared.weights.shipped import default_weights

FRAMES = 121
CHANGED = "all-of-these"  # of `RIGS`


@dataclass(frozen=True)
class Shown:
    """A clip of the gallery.

    place: the archive's member, or an embedded clip's name. every: frames between keys; missing: those of the one gap
    in its middle, where `every` is 0. changed: on the rig that nobody has. fps: the rate where the file's is wrong.
    """

    rig: str
    name: str
    place: str
    every: int = 0
    missing: int = 0
    changed: bool = False
    fps: float | None = None

    def keys(self, frames: int) -> str:
        """The keys of a clip of so many frames, as `pumps infill --keyframes` takes them."""
        first = (frames - self.missing) // 2
        return f"every:{self.every}" if self.every else f"0:{first},{first + self.missing}:"

    @property
    def words(self) -> str:
        """The keys in words."""
        return f"a key every {self.every} frames" if self.every else f"{self.missing} frames missing"


_BANDAI, _SALSA = "bandai-namco-1.zip!bandai-namco-1/dataset-1", "cmu-dance.zip!cmu-dance/salsa"
_ASF, _G1 = "cmu-asfamc.zip!cmu-asfamc", "lafan1-g1.zip!lafan1-g1"
CLIPS = (
    Shown("Bandai Namco", "punch", f"{_BANDAI}_punch_normal_001.bvh", every=15),
    Shown("Bandai Namco", "dash", f"{_BANDAI}_dash_childish_001.bvh", missing=30),
    Shown("CMU, DAZ", "salsa 5", f"{_SALSA}/05.bvh", every=30, fps=60),
    Shown("CMU, DAZ", "salsa 14", f"{_SALSA}/14.bvh", missing=30, fps=60),
    Shown("CMU, ASF", "climbing", f"{_ASF}/01/01_02.amc", every=30),
    Shown("CMU, ASF", "swordplay", f"{_ASF}/02/02_09.amc", every=15),
    Shown("G1 robot", "running", f"{_G1}/run2_subject4.bvh", every=15),
    Shown("G1 robot", "dance", f"{_G1}/dance2_subject4.bvh", every=30),
    Shown("embedded", "dance", "dance_b", every=15),
    Shown("embedded", "getting up", "getup_facedown", missing=30),
    Shown("changed rig", "walk", f"{_BANDAI}_walk_tired_002.bvh", every=30, changed=True),
    Shown("changed rig", "guiding", f"{_BANDAI}_guide_not-confident_001.bvh", every=15, changed=True),
)


def main() -> None:
    """Read the arguments, make the gallery, and say what was made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "archives", type=Path, nargs="?", default=Path("../shared/data"), help="folder of the archives"
    )
    parser.add_argument(
        "folder", type=Path, nargs="?", default=Path("runs/gallery"), help="where the motions and gallery.html go"
    )
    parser.add_argument("--weights", default=default_weights())
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    try:
        print("\n".join(gallery(CLIPS, options.archives, options.folder, options.weights, options.picture)))
    except PumpsError as error:
        sys.exit(f"{error} {error.hint or ''}".strip())


def gallery(
    clips: tuple[Shown, ...], archives: Path, folder: Path, weights: str, picture: Path | None = None
) -> list[str]:
    """Write the motions and the page, and give lines on what was made.

    Raises: InputError where an archive is not there.
    """
    wanted = sorted({each.place.partition("!")[0] for each in clips if "!" in each.place})
    absent = [name for name in wanted if not (archives / name).is_file()]
    if absent:
        raise InputError(
            f"The gallery needs {', '.join(absent)} in {archives}: name another folder with SHARED_DATA=FOLDER;"
            " `pumps data list` says where the archives come from."
        )
    motions, keys, names, lines = [], [], [], []
    for number, shown in enumerate(clips):
        began = time.perf_counter()
        stem = f"{number + 1:02d}-{shown.name.replace(' ', '-')}"
        truth, filled = folder / "truth" / f"{stem}.bvh", folder / "filled" / f"{stem}.bvh"
        for path in (truth, filled):
            path.parent.mkdir(parents=True, exist_ok=True)
        skeleton, motion = four_seconds(shown, archives)
        frames = shown.keys(motion.frames)
        write_whole(truth, bvh_of_motion(skeleton, motion, stem, decimals=4))
        infill_run.run(
            infill_config.Config(input=truth, output=filled, keyframes=frames, weights=weights, overwrite=True)
        )
        scene = f"{shown.name}, {shown.rig}: {shown.words}"
        motions += [f"{scene}/truth={truth}", f"{scene}/{Path(weights).name}={filled}"]
        keys.append(f"{scene}={frames}")
        names.append(scene)
        lines.append(f"{scene} ({time.perf_counter() - began:.1f} s)")
    report = report_run.run(
        report_config.Config(
            title=f"Twelve clips on six rigs, filled by {Path(weights).name}", motions=tuple(motions),
            scene_keyframes=tuple(keys), licences=_licences(clips), output=folder / "gallery.html", picture=picture,
            pictured=tuple(n for n, c in zip(names, clips, strict=True) if c in _pictured(clips)), overwrite=True,
        )
    )  # fmt: skip
    return [*lines, *report.lines]


def _licences(clips: tuple[Shown, ...]) -> tuple[str, ...]:
    """Those of the archives, and of the embedded clips."""
    found = {licence_of(each.place.partition("!")[0], None) for each in clips if "!" in each.place}
    told = json.loads((Path(stages.shared.clips.__file__).parent / "splits.json").read_text(encoding="utf-8"))
    return (*sorted(found), told["clips"]["licence"])


def _pictured(clips: tuple[Shown, ...]) -> list[Shown]:
    """The first clip of each rig."""
    return list({each.rig: each for each in reversed(clips)}.values())


def four_seconds(shown: Shown, archives: Path) -> tuple[Skeleton, Motion]:
    """The middle of a clip at 30 frames a second, on its own rig or on the one that nobody has."""
    if "!" not in shown.place:
        path = Path(stages.shared.clips.__file__).parent / f"{shown.place}.bvh"
        skeleton, motion = motion_of(read_bvh(path.read_bytes(), path.name))[:2]
    else:
        source = source_named(str(archives / shown.place))
        data = source.read()
        chosen = recognise(data, source.name)
        if chosen is None:
            raise InputError(f"{source.name} is not a recording that pumps knows.")
        recording = read_recordings(data, source, chosen, Asked(fps_override=shown.fps))[0]
        skeleton, motion = recording.skeleton, recording.motion
    motion = cut(resample(motion, MODEL_FPS))
    return on_changed_rig(skeleton, motion) if shown.changed else (skeleton, motion)


def cut(motion: Motion) -> Motion:
    """The middle `FRAMES` of a motion, or all of a shorter one."""
    first = max((motion.frames - FRAMES) // 2, 0)
    return motion.at(slice(first, first + FRAMES))


def on_changed_rig(skeleton: Skeleton, motion: Motion) -> tuple[Skeleton, Motion]:
    """The motion on a rig with more of everything, in joints' own axes that are turned at random."""
    made = RIGS[CHANGED](Rigged(skeleton, motion), np.random.default_rng(0))
    body, moved = made.skeleton, made.motion
    placed = np.isin(np.arange(body.joints), moved.track_joints) | (body.parents < 0)
    rig = SourceRig(
        body.names, tuple(body.parents.tolist()), tuple(map(tuple, body.offsets.tolist())),
        tuple(map(tuple, body.tails.tolist())), tuple(placed.tolist()), unit_m=1.0, up_axis="y",
    )  # fmt: skip
    local = local_rotations(torch.as_tensor(moved.rotations), body.parents).numpy()
    poses = SourcePoses(local, moved.root_positions, moved.fps, moved.track_joints.tolist(), moved.tracks)
    recording = recording_of("the changed rig", rig, poses, Asked())
    return recording.skeleton, recording.motion


if __name__ == "__main__":
    main()
