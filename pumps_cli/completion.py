"""What the shell offers for the value of an option."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from stages.shared.contract import NAMES_OF, VALUES

Completion = Callable[[str], list[str]]


def completion_of(field: FieldInfo) -> Completion | None:
    """Offers the values that a Config's field says it takes; None if it does not say."""
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    if NAMES_OF in extra:
        return among(_NAMES[str(extra[NAMES_OF])])
    values = extra.get(VALUES)
    if isinstance(values, (list, tuple)):
        return among(lambda: [str(value) for value in values])
    choices = _choices(field.annotation)
    return among(lambda: choices) if choices else None


def among(values: Callable[[], Sequence[str]]) -> Completion:
    """Offers those values that begin as the user has begun."""

    def offered(incomplete: str) -> list[str]:
        return [value for value in values() if value.startswith(incomplete)]

    return offered


def preset_values() -> Sequence[str]:
    """Names of presets."""
    from stages.shared.settings.presets import preset_names

    return preset_names()


def _choices(annotation: Any) -> list[str]:
    if get_origin(annotation) in (Union, UnionType):
        return [choice for part in get_args(annotation) for choice in _choices(part)]
    return [str(choice) for choice in get_args(annotation)] if get_origin(annotation) is Literal else []


def _weights() -> Sequence[str]:
    from stages.shared.weights.fetched import fetched_weights
    from stages.shared.weights.shipped import shipped_weights

    return list(dict.fromkeys([*shipped_weights(), *fetched_weights()]))


def _data_sets() -> Sequence[str]:
    from stages.shared.catalogue.catalogue import read_catalogue

    return [*read_catalogue(None)]


_NAMES = {"weights": _weights, "data sets": _data_sets}
