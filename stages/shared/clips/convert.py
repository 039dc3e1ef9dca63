"""The embedded clips from DeepMimic's: `python -m stages.shared.clips.convert FOLDER_OF_humanoid3d_TXT [OUTPUT]`.

Run once by a maintainer; the results are part of the package (see NOTICE for where the clips come from).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from stages.shared.formats.deepmimic import bvh_of_deepmimic, read_deepmimic, unrolled

LEAST_SECONDS = 4.0


def convert(source: Path, output: Path) -> list[Path]:
    """Write one BVH at 30 fps for each humanoid3d_*.txt, loops unrolled to 4 seconds and more."""
    written = []
    for path in sorted(source.glob("humanoid3d_*.txt")):
        clip = unrolled(read_deepmimic(path.read_bytes(), path.name), LEAST_SECONDS)
        target = output / f"{path.stem.removeprefix('humanoid3d_')}.bvh"
        target.write_bytes(bvh_of_deepmimic(clip))
        written.append(target)
    return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path)
    parser.add_argument("output", type=Path, nargs="?", default=Path(__file__).parent)
    arguments = parser.parse_args()
    convert(arguments.source, arguments.output)
