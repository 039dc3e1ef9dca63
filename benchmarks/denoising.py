"""What `pumps denoise` does to clean and to noisy clips of real archives, beside the best plain filter.

    python benchmarks/denoising.py [ARCHIVE ...] [--most 4] [--page docs/reproduce.md]

Without archives: every archive in ../shared/data that is there. Of each archive `--most` clips, evenly chosen, are
measured, and another one chooses the filters' widths. Clean clips are taken at their own rate, 5 seconds at most;
noise is put on one window of 128 frames at 30 a second from the middle of each. No weights are used.
"""

from __future__ import annotations

import argparse
import tempfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from measuring.section import replace_section

from data_schemas.manifest import open_artefact
from data_schemas.motion import MotionReader
from data_schemas.skeleton import Motion, Skeleton
from stages.ingest.config import Config as IngestConfig
from stages.ingest.run import run as ingest
from stages.shared.formats.readers import AUTO, suffixes_of
from stages.shared.formats.sources import find_sources
from stages.shared.humanoid.symmetric_pairs import pairs_of_limbs
from stages.shared.inference.denoising import denoise_motion, motion_from, positions_in
from stages.shared.kinematics.conventions import MODEL_FPS
from stages.shared.kinematics.forward_numpy import local_rotations_of, positions_of
from stages.shared.kinematics.motion_filters import FILTERS, filter_rotations
from stages.shared.kinematics.resampling import resample
from stages.shared.pose_tasks.noise import NOISES
from stages.shared.solve.robust_smoothing import mend_poses
from stages.shared.statistics.archives import archive_of
from stages.shared.statistics.metrics import acceleration_mm, mpjae_deg, mpjpe_mm

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
NEEDS_MORE = ("action2motion-samples.zip",)  # joint positions, which need a skeleton that is named
SECTION = "denoising"
SECONDS, FRAMES = 5.0, 128
WIDTHS = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0)
FILTERED = ("paper", "capture")  # noises that filters are measured on
NOISY, MEND, SIDES_LEFT = "as it is", "`mend`", "`mend`, sides not put back"
Pose = tuple[np.ndarray, np.ndarray]  # positions (T, C), local rotations (T, J, 4)
Method = Callable[["Case", Pose], Pose]


@dataclass(frozen=True)
class Case:
    """One clip: its motion at its own rate and a window at 30 frames a second."""

    archive: str
    number: int
    skeleton: Skeleton
    motion: Motion
    window: Motion
    limbs: tuple[np.ndarray, ...]

    @property
    def truth(self) -> Pose:
        local = local_rotations_of(self.skeleton, self.window).astype(np.float64)
        return positions_in(self.window), local / np.linalg.norm(local, axis=-1, keepdims=True)

    def noisy(self, noise: str) -> Pose:
        """The window with noise: a draw of its own for each clip, the same for every method. A rig without pairs has
        no sides to exchange."""
        places, local = self.truth
        if noise == "swapped" and not self.limbs:
            return places, local
        rng = np.random.default_rng([zlib.crc32(self.archive.encode()), self.number])
        roots, turned, _ = NOISES[noise](places[:, :3], local, rng, self.limbs)
        return np.concatenate([roots, places[:, 3:]], axis=1), turned

    def errors(self, made: Pose) -> np.ndarray:
        """MPJPE in mm, acceleration error in mm a frame^2, angles in degrees, over the joints of the body."""
        body = self.skeleton.groups >= 0
        motion = motion_from(self.skeleton, self.window, made[1], made[0])
        places = [positions_of(self.skeleton, each)[None, :, body] for each in (motion, self.window)]
        turns = [each.rotations[None, :, body].astype(np.float64) for each in (motion, self.window)]
        found = (mpjpe_mm(*places), acceleration_mm(*places), mpjae_deg(*turns))
        return np.array([float(np.mean(each)) for each in found])

    def change_of_clean(self) -> np.ndarray:
        """By how much `mend` changes the clean clip: mm and degrees on average, and frames in which sides are put
        back."""
        found = denoise_motion(self.skeleton, self.motion, np.zeros((self.motion.frames, self.skeleton.joints), bool))
        places = [positions_of(self.skeleton, each) for each in (found.motion, self.motion)]
        moved = np.linalg.norm(places[0] - places[1], axis=-1)[:, self.skeleton.groups >= 0].mean()
        turned = found.turned_deg[:, self.skeleton.groups >= 0].mean()
        return np.array([1000 * moved, turned, found.swapped.any(axis=1).sum()])


def cases(archives: Sequence[str], most: int, folder: Path) -> Iterator[tuple[bool, Case]]:
    """Clips of all archives, and whether they choose the filters' widths instead of being measured."""
    names: list[str] = []
    for archive in archives:
        found = find_sources([archive], suffixes_of(AUTO))
        names += [found[at].name for at in np.unique(np.linspace(0, len(found) - 1, most + 2).astype(int))]
    ingest(IngestConfig.model_validate({"sources": tuple(names), "output": folder, "workers": 1}))
    with MotionReader(open_artefact(folder, "motion")) as reader:
        for archive in dict.fromkeys(archive_of(row) for row in reader.clips):
            rows = [row for row in reader.clips if archive_of(row) == archive and row.frames >= row.fps]
            for number, row in enumerate(rows[: most + 1]):
                skeleton, motion = reader.skeleton(row.skeleton), reader.motion(row.clip)
                middle = resample(motion, MODEL_FPS)
                start = max(0, (middle.frames - FRAMES) // 2)
                window = middle.at(np.arange(start, min(start + FRAMES, middle.frames)))
                shown = motion.at(np.arange(min(motion.frames, round(SECONDS * motion.fps))))
                limbs = pairs_of_limbs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups)
                yield number == 1, Case(archive, number, skeleton, shown, window, limbs)


