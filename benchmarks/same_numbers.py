"""Compare the fast parser of a BVH's rows with the careful one, number by number, on all BVHs of archives or folders.

    python benchmarks/same_numbers.py [ARCHIVE ...]

Without archives it reads the embedded clips.
The fast parser is `stages.shared.formats.number_rows`; the careful one, NumPy's row by row, reads what it leaves.
Prints how many numbers were compared and how many files were left to the careful parser. Any other bit ends it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from data_schemas.errors import PumpsError
from stages.shared.formats import number_rows
from stages.shared.formats.bvh import _fill_values, read_bvh
from stages.shared.formats.number_rows import TextRows
from stages.shared.formats.sources import Source, find_sources

CLIPS = Path(__file__).resolve().parents[1] / "stages" / "shared" / "clips"


def compare(sources: Iterable[Source]) -> tuple[int, int, int]:
    """Numbers of equal bits, files read by the fast parser, files left to the careful one.

    Raises: ValueError naming the first file in which the two differ.
    """
    numbers = fast = left = 0
    for source in sources:
        bvh = read_bvh(source.read(), source.name)
        if not isinstance(bvh.rows, TextRows):
            left += 1
            continue
        careful, bad = _fill_values(list(bvh.rows), bvh.values.shape[1])
        if bad or careful.tobytes() != bvh.values.tobytes():
            raise ValueError(f"{source.name}: the two parsers differ")
        numbers, fast = numbers + careful.size, fast + 1
    return numbers, fast, left


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*")
    options = parser.parse_args()
    number_rows.WORTH_BYTES = 0  # short files too
    try:
        numbers, fast, left = compare(find_sources(options.archives or [str(CLIPS)]))
    except (PumpsError, ValueError) as error:
        raise SystemExit(str(error)) from None
    print(f"{numbers:,} numbers of {fast} files are the same bits; {left} files were left to the careful parser.")


if __name__ == "__main__":
    main()
