"""`pumps measure table1`: evaluations of single methods in, PUMPS Table 1 out."""

from __future__ import annotations

from data_schemas.artefact import write_artefact
from data_schemas.errors import UsageError
from data_schemas.metrics import write_metrics
from stages.measure.table1.config import Config
from stages.measure.table1.joined import Joined, joined
from stages.measure.table1.paper import TABLE_1
from stages.measure.table1.tables import beside_best, beside_best_by_category, costs, curve, paper_shares, table_1
from stages.shared.contract import StageReport
from stages.shared.outputs import check_artefact
from stages.shared.progress import SILENT, Progress
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.feel_tables import LEGEND as FEEL_LEGEND
from stages.shared.statistics.feel_tables import feel_markdown
from stages.shared.statistics.method_notes import MethodFacts, markdown_of, method_notes
from stages.shared.statistics.tables import LEGEND, Cell, Key, cells, in_order, scopes_of, task_tables, terminal_lines


def run(config: Config, *, progress: Progress = SILENT) -> StageReport:
    """Join the evaluations and write a `metrics` artefact.

    Raises: InputError for evaluations of other windows or a method that is measured twice; UsageError for a name in
    `ours` that no evaluation measured.
    """
    check_artefact(config, "metrics")
    progress.start("joining evaluations")
    all_of = joined(config.metrics)
    others = [joined([path], all_of) for path in config.curve]
    for name in config.ours:
        if name not in all_of.methods:
            raise UsageError(f"No evaluation measured {name!r}.", f"There are {', '.join(all_of.methods)}.")
    found = cells(all_of.rows, config.seed)
    page = _page(config, all_of, others, found)
    facts = MethodFacts(weights=list(all_of.weights.values()))
    inputs = [*all_of.artefacts, *(artefact for other in others for artefact in other.artefacts)]
    with write_artefact(config.output, "metrics", stage="measure-table1", config=config, inputs=inputs) as draft:
        draft.summary |= facts.model_dump() | {"methods": all_of.methods}
        draft.summary["milliseconds_per_frame"] = all_of.milliseconds
        write_metrics(draft.folder, all_of.rows, page)
    lines = [*terminal_lines(found), f"Whole page: {config.output}, summary.md."]
    return StageReport(output=config.output, lines=lines, figures={"methods": all_of.methods})


def _page(config: Config, all_of: Joined, others: list[Joined], found: dict[Key, Cell]) -> str:
    scopes = scopes_of(found)
    parts = [
        "# PUMPS Table 1\n",
        f"Made by:\n\n```\n{command_line('pumps measure table1', config)}\n```\n",
        "Native: trained on other clips of the measured data set; non-native: on other data sets alone. The best of "
        "a column in bold.\n",
        "\n".join(f"- {markdown_of(note)}" for note in method_notes(MethodFacts(weights=[*all_of.weights.values()])))
        + "\n",
    ]
    for scope in reversed(scopes):  # all together first
        parts += [f"## {scope}\n", *table_1(all_of, found, scope)]
    if config.ours:
        parts.append("## Beside the best other method\n")
        parts.append(
            "The ratio of means over the same clips, its 95% bootstrap interval, and the p of Wilcoxon's signed-rank "
            "test on the clips, not corrected for the number of tests. With five clips or fewer, p is 0.06 or more.\n"
        )
        parts += [*beside_best(all_of, found, config.ours, config.seed, scopes[-1]).markdown(), ""]
        if by_category := beside_best_by_category(all_of, found, config.ours, config.seed):
            parts += ["By category:\n", *by_category.markdown(), ""]
    parts += ["## Time\n", *costs(all_of).markdown(), ""]
    if others:
        parts.append("## Error against training time\n\nL2P as a share of slerp's.\n")
        parts += [*curve(all_of, others, found, config.seed).markdown(), ""]
    for task in (task for task in in_order(found, 1) if task in TABLE_1):
        parts += [f"As printed in the paper, {task}: L2P as a share of SLERP's (other data and rigs).\n"]
        parts.append(paper_shares(task))
    parts += [f"# All figures\n\n{LEGEND}\n\n{FEEL_LEGEND}\n"]
    parts.append(task_tables(found, lambda scope: feel_markdown(found, scope)))
    return "\n".join(parts)