def mended(case: Case, noisy: Pose) -> Pose:
    """`pumps denoise` without weights."""
    made = mend_poses(noisy[1], noisy[0], limbs=case.limbs)
    return made.positions, made.local


def mended_as_sided(_: Case, noisy: Pose) -> Pose:
    """The same without looking for exchanged sides."""
    made = mend_poses(noisy[1], noisy[0])
    return made.positions, made.local


def filtered(name: str, width: float) -> Method:
    """A plain filter."""
    chosen = FILTERS[name]
    return lambda _, noisy: (
        chosen(noisy[0], MODEL_FPS, width),
        filter_rotations(noisy[1], MODEL_FPS, chosen, width),
    )


def best_filter(name: str, noise: str, tuning: Sequence[Case]) -> tuple[str, Method]:
    """A filter at the width with the smallest MPJPE on other clips, and its name with that width."""
    errors = [np.mean([case.errors(filtered(name, width)(case, case.noisy(noise)))[0] for case in tuning])
              for width in WIDTHS]  # fmt: skip
    width = WIDTHS[int(np.argmin(errors))]
    return f"{name}, width {width:g}", filtered(name, width)


def noise_tables(measured: Sequence[Case], tuning: Sequence[Case]) -> list[str]:
    """Errors by noise and method, and under the paper's noise by archive."""
    lines = [
        "| noise | method | MPJPE, mm | acceleration, mm a frame^2 | angles, degrees |", "|---|---|---:|---:|---:|",
    ]  # fmt: skip
    of_paper: dict[str, np.ndarray] = {}
    for noise in NOISES:
        noisy = [case.noisy(noise) for case in measured]
        methods: dict[str, Method] = {NOISY: lambda _, pose: pose}
        if noise in FILTERED:
            methods |= dict(best_filter(name, noise, tuning) for name in FILTERS)
        if noise in ("capture", "swapped"):
            methods[SIDES_LEFT] = mended_as_sided
        methods[MEND] = mended
        for name, method in methods.items():
            errors = np.array([case.errors(method(case, pose)) for case, pose in zip(measured, noisy, strict=True)])
            lines.append(f"| {noise} | {name} | {' | '.join(f'{value:.2f}' for value in errors.mean(axis=0))} |")
            if noise == "paper":
                of_paper[name] = errors
    best = min(
        (name for name in of_paper if name.split(",")[0] in FILTERS), key=lambda name: of_paper[name][:, 0].mean()
    )
    lines += ["", f"Noise `paper` by archive; the best filter is {best}:", ""]
    lines += ["| archive | clips | MPJPE, mm: as it is | filter | `mend` | acceleration: filter | `mend` |"]
    lines += ["|---|---:|---:|---:|---:|---:|---:|"]
    archives = np.array([case.archive for case in measured])
    for archive in dict.fromkeys(archives):
        own = archives == archive
        cells = [of_paper[name][own, 0].mean() for name in (NOISY, best, MEND)]
        cells += [of_paper[name][own, 1].mean() for name in (best, MEND)]
        lines.append(f"| {archive} | {own.sum()} | {' | '.join(f'{value:.2f}' for value in cells)} |")
    return lines


def clean_table(measured: Sequence[Case]) -> list[str]:
    """Changes of clean clips by archive."""
    changes = np.array([case.change_of_clean() for case in measured])
    archives = np.array([case.archive for case in measured])
    lines = [
        "| clean clips of | clips | mean change, mm | of the worst clip | mean change, degrees | of the worst clip | "
        "frames taken for exchanged |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for archive in (*dict.fromkeys(archives), "all"):
        own = changes[(archives == archive) | (archive == "all")]
        cells = [own[:, 0].mean(), own[:, 0].max(), own[:, 1].mean(), own[:, 1].max()]
        lines.append(
            f"| {archive} | {len(own)} | {' | '.join(f'{value:.3f}' for value in cells)} | {own[:, 2].sum():.0f} |"
        )
    return lines


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*", help="archives or folders of recordings")
    parser.add_argument("--most", type=int, default=4, help="clips of each archive")
    parser.add_argument("--page", type=Path, help="page whose section to write")
    arguments = parser.parse_args()
    found = [str(path) for path in sorted(DATA.glob("*.zip")) if path.name not in NEEDS_MORE]
    with tempfile.TemporaryDirectory(prefix="pumps-") as scratch:
        drawn = [*cases(arguments.archives or found, arguments.most, Path(scratch) / "motion")]
    measured = [case for tunes, case in drawn if not tunes]
    tuning = [case for tunes, case in drawn if tunes]
    made = "\n".join([*clean_table(measured), "", *noise_tables(measured, tuning)])
    print(made)
    if arguments.page:
        replace_section(arguments.page, SECTION, made)


if __name__ == "__main__":
    main()
