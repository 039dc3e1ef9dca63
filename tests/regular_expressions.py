"""Whether a regular expression can take more than linear time, by its parse tree.

Two shapes make a match fail slowly. Nested: a repeat without bound inside another one, `(a+)+`: exponential time.
Side by side: two repeats without bound that share characters, with nothing between them that must match something
else, `[ \\t]*:?[ \\t]*`: time that grows with a power of the text. A third one makes a search slow: a repeat without
bound that something must follow, at the start of an expression that is tried at every place, `\\s+x`.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    from re import _constants as sre
    from re import _parser
else:
    import sre_constants as sre  # pyright: ignore[reportMissingImports]
    import sre_parse as _parser  # pyright: ignore[reportMissingImports]
parser: Any = _parser  # its types are not those of the stubs

_MANY = 64  # a bound above this counts as none
_SEARCHES = ("search", "findall", "finditer", "sub", "subn", "split")
_REPEATS = {op for name in ("MAX_REPEAT", "MIN_REPEAT", "POSSESSIVE_REPEAT") if (op := getattr(sre, name, None))}
# A class of characters is the set of those that it matches among these.
_SAMPLES = [chr(code) for code in range(256)]


def faults_of(pattern: str | bytes, flags: int = 0, *, searched: bool = False) -> list[str]:
    """What makes an expression slow, one sentence each. searched: it is tried at every place of a text."""
    tree = parser.parse(pattern, flags)
    faults: list[str] = []
    for path in _paths(list(tree), tree.state.flags):
        faults += _faults_of_path(path, searched)
    _nested(list(tree), False, faults)
    return list(dict.fromkeys(faults))


def _unbounded(op: Any, argument: Any) -> bool:
    return op in _REPEATS and argument[1] >= _MANY


def _nested(items: list[Any], inside: bool, faults: list[str]) -> None:
    for op, argument in items:
        repeats = _unbounded(op, argument)
        if repeats and inside and not _is_one_character(argument[2]):
            faults.append("a repeat without bound of a group is inside another one")
        elif repeats and inside:
            faults.append("a repeat without bound is inside another one")
        for inner in _inner(op, argument):
            _nested(inner, inside or repeats, faults)


def _is_one_character(items: Any) -> bool:
    return len(items) == 1 and items[0][0] in (sre.LITERAL, sre.NOT_LITERAL, sre.ANY, sre.IN)


def _inner(op: Any, argument: Any) -> list[list[Any]]:
    if op in _REPEATS:
        return [list(argument[2])]
    if op is sre.SUBPATTERN:
        return [list(argument[3])]
    if op is sre.BRANCH:
        return [list(each) for each in argument[1]]
    if op in (sre.ASSERT, sre.ASSERT_NOT):
        return [list(argument[1])]
    if op is getattr(sre, "ATOMIC_GROUP", None):
        return [list(argument)]
    return []


# One element of a path: its characters, whether it repeats without bound, whether it may match nothing.
_Element = tuple[frozenset[str], bool, bool]
_ANCHOR: _Element = (frozenset(), False, False)


def _paths(items: list[Any], flags: int, most: int = 2000) -> Iterator[list[_Element]]:
    """The ways through an expression, alternatives taken apart, each as its elements in a row."""
    ways: list[list[_Element]] = [[]]
    for op, argument in items:
        options = _ways(op, argument, flags)
        ways = [way + option for way in ways for option in options][:most]
    yield from ways


def _ways(op: Any, argument: Any, flags: int) -> list[list[_Element]]:
    if op is sre.BRANCH:
        return [way for each in argument[1] for way in _paths(list(each), flags)]
    if op is sre.SUBPATTERN:
        return list(_paths(list(argument[3]), flags))
    if op in _REPEATS:
        least, _, inner = argument
        if _unbounded(op, argument):
            return [[(_characters(list(inner), flags), True, least == 0)]]
        found = list(_paths(list(inner), flags))
        return [*found, []] if least == 0 else found
    if op is sre.AT:
        return [[_ANCHOR]] if argument in (sre.AT_BEGINNING, sre.AT_BEGINNING_STRING) else [[]]
    if op in (sre.ASSERT, sre.ASSERT_NOT):
        return [[]]
    return [[(_characters([(op, argument)], flags), False, False)]]


def _characters(items: list[Any], flags: int) -> frozenset[str]:
    found: set[str] = set()
    for op, argument in items:
        if inner := _inner(op, argument):
            for each in inner:
                found |= _characters(each, flags)
        elif op in (sre.LITERAL, sre.NOT_LITERAL, sre.ANY, sre.IN):
            found |= _matched(op, argument, flags)
    return frozenset(found)


def _matched(op: Any, argument: Any, flags: int) -> set[str]:
    tree = parser.SubPattern(parser.State(), [(op, argument)])
    tree.state.flags = flags
    tree.state.str = ""
    if op is sre.ANY:
        return set(_SAMPLES) - (set() if flags & re.DOTALL else {"\n"})
    if op in (sre.LITERAL, sre.NOT_LITERAL):
        given = {chr(argument).lower(), chr(argument).upper()} if flags & re.IGNORECASE else {chr(argument)}
        return given if op is sre.LITERAL else set(_SAMPLES) - given
    negated = argument[0][0] is sre.NEGATE
    found: set[str] = set()
    for kind, value in argument:
        if kind is sre.LITERAL:
            found |= _matched(sre.LITERAL, value, flags)
        elif kind is sre.RANGE:
            found |= {
                c for code in range(value[0], min(value[1], 255) + 1) for c in _matched(sre.LITERAL, code, flags)
            }
        elif kind is sre.CATEGORY:
            found |= {c for c in _SAMPLES if re.match(_CATEGORIES[str(value).rsplit("_", 1)[-1]](str(value)), c)}
    return set(_SAMPLES) - found if negated else found


_CATEGORIES = {
    "DIGIT": lambda name: r"\D" if "NOT" in name else r"\d",
    "SPACE": lambda name: r"\S" if "NOT" in name else r"\s",
    "WORD": lambda name: r"\W" if "NOT" in name else r"\w",
}


def _faults_of_path(path: list[_Element], searched: bool) -> list[str]:
    faults = []
    for first, (chars, repeats, _) in enumerate(path):
        if not repeats:
            continue
        for second in range(first + 1, len(path)):
            others, again, nothing = path[second]
            if again and chars & others:
                faults.append("two repeats without bound that share characters stand side by side")
            if not nothing and not chars & others:
                break
            chars = chars if nothing else chars & others
    if searched and path:
        lead = next((i for i, (_, repeats, nothing) in enumerate(path) if repeats or not nothing), None)
        if lead is not None and path[lead][1] and any(not nothing for _, _, nothing in path[lead + 1 :]):
            faults.append("a search begins with a repeat without bound that something must follow")
    return faults


# --- the expressions of source files ----------------------------------------------------------------


def expressions_of(path: Path) -> Iterator[tuple[int, str | bytes, int, bool]]:
    """Line, pattern, flags, and whether it is searched for, of every call of `re` in a file.

    A value that is put into a pattern stands there as the letter X. A compiled pattern counts as searched where its
    name is used with one of `_SEARCHES` in the same file.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    searched = {
        node.func.value.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in _SEARCHES
        and isinstance(node.func.value, ast.Name)
    }
    names = {id(node.value): target.id for node in ast.walk(tree) if isinstance(node, ast.Assign)
             for target in node.targets if isinstance(target, ast.Name)}  # fmt: skip
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
            continue
        of = node.func.value
        if not (isinstance(of, ast.Name) and of.id == "re" and node.args):
            continue
        pattern = _constant(node.args[0])
        if pattern is None:
            continue
        flags = 0
        for extra in (*node.args[1:], *(keyword.value for keyword in node.keywords if keyword.arg == "flags")):
            for part in ast.walk(extra):
                if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id == "re":
                    flags |= int(getattr(re, part.attr, 0)) if part.attr.isupper() else 0
        function = node.func.attr
        yield node.lineno, pattern, flags, function in _SEARCHES or names.get(id(node)) in searched


def _constant(node: ast.AST) -> str | bytes | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, str | bytes):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values)
    return None
