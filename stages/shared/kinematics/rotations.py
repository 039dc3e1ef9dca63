"""Unit quaternions xyzw: products, signs, the shorter way, rotation vectors. For NumPy arrays and torch tensors.

A quaternion q and its negative -q are the same rotation. Functions that choose between the two only negate values, so
a NumPy array and a torch tensor of the same numbers give the same bytes.

Only the functions that need torch import it, so that the file readers, which use this module, start fast. Tests
compare this module with RoMa and SciPy. RoMa itself is not used: its import loads torch._dynamo and takes a second.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

    Array = TypeVar("Array", np.ndarray, Tensor)

CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])  # product with a unit quaternion: its inverse
_LINE_IS_ARC = {4: 1e-4, 8: 1e-6}  # by bytes of a number: below this sine, slerp is linear
_OPPOSITE = 1e-7  # directions that sum to less than this are opposite


def continuous_signs(rotations: Array, axis: int = 0) -> Array:
    """The same rotations with signs such that each quaternion has a dot product of 0 or more with the one before it.

    Args:
        rotations: (..., 4). axis: the time axis, counted from the front; not the last one.

    Returns: an array of the same shape and dtype; the first quaternions keep their signs.
    """
    before = (slice(None),) * axis
    first, later, earlier = (rotations[(*before, part)] for part in (slice(1), slice(1, None), slice(-1)))
    turned_back = (later * earlier).sum(-1) < 0
    # Multiplying by 1 or -1 is exact.
    if isinstance(rotations, np.ndarray):
        odd = np.logical_xor.accumulate(turned_back, axis)
        out = rotations.copy(order="K")  # in any memory layout this is faster than joining two arrays
        out[(*before, slice(1, None))] *= np.where(odd, *np.array([-1, 1], rotations.dtype))[..., None]
        return out
    xp = _module_of(rotations)
    signs = xp.cumprod(xp.where(turned_back[..., None], -1.0, 1.0), axis)
    return xp.concatenate([first, later * xp.asarray(signs, dtype=rotations.dtype)], axis=axis)


def signs_after_given(rotations: np.ndarray, given: np.ndarray) -> np.ndarray:
    """The same rotations; rows that are not given have signs that agree with the row before them.

    Args:
        rotations: (T, ..., 4). given: (T,) bool, rows that keep their signs. The first row keeps its sign too.

    Returns: a new array of the same shape and dtype.
    """
    turned_back = np.zeros(rotations.shape[:-1], np.int64)
    turned_back[1:] = (rotations[1:] * rotations[:-1]).sum(-1) < 0
    flips = np.cumsum(turned_back, axis=0)
    last_given = np.maximum.accumulate(np.where(given, np.arange(len(given)), 0))
    odd = (flips - flips[last_given]) % 2 == 1
    return np.where(odd[..., None], -rotations, rotations)


def aligned_signs(rotations: Array, reference: Array) -> Array:
    """The same rotations (..., 4), each with the sign that is nearer to its reference (..., 4)."""
    away = (rotations * reference).sum(-1)[..., None] < 0
    return _module_of(rotations).where(away, -rotations, rotations)


def shorter_way(rotations: Array) -> Array:
    """The same rotations (..., 4) with a real part of 0 or more: turns of at most 180 degrees."""
    return _module_of(rotations).where(rotations[..., 3:] < 0, -rotations, rotations)


def turn_vectors(rotations: Tensor) -> Tensor:
    """Rotation vectors (..., 3) radians, the shorter way, of unit quaternions (..., 4). Smooth at 0."""
    import torch

    rotations = shorter_way(rotations)
    vector, real = rotations[..., :3], rotations[..., 3:]
    half = torch.atan2(torch.linalg.vector_norm(vector, dim=-1, keepdim=True), real)
    return 2 * vector / torch.sinc(half / np.pi)


def from_turn_vectors(turns: Array) -> Array:
    """Unit quaternions (..., 4) of rotation vectors (..., 3) radians. Smooth at 0."""
    xp = _module_of(turns)
    # torch's vector_norm has a slope of 0 at 0, where that of `_norm` is NaN.
    half = (_norm(turns) if xp is np else xp.linalg.vector_norm(turns, dim=-1, keepdim=True)) / 2
    return xp.concatenate([turns * (xp.sinc(half / np.pi) / 2), xp.cos(half)], axis=-1)


def turns_between(first: Tensor, second: Tensor) -> Tensor:
    """Rotation vectors (..., 3) radians, the shorter way, that turn `first` (..., 4) into `second` (..., 4).

    They are about the axes of `first`: second = first x exp(turn).
    """
    return turn_vectors(multiply(conjugate(first), second))


def angles_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angles (...) float64 in radians, 0 to pi, between rotations: unit quaternions (..., 4), which broadcast.

    Unit quaternions that differ by a rotation of angle a have distance 2 sin(a / 4). Unlike the arc cosine of their
    product, this is exact for small angles.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    chord = np.minimum(np.linalg.norm(first - second, axis=-1), np.linalg.norm(first + second, axis=-1))
    return 4 * np.arcsin(np.minimum(chord / 2, 1))


def conjugate(rotations: Array) -> Array:
    """The inverse rotations of unit quaternions (..., 4)."""
    if isinstance(rotations, np.ndarray):
        return rotations * CONJUGATE.astype(rotations.dtype)
    return _module_of(rotations).cat([-rotations[..., :3], rotations[..., 3:]], dim=-1)


def multiply(left: Array, right: Array) -> Array:
    """Products of quaternions (..., 4), which broadcast: `right` turns first."""
    if isinstance(left, np.ndarray):
        return _components_last(multiply_parts(_components_first(left), _components_first(np.asarray(right))))
    xp = _module_of(left)
    left, right = xp.broadcast_tensors(left, right)
    v, w, a, b = left[..., :3], left[..., 3:], right[..., :3], right[..., 3:]
    vector = w * a + b * v + xp.linalg.cross(v, a, dim=-1)
    return xp.cat([vector, w * b - (v * a).sum(-1)[..., None]], dim=-1)


def multiply_parts(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Products of quaternions given by components (4, ...): each operation is on whole arrays."""
    x1, y1, z1, w1 = left
    x2, y2, z2, w2 = right
    x = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
    out = np.empty((4, *np.shape(x)), x.dtype)  # np.stack alone takes longer than this on small arrays
    out[0] = x
    out[1] = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2
    out[2] = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
    out[3] = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2
    return out


