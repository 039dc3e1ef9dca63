"""Runs the notebooks beside this file, each in an empty folder, and keeps what they print and draw.

    python docs/notebooks/run.py [-o FOLDER] [NAME ...]

Without -o, the notebooks are replaced by the ones with the new outputs.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

HERE = Path(__file__).resolve().parent
SECONDS = 600  # of a cell
CUT_OUT = ("execution", "scrolled")  # of a cell's metadata: when it ran, and how it was shown


def executed(path: Path) -> NotebookNode:
    """The notebook with the outputs of this run, and without the time and the machine of it.

    Raises: nbclient.exceptions.CellExecutionError where a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as place:
        here = {"metadata": {"path": place}}
        NotebookClient(notebook, timeout=SECONDS, coalesce_streams=True, resources=here).execute()
    notebook.metadata = nbformat.from_dict({"kernelspec": {"display_name": "Python 3", "name": "python3"}})
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({k: v for k, v in cell.metadata.items() if k not in CUT_OUT})
        if cell.cell_type == "code":
            cell.outputs = [each for each in cell.outputs if each.get("name") != "stderr"]
    return notebook


def main() -> None:
    """Read the arguments, run the notebooks, and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="notebooks to run, without .ipynb; all by default")
    parser.add_argument("-o", "--output", type=Path, default=HERE, metavar="FOLDER")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    for path in sorted(HERE.glob("*.ipynb")):
        if not options.names or path.stem in options.names:
            nbformat.write(executed(path), options.output / path.name)
            print(f"{path.name}: {(options.output / path.name).stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
