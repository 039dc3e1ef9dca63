"""The page: PC-MRL's tables on the given data, each followed by the paper's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from data_schemas.metrics import MetricRow
from data_schemas.tpc import TpcReader
from stages.measure.pcmrl import paper
from stages.measure.pcmrl.config import Config
from stages.shared.inference.pose_filling import Interpolator
from stages.shared.settings.command_line import command_line
from stages.shared.statistics.bootstrap import Estimate
from stages.shared.statistics.tables import ALL, Cell, Key, cells, in_order, overview, scopes_of
from stages.shared.statistics.tasks import INTERPOLATION, RETARGETING

_NINE = ("l2p_m", "l2q", "npss")
_LABELS = ("L2P", "L2Q", "NPSS")
_PLAIN_NAMES = {"lerp": "LERP", "slerp": "SLERP", "damped": "damped cubic"}
_OTHER_DATA = "other data and skeletons, so shares of LERP compare and absolute figures do not"


def summary_md(
    config: Config, rows: Sequence[MetricRow], truth: TpcReader | None, interpolators: dict[str, Interpolator]
) -> str:
    """The whole page."""
    parts = ["# PC-MRL's tables\n", f"Made by:\n\n```\n{command_line('pumps measure pcmrl', config)}\n```\n"]
    filled = [row for row in rows if row.task == INTERPOLATION]
    compared = [row for row in rows if row.task == RETARGETING]
    if filled and truth is not None:
        parts += _interpolation(config, filled, truth, interpolators)
    if compared:
        parts += _retargeting(config, compared)
    return "\n".join(parts)


def _interpolation(
    config: Config, rows: Sequence[MetricRow], truth: TpcReader, interpolators: dict[str, Interpolator]
) -> Iterator[str]:
    found = cells(rows, config.seed)
    clips = {row.clip for row in rows}
    bones = int((truth.bones(rows[0].skeleton).weights > 0).sum())
    yield "## Filling between keyframes (PC-MRL Tables 1 and 3)\n"
    yield (
        f"{len(clips)} clips ({', '.join(config.splits)} split) of the skeleton's own motions, windows of "
        f"{config.window} frames at 30 fps, {bones} bones. All frames count. Means over clips, each as heavy as its "
        "windows. The best of a column in bold. `damped cubic` is the plain interpolation that the networks add to.\n"
    )
    yield "\n".join(f"- {name}: {_training(each)}" for name, each in interpolators.items()) + "\n"
    intervals = sorted(set(config.intervals))
    ours = [(_named(scope), _our_rows(found, scope)) for scope in scopes_of(found)]
    printed = [(name, list(each.items())) for name, each in paper.TABLE_1.items()]
    yield from _nine_table(ours, intervals)
    yield "L2P as a share of LERP's:\n"
    yield from _shares_of_lerp(ours, intervals)
    yield overview(found)
    yield f"As printed in the paper, Table 1 (CMU; {_OTHER_DATA}):\n"
    yield from _nine_table(printed, paper.INTERVALS)
    yield "The same, L2P as a share of LERP's:\n"
    yield from _shares_of_lerp(printed, paper.INTERVALS)
    yield "As printed in the paper, Table 3 (CMU, all categories):\n"
    yield from _nine_table([("all", list(paper.TABLE_3.items()))], paper.INTERVALS)


def _training(interpolator: Interpolator) -> str:
    """An interpolator's training data and training time."""
    settings = interpolator.trained
    size = sum(value.numel() for value in interpolator.network.parameters())
    return (
        f"{size / 1e6:.2f} M parameters, {settings.get('steps')} steps of {settings.get('batch')} windows of "
        f"{settings.get('window')} frames, rest-pose augmentation {settings.get('rest_pose_m')} m, trained on "
        f"{interpolator.trained_on}."
    )


def _our_rows(found: dict[Key, Cell], scope: str) -> list[tuple[str, tuple[float | None, ...]]]:
    """Each method's nine figures."""
    intervals = sorted({key[2] for key in found})
    table: list[tuple[str, tuple[float | None, ...]]] = []
    for method in in_order(found, 4):
        picked = [found.get((scope, INTERPOLATION, each, metric, method)) for metric in _NINE for each in intervals]
        values = tuple(None if cell is None else cell.mean.value for cell in picked)
        table.append((str(_PLAIN_NAMES.get(method, method)), values))
    return table


