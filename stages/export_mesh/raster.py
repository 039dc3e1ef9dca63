"""Meshes as pixels: flat shaded triangles with a depth buffer, seen from far away (orthographic); PNG bytes."""

from __future__ import annotations

import struct
import zlib

import numpy as np

_FINER = 2  # pixels are drawn this much finer and then averaged
_TRIANGLES_AT_ONCE = 20_000
_SHADES = 48  # levels of light, so that the picture compresses
_LIGHT = np.array([0.4, 0.8, 0.5]) / np.linalg.norm([0.4, 0.8, 0.5])


def view_of(yaw: float, pitch: float) -> np.ndarray:
    """(3, 3) from the world to right, up and towards the viewer, for angles in radians; Y stays up."""
    turn = np.array([[np.cos(yaw), 0, -np.sin(yaw)], [0, 1, 0], [np.sin(yaw), 0, np.cos(yaw)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    return tilt @ turn


def drawn(
    seen: np.ndarray,
    faces: np.ndarray,
    colour: tuple[float, float, float],
    size: tuple[int, int],
    low: np.ndarray,
    pixels_a_metre: float,
) -> np.ndarray:
    """A mesh on white: (height, width, 3) uint8.

    Args:
        seen: (N, 3) metres, right, up and towards the viewer. faces: (F, 3).
        colour: red, green, blue from 0 to 1. size: width and height in pixels.
        low: (2,) metres right and up, of the picture's lower left corner. pixels_a_metre: the scale.
    """
    width, height = _FINER * size[0], _FINER * size[1]
    flat = (seen[:, :2] - low) * (_FINER * pixels_a_metre)
    depth = np.full(width * height, -np.inf)
    shade = np.zeros(width * height)
    normals = np.cross(seen[faces[:, 1]] - seen[faces[:, 0]], seen[faces[:, 2]] - seen[faces[:, 0]])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = 0.35 + 0.5 * np.abs(normals @ _LIGHT) + 0.15 * np.abs(normals[:, 2])
    for start in range(0, len(faces), _TRIANGLES_AT_ONCE):
        some = slice(start, start + _TRIANGLES_AT_ONCE)
        triangle, place, far = _covered(flat[faces[some]], seen[faces[some], 2], width, height)
        np.maximum.at(depth, place, far)
        front = far == depth[place]
        shade[place[front]] = light[some][triangle[front]]
    whole = np.where(np.isfinite(depth), np.round(shade * _SHADES) / _SHADES, np.nan).reshape(height, width)[::-1]
    colours = np.where(np.isnan(whole)[..., None], 1.0, np.nan_to_num(whole)[..., None] * np.array(colour))
    fine = colours.reshape(size[1], _FINER, size[0], _FINER, 3).mean((1, 3))
    return np.round(255 * fine.clip(0, 1)).astype(np.uint8)


def _covered(
    corners: np.ndarray, depths: np.ndarray, width: int, height: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The pixels whose centres lie in triangles: which triangle, index of the pixel, depth.

    Args:
        corners: (F, 3, 2) in pixels, from the lower left. depths: (F, 3).
    """
    first = np.ceil(corners.min(1) - 0.5).astype(int).clip(0, None)
    last = np.floor(corners.max(1) - 0.5).astype(int).clip(None, [width - 1, height - 1])
    spans = (last - first + 1).clip(0, None)
    counts = spans.prod(1)
    triangle = np.repeat(np.arange(len(corners)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    x = first[triangle, 0] + within % np.maximum(spans[triangle, 0], 1)
    y = first[triangle, 1] + within // np.maximum(spans[triangle, 0], 1)
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    point = np.stack([x + 0.5, y + 0.5], axis=1)
    area = _cross(b - a, c - a)
    parts = np.stack([_cross(c - b, point - b), _cross(a - c, point - c), _cross(b - a, point - a)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = parts / area[:, None]
    inside = (np.abs(area) > 1e-12) & (shares >= 0).all(1)
    far = (shares[inside] * depths[triangle[inside]]).sum(1)
    return triangle[inside], y[inside] * width + x[inside], far


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]


def png_of(pixels: np.ndarray) -> bytes:
    """The PNG of (height, width, 3) uint8."""
    height, width, _ = pixels.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows.tobytes(), 9)),
        (b"IEND", b""),
    ]
    packed = [
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)
