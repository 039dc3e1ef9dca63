"""CPU time and peak memory of `pumps denoise` on a clip of a minute at 120 frames a second.

    OMP_NUM_THREADS=1 python benchmarks/denoise_cost.py [--methods mend savgol] [--page docs/performance.md]

The clip is the embedded walk, back and forth, with the faults of the noise `capture`; each method is a process of its
own. The start is the same command on a clip of a second. The last line says what the products of a network over
sliding windows would take, with the widths that MMPose gives SmoothNet (Zeng et al. 2022): of each coordinate of each
joint a window of 32 frames begins in every frame.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from measuring.machine import name_of
from measuring.section import replace_section

from data_schemas.skeleton import Motion
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.formats.bvh_motion import values_of as rows_of
from stages.shared.formats.bvh_write import write_bvh
from stages.shared.humanoid.symmetric_pairs import pairs_of_limbs
from stages.shared.inference.denoising import motion_from, positions_in
from stages.shared.kinematics.forward_numpy import local_rotations_of
from stages.shared.kinematics.motion_filters import FILTERS
from stages.shared.kinematics.resampling import resample
from stages.shared.pose_tasks.noise import capture_noise

WALK = Path(__file__).resolve().parents[1] / "stages" / "shared" / "clips" / "walk.bvh"
SECTION = "denoise cost"
WINDOW, WIDTH, INNER, BLOCKS = 32, 512, 256, 3
CHILD = """
import resource, sys
from pumps_cli.app import main
try:
    main(sys.argv[1:])
except SystemExit as leaving:
    assert leaving.code in (None, 0), leaving.code
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


def noisy_clip(seconds: int, fps: float, path: Path) -> tuple[Path, Motion]:
    """The walk back and forth with the faults of capture, as a BVH."""
    bvh = read_bvh(WALK.read_bytes(), WALK.name)
    skeleton, motion, _ = motion_of(bvh)
    motion = resample(motion, fps)
    there_and_back = np.concatenate([np.arange(motion.frames), np.arange(motion.frames)[-2:0:-1]])
    whole = motion.at(np.resize(there_and_back, round(seconds * fps)))
    limbs = pairs_of_limbs(skeleton.names, skeleton.parents, skeleton.offsets, skeleton.groups)
    local = local_rotations_of(skeleton, whole)
    roots, turned, _ = capture_noise(whole.root_positions, local, np.random.default_rng(0), limbs)
    made = motion_from(skeleton, whole, turned, np.concatenate([roots, positions_in(whole)[:, 3:]], axis=1))
    path.write_bytes(write_bvh(bvh, rows_of(bvh, skeleton, made), frame_count=made.frames, frame_time=1 / fps))
    return path, made


def cost(clip: Path, *options: str) -> tuple[float, float]:
    """CPU seconds and peak memory in MB of one command in a process of its own."""
    words = ["denoise", str(clip), "-o", str(clip.with_suffix(".clean.bvh")), "--overwrite", *options]
    told = subprocess.run([sys.executable, "-c", CHILD, *words], check=True, capture_output=True, text=True).stdout
    seconds, peak = told.split()[-2:]
    return float(seconds), float(peak)


def products_s(frames: int, coordinates: int) -> float:
    """CPU seconds that the products of a network over sliding windows would take, at the rate of a large product."""
    one = torch.randn(1024, 1024)
    torch.mm(one, one)
    began = time.process_time()
    for _ in range(5):
        torch.mm(one, one)
    rate = 5 * 2 * 1024**3 / (time.process_time() - began)
    weights = 2 * WINDOW * WIDTH + 2 * BLOCKS * WIDTH * INNER
    return 2 * weights * frames * coordinates / rate


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=60, help="length of the clip")
    parser.add_argument("--fps", type=float, default=120.0, help="its frames a second")
    parser.add_argument("--methods", nargs="+", default=["mend", *FILTERS], help="methods of `pumps denoise`")
    parser.add_argument("--page", type=Path, help="page whose section to write")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    lines = ["| command | CPU s | without the start, CPU s | peak MB | start, peak MB |", "|---|---:|---:|---:|---:|"]
    with tempfile.TemporaryDirectory(prefix="pumps-") as scratch:
        short, _ = noisy_clip(1, arguments.fps, Path(scratch) / "short.bvh")
        clip, motion = noisy_clip(arguments.seconds, arguments.fps, Path(scratch) / "clip.bvh")
        for name in arguments.methods:
            start, whole = (cost(each, "--fill", "none", "--method", name) for each in (short, clip))
            shown = f"pumps denoise --method {name}"
            lines.append(
                f"| `{shown}` | {whole[0]:.1f} | {whole[0] - start[0]:.1f} | {whole[1]:.0f} | {start[1]:.0f} |"
            )
    joints = motion.rotations.shape[1]
    network = products_s(motion.frames, 3 * joints)
    lines += [
        "",
        f"{motion.frames} frames of {joints} joints, --fill none; {name_of(torch.device('cpu'))}, 1 thread.",
    ]
    lines += [
        f"The products of a network over sliding windows, as wide as SmoothNet, would take {network:.1f} CPU s."
    ]
    print("\n".join(lines))
    if arguments.page:
        replace_section(arguments.page, SECTION, "\n".join(lines))


if __name__ == "__main__":
    main()