def _components_first(values: np.ndarray) -> np.ndarray:
    """A view (C, ...) of an array (..., C), several times as fast as np.moveaxis."""
    return values.transpose(values.ndim - 1, *range(values.ndim - 1))


def _components_last(parts: np.ndarray) -> np.ndarray:
    """A view (..., C) of an array (C, ...)."""
    return parts.transpose(*range(1, parts.ndim), 0)


def rotate(rotations: Array, vectors: Array) -> Array:
    """Vectors (..., 3) turned by unit quaternions (..., 4), which broadcast: v + 2 w (q x v) + 2 q x (q x v)."""
    if not isinstance(rotations, np.ndarray):
        xp = _module_of(rotations)
        cross = xp.linalg.cross
        axis, vectors = xp.broadcast_tensors(rotations[..., :3], vectors)
        across = 2 * cross(axis, vectors, dim=-1)
        return vectors + rotations[..., 3:] * across + cross(axis, across, dim=-1)
    a, b, c = rotate_parts(_components_first(rotations), _components_first(np.asarray(vectors)))
    out = np.empty((*a.shape, 3), a.dtype)
    out[..., 0], out[..., 1], out[..., 2] = a, b, c
    return out


def rotate_parts(rotations: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The three components of vectors (3, ...) turned by quaternions (4, ...), components first, as `rotate` does."""
    x, y, z, w = rotations
    a, b, c = vectors
    # Written out, since np.cross alone takes longer than this on small arrays.
    p, q, r = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p


def unit(rotations: Tensor) -> Tensor:
    """Quaternions (..., 4) scaled to length 1; one of length 0 becomes NaN."""
    import torch

    return rotations / torch.linalg.vector_norm(rotations, dim=-1, keepdim=True)


def matrices(rotations: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    import torch

    x, y, z, w = rotations.unbind(-1)
    xx, yy, zz, ww = (part * part for part in (x, y, z, w))
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    rows = [
        *(xx - yy - zz + ww, 2 * (xy - zw), 2 * (xz + yw)),
        *(2 * (xy + zw), ww - xx + yy - zz, 2 * (yz - xw)),
        *(2 * (xz - yw), 2 * (yz + xw), ww - xx - yy + zz),
    ]
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def from_matrices(turns: Tensor) -> Tensor:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3), of either sign.

    The four rows of 4 q q^T follow from the matrix; the row of the largest component of q is the exact one (F. L.
    Markley, Unit quaternion from rotation matrix, 2008, eq. 7 to 9).
    """
    import torch

    (a, b, c), (d, e, f), (g, h, i) = (row.unbind(-1) for row in turns.unbind(-2))
    outer = torch.stack(
        [
            *(1 + a - e - i, d + b, g + c, h - f),
            *(d + b, 1 - a + e - i, h + f, c - g),
            *(g + c, h + f, 1 - a - e + i, d - b),
            *(h - f, c - g, d - b, 1 + a + e + i),
        ],
        dim=-1,
    ).unflatten(-1, (4, 4))
    largest = outer.diagonal(dim1=-2, dim2=-1).argmax(-1)
    return unit(outer.gather(-2, largest[..., None, None].expand(*largest.shape, 1, 4)).squeeze(-2))


def slerp(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Rotations on the great circle between two, the shorter way.

    Args:
        first, second: (..., 4) unit. share: (..., 1), 0 for the first, 1 for the second.

    Returns: (..., 4), of unit length except for rounding.
    """
    cosine = (first * second).sum(-1)[..., None]
    second = np.where(cosine < 0, -second, second)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(angle)
    near = sine < _LINE_IS_ARC[sine.dtype.itemsize]
    safe = np.where(near, 1.0, sine)
    first_share = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    second_share = np.where(near, share, np.sin(share * angle) / safe)
    return first_share * first + second_share * second


def smallest_turn(directions: Array, targets: Array) -> Array:
    """The rotation of largest real part that takes one direction to another (PC-MRL 3.4, Algorithm 1).

    Two half turns, about the direction eta and about the half-way direction h = (eta + omega) / |eta + omega|, make
    the turn from eta to omega by twice the angle between eta and h: q = -(h x eta) as pure quaternions, whose real
    part is h . eta >= 0. (As printed, the half-way vector is not normalised and the sign is the other one.)

    Args:
        directions, targets: (..., 3), any length. Opposite directions give a rotation of 180 degrees about an axis at
            right angles to them, always the same for the same directions; a zero vector gives the identity.

    Returns: (..., 4) unit quaternions, real part >= 0, of the dtype of `directions`. Computed in float64.
    """
    xp = _module_of(directions)
    have, wanted = (xp.asarray(each, dtype=xp.float64) for each in (directions, targets))
    eta, omega = _unit(have), _unit(wanted)
    half = eta + omega
    eta = xp.broadcast_to(eta, half.shape)
    length = _norm(half)
    half = xp.where(length > _OPPOSITE, half / length.clip(_OPPOSITE), xp.cross(_across(eta), eta, axis=-1))
    turn = _unit(xp.concatenate([xp.cross(eta, half, axis=-1), (half * eta).sum(-1)[..., None]], axis=-1))
    has_length = (_norm(have) > 0) & (_norm(wanted) > 0)
    turn = xp.where(has_length, turn, _constant([0.0, 0.0, 0.0, 1.0], turn))
    return xp.asarray(turn, dtype=directions.dtype)


def _across(directions: Array) -> Array:
    """Unit vectors at right angles to unit vectors (..., 3): across the axis that each is farthest from."""
    xp = _module_of(directions)
    axes = _constant(np.eye(3).tolist(), directions)
    return _unit(xp.cross(directions, axes[abs(directions).argmin(-1)], axis=-1))


def _constant(values: list, like: Array) -> Array:
    """Numbers as an array of the same kind, dtype and device as another."""
    return np.array(values, like.dtype) if isinstance(like, np.ndarray) else like.new_tensor(values)


def _norm(vectors: Array) -> Array:
    """Lengths (..., 1) of vectors (..., C)."""
    return _module_of(vectors).sqrt((vectors * vectors).sum(-1)[..., None])


def _unit(vectors: Array) -> Array:
    """Vectors (..., C) of length 1; zero vectors stay zero."""
    return vectors / _norm(vectors).clip(1e-12)


def _module_of(rotations: np.ndarray | Tensor) -> Any:
    """`numpy` or `torch`, by the type of the array."""
    return np if isinstance(rotations, np.ndarray) else sys.modules["torch"]


def turned_about_y(positions: np.ndarray, yaws: np.ndarray) -> np.ndarray:
    """Positions (..., 3) turned about Y by angles that broadcast with (...)."""
    x, y, z = np.moveaxis(positions, -1, 0)
    cosine, sine = np.cos(yaws), np.sin(yaws)
    return np.stack([cosine * x + sine * z, y + 0 * cosine, cosine * z - sine * x], axis=-1)
