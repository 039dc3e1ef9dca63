"""Building a checkpoint's network only if its weights hold the parameters that its config asks for.

`config.json` is small and can state any size. Building stops as soon as the parameters that were made are more than
those that are stored: a layer's numbers are filled in after it registers them, so that their memory is not taken.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from torch import nn
from torch.nn.modules.module import (
    register_module_buffer_registration_hook,
    register_module_parameter_registration_hook,
)

from data_schemas.errors import InputError

Network = TypeVar("Network", bound=nn.Module)

MOST_WINDOW = 1_000_000  # frames
MOST_POINTS = 100_000  # in a frame
_FREE_NUMBERS = 1 << 22  # of buffers, such as tables of angles, which are made and not stored
_MEND = "Train it again, or fetch the weights again."


class _TooLarge(Exception):
    pass


def build_bounded(
    build: Callable[[], Network], sizes: object, weights: Mapping[str, np.ndarray], path: object
) -> Network:
    """The network that `build` makes from a checkpoint's config.

    Args:
        sizes: the part of the config that `build` reads.
        weights: the checkpoint's arrays, by name.
        path: the checkpoint, for errors.

    Raises: InputError if the config asks for more parameters than the weights hold, or is damaged.
    """
    there = sum(int(array.size) for array in weights.values())
    asked = {"parameters": 0, "buffers": 0}
    thread = threading.get_ident()

    def count(kind: str, most: int) -> Callable[[nn.Module, str, Any], None]:
        def hook(module: nn.Module, name: str, value: Any) -> None:
            if threading.get_ident() == thread and value is not None:
                asked[kind] += value.numel()
                if asked[kind] > most:
                    raise _TooLarge

        return hook

    hooks = (
        register_module_parameter_registration_hook(count("parameters", there)),
        register_module_buffer_registration_hook(count("buffers", there + _FREE_NUMBERS)),
    )
    try:
        if not isinstance(sizes, Mapping):
            raise TypeError("its sizes are missing")
        if any(isinstance(size, int) and size > there for size in sizes.values()):
            raise _TooLarge
        return build()
    except _TooLarge:
        raise InputError(
            f"{path} is damaged: its config asks for a network of more than the {there} parameters that its weights "
            "hold.",
            _MEND,
        ) from None
    except (KeyError, TypeError, ValueError, RuntimeError, OverflowError, ArithmeticError, MemoryError) as error:
        cause = " ".join(str(error).split())[:200]
        raise InputError(f"{path} is damaged: its config describes no network ({cause}).", _MEND) from None
    finally:
        for hook in hooks:
            hook.remove()


def whole_setting(config: Mapping[str, Any], name: str, most: int, path: object, *, least: int = 1) -> int:
    """The whole number `name` of a checkpoint's config. Raises InputError if it is not one of `least` to `most`."""
    value = config.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise InputError(
            f"{path} is damaged: its {name} is {str(value)[:40]}, not a number from {least} to {most}.", _MEND
        )
    return value
