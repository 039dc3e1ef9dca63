"""`pumps data list`: the public data sets that pumps knows by name."""

from __future__ import annotations

from stages.data.list.config import Config
from stages.shared.catalogue.catalogue import DataSet, read_catalogue
from stages.shared.contract import StageReport
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Tell name, size, format, licence and home page of each.

    Raises: InputError for a catalogue that is none.
    """
    catalogue = read_catalogue(config.catalogue)
    lines = []
    for name, each in catalogue.items():
        lines += [
            f"{name:16}{_size(each):>9}  {each.format:8} {each.licence}",
            f"{'':27}{each.title}",
            f"{'':27}{each.home}",
        ]
    lines.append("Fetch one with: pumps data fetch NAME")
    return StageReport(
        lines=lines, figures={"data_sets": {name: each.model_dump() for name, each in catalogue.items()}}
    )


def _size(data_set: DataSet) -> str:
    if data_set.by_hand:
        return "by hand"
    return f"{data_set.bytes / 1e6:,.0f} MB" if data_set.bytes else "unstated"