def _nine_table(
    blocks: Sequence[tuple[str, Sequence[tuple[str, Sequence[float | None]]]]], intervals: Sequence[int]
) -> Iterator[str]:
    """Markdown of blocks of rows; the least value of each column of a block is bold."""
    header = " | ".join(f"{label} {interval}" for label in _LABELS for interval in intervals)
    lines = [f"| category | method | {header} |", f"|---|---|{'---:|' * (3 * len(intervals))}"]
    for block, rows in blocks:
        columns = zip(*(values for _, values in rows), strict=True)
        least = [min((value for value in column if value is not None), default=None) for column in columns]
        for number, (name, values) in enumerate(rows):
            shown = [_number(value, value == best) for value, best in zip(values, least, strict=True)]
            lines.append(f"| {block if number == 0 else ''} | {name} | {' | '.join(shown)} |")
    yield "\n".join(lines) + "\n"


def _number(value: float | None, best: bool) -> str:
    if value is None:
        return ""
    return f"**{value:.4f}**" if best else f"{value:.4f}"


def _shares_of_lerp(
    blocks: Sequence[tuple[str, Sequence[tuple[str, Sequence[float | None]]]]], intervals: Sequence[int]
) -> Iterator[str]:
    """Markdown: every row's L2P as a share of the block's LERP."""
    lines = [f"| category | method | {' | '.join(map(str, intervals))} |", f"|---|---|{'---:|' * len(intervals)}"]
    for block, rows in blocks:
        base = dict(rows)["LERP"]
        others = [(name, values) for name, values in rows if name != "LERP"]
        for number, (name, values) in enumerate(others):
            pairs = list(zip(values, base, strict=True))[: len(intervals)]
            shares = ("" if value is None or not line else f"{value / line:.2f}" for value, line in pairs)
            lines.append(f"| {block if number == 0 else ''} | {name} | {' | '.join(shares)} |")
    yield "\n".join(lines) + "\n"


def _retargeting(config: Config, rows: Sequence[MetricRow]) -> Iterator[str]:
    found = cells(rows, config.seed)
    windows = sum(row.windows for row in rows if row.metric == "end_cm" and row.method == rows[0].method)
    yield "## Adapted motions beside their sources (PC-MRL Table 2)\n"
    yield (
        f"{windows} windows of {config.window} frames of {len({row.clip for row in rows})} clips "
        f"({', '.join(config.splits)} split). L_KNN: each of {config.points} points of the source's cloud to its "
        f"{config.neighbours} nearest of the other cloud within the body group, on whole trajectories (root mean "
        "square over time), mean; centimetres [95% bootstrap interval over clips]. The original motion against "
        "another draw of its own points is the floor. L_end: head, wrists and ankles, mean over the five; "
        "centimetres.\n"
    )
    sigmas = " | ".join(f"σ = {sigma:g}" for sigma in config.sigmas_m)
    lines = [f"| category | method | {sigmas} | L_end |", f"|---|---|{'---:|' * (len(config.sigmas_m) + 1)}"]
    for scope in scopes_of(found):
        for number, method in enumerate(in_order(found, 4)):
            keys = [(scope, RETARGETING, round(1000 * s), "knn_cm", method) for s in config.sigmas_m]
            picked = [found.get(key) for key in [*keys, (scope, RETARGETING, 0, "end_cm", method)]]
            shown = " | ".join("" if cell is None else _spanned(cell.mean) for cell in picked)
            lines.append(f"| {_named(scope) if number == 0 else ''} | {method} | {shown} |")
    yield "\n".join(lines) + "\n"
    yield "As printed in the paper, Table 2 (LaFAN1 to CMU, times 100; other data and skeletons):\n"
    header = " | ".join(f"σ = {sigma:g}" for sigma in paper.SIGMAS_M)
    lines = [f"| method | {header} | L_end |", "|---|" + "---:|" * (len(paper.SIGMAS_M) + 1)]
    lines += [f"| {name} | {' | '.join(f'{v:.2f}' for v in values)} |" for name, values in paper.TABLE_2.items()]
    yield "\n".join(lines) + "\n"


def _named(scope: str) -> str:
    return "all" if scope == ALL else scope


def _spanned(estimate: Estimate) -> str:
    if estimate.low is None or estimate.high is None:
        return f"{estimate.value:.2f}"
    return f"{estimate.value:.2f} [{estimate.low:.2f}, {estimate.high:.2f}]"
