"""The size of an image and a camera's numbers, as they are typed."""

from __future__ import annotations

import re

from data_schemas.errors import UsageError

_SIZE = re.compile(r"(\d{1,6})\s*[xX*,]\s*(\d{1,6})")


def size_of_text(text: str) -> tuple[float, float]:
    """Width and height in pixels of "1920x1080". Raises UsageError."""
    found = _SIZE.fullmatch(text.strip())
    if found is None or 0 in (int(found[1]), int(found[2])):
        raise UsageError(
            f"{text[:40]!r} is not the size of an image.", "Give width and height: --image-size 1920x1080."
        )
    return float(found[1]), float(found[2])


def intrinsics_of_text(text: str) -> tuple[float, float, float]:
    """Focal length and principal point in pixels, of "FX,CX,CY" or "FX,FY,CX,CY". Raises UsageError.

    Pixels that are not square are refused, beyond a difference of 2% between FX and FY.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 3:
        numbers = [numbers[0], *numbers]
    if len(numbers) != 4 or not all(abs(number) < 1e7 for number in numbers) or min(numbers[:2]) <= 0:
        raise UsageError(
            f"{text[:60]!r} is no camera.", "Give FX,FY,CX,CY in pixels: --intrinsics 1400,1400,960,540."
        )
    if abs(numbers[0] / numbers[1] - 1) > 0.02:
        raise UsageError("FX and FY differ: pixels that are not square are not supported.", "Resample the image.")
    return (numbers[0] + numbers[1]) / 2, numbers[2], numbers[3]
