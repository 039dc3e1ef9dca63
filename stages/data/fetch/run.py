"""`pumps data fetch`: a public data set, downloaded and checked."""

from __future__ import annotations

from data_schemas.errors import PumpsError
from stages.data.fetch.config import Config
from stages.shared.catalogue.acceptance import acceptance_file, require_acceptance
from stages.shared.catalogue.catalogue import data_set_named, read_catalogue
from stages.shared.catalogue.download import fetch_file
from stages.shared.contract import StageReport
from stages.shared.progress import SILENT, Progress


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Download what is missing of the data set.

    Raises: UsageError for an unknown name, a licence that is not accepted, or another file of that name;
    PumpsError if only a person can download it, or the download fails (the downloaded part is kept).
    """
    data_set = data_set_named(read_catalogue(config.catalogue), config.name)
    if data_set.by_hand:
        raise PumpsError(
            f"{config.name} cannot be fetched by a program ({data_set.licence}).",
            f"{data_set.by_hand} Home page: {data_set.home}",
        )
    require_acceptance(config.name, data_set, config.accept_licence, config.acceptances or acceptance_file())
    paths = [
        fetch_file(each, config.output, progress=progress, overwrite=config.overwrite) for each in data_set.files
    ]
    lines = [
        f"{path}: {path.stat().st_size / 1e6:,.1f} MB, "
        + (f"checksum right (stated by {file.checksum_from})." if file.checksum else "no checksum is stated for it.")
        for path, file in zip(paths, data_set.files, strict=True)
    ]
    lines += [f"Licence: {data_set.licence}. {data_set.terms}", f"Next: {data_set.ingest.format(file=paths[0])}"]
    return StageReport(output=config.output, lines=lines, figures={"files": [str(path) for path in paths]})
