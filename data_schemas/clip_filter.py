"""Selecting clips by the columns of their index: `foot_skate < 0.1 and not t_pose and archive == "walks.zip"`.

Names are the index's columns, and `archive`, the file or archive that a clip came from. Allowed are comparisons,
`and`, `or`, `not`, `in`, brackets, numbers, "texts", true and false; the expression is never run as code. Arrow
evaluates the comparisons. An unknown value satisfies no comparison.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from functools import reduce
from pathlib import PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from data_schemas.clips import ClipRow, index_table
from data_schemas.errors import UsageError

LONGEST = 2000  # characters of an expression
_COMPARE: dict[type, Callable[[Any, Any], Any]] = {
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
    ast.Eq: lambda a, b: a == b,
    ast.NotEq: lambda a, b: a != b,
}
_HINT = "For example: --where 'foot_skate < 0.1 and not t_pose'."


def clips_where(rows: Sequence[ClipRow], expression: str | None) -> tuple[ClipRow, ...]:
    """The rows that satisfy an expression, in their order; all rows if there is no expression.

    Raises: UsageError for an invalid expression, or one that no clip satisfies.
    """
    if expression is None or not expression.strip():
        return tuple(rows)
    table = index_table(rows)
    archives = [row.archive or PurePosixPath(row.source.replace("\\", "/")).name for row in rows]
    table = table.append_column("archive", pa.array(archives, pa.string()))
    condition = _Condition(expression, table.column_names).condition
    try:
        kept = table.append_column("row", pa.array(range(len(rows)))).filter(condition)["row"].to_pylist()
    except (pa.ArrowException, TypeError) as error:
        raise UsageError(
            f"The expression {expression!r} compares values of different types ({error}).", _HINT
        ) from None
    if not kept:
        raise UsageError(f"No clip satisfies {expression!r}.", "pumps artefact show PATH lists the clips.")
    return tuple(rows[index] for index in kept)


class _Condition:
    """The Arrow expression of a text."""

    def __init__(self, text: str, columns: Sequence[str]):
        self.text, self.columns, self.names_a_column = text, columns, False
        if len(text) > LONGEST:
            raise self._fault(f"it is longer than {LONGEST} characters")
        try:
            tree = ast.parse(text.strip(), mode="eval")
            self.condition = self._of(tree.body)
        except (SyntaxError, ValueError, RecursionError, MemoryError, TypeError, AttributeError, pa.ArrowException):
            # The last three: an operation that its operands do not have, such as -'text' or 1 in [2].
            raise self._fault("it is not a comparison") from None
        if not self.names_a_column or isinstance(self.condition, bool | int | float | str):
            raise self._fault("it uses no column")

    def _of(self, node: ast.expr) -> Any:
        if isinstance(node, ast.BoolOp):
            join = (lambda a, b: a & b) if isinstance(node.op, ast.And) else (lambda a, b: a | b)
            return reduce(join, [self._of(value) for value in node.values])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return ~self._of(node.operand)
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            pairs = [self._compared(op, a, b) for op, a, b in zip(node.ops, sides[:-1], sides[1:], strict=True)]
            return reduce(lambda a, b: a & b, pairs)
        if isinstance(node, ast.Name):
            return self._named(node.id)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -self._constant(node.operand)
        return self._constant(node)

    def _compared(self, op: ast.cmpop, left: ast.expr, right: ast.expr) -> Any:
        if isinstance(op, ast.In | ast.NotIn):
            if not isinstance(right, ast.List | ast.Tuple):
                raise self._fault('\'in\' needs a list, such as ["train", "val"]')
            found = self._of(left).isin([self._constant(item) for item in right.elts])
            return found if isinstance(op, ast.In) else ~found
        if type(op) not in _COMPARE:
            raise self._fault("it uses a comparison that is not allowed")
        return _COMPARE[type(op)](self._of(left), self._of(right))

    def _named(self, name: str) -> Any:
        if name.lower() in ("true", "false"):
            return pc.scalar(name.lower() == "true")
        if name not in self.columns:
            raise self._fault(f"there is no {name!r}; there are {', '.join(self.columns)}")
        self.names_a_column = True
        return pc.field(name)

    def _constant(self, node: ast.expr) -> Any:
        if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float | str):
            return node.value if not isinstance(node.value, bool) else pc.scalar(node.value)
        raise self._fault(f"{ast.unparse(node)!r} is not allowed")

    def _fault(self, why: str) -> UsageError:
        return UsageError(f"The expression {self.text[:200]!r} cannot be used: {why}.", _HINT)
