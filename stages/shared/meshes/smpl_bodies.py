"""Bodies of the SMPL family (SMPL, SMPL-H, SMPL-X), posed by the package smplx; the model files are the user's own.

Only the package's function of shape, pose correctives and skinning is called. Its loaders unpickle, so files are read
here, as plain arrays alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from data_schemas.errors import InputError, PumpsError
from data_schemas.skinned_body import JointRegressor, Topology
from stages.shared.formats.arrays import read_arrays
from stages.shared.formats.smpl import LAYOUTS, model_path, shapes_of

_ARRAYS = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table", "f")
_FRAMES_AT_ONCE = 64


@dataclass(frozen=True)
class SmplModel:
    """A body model of N vertices and J joints.

    template: (N, 3) metres. shape_directions: (N, 3, B). pose_directions: (9 (J - 1), 3 N). regressor: (J, N).
    weights: (N, J). parents: (J,), -1 for the pelvis. faces: (F, 3).
    """

    path: Path
    template: np.ndarray
    shape_directions: np.ndarray
    pose_directions: np.ndarray
    regressor: np.ndarray
    weights: np.ndarray
    parents: np.ndarray
    faces: np.ndarray
    _lbs: Any

    @property
    def topology(self) -> Topology:
        """The triangles, with the regressor of the joints of the body (SpecTrHuMS 4.2: 22 joints)."""
        names = LAYOUTS["body"][: len(self.regressor)]
        rows, vertices = np.nonzero(self.regressor[: len(names)])
        weights = self.regressor[rows, vertices].astype(np.float32)
        regressor = JointRegressor(names, rows.astype(np.int32), vertices.astype(np.int32), weights)
        return Topology(self.faces.astype(np.int32), len(self.template), regressor)

    def shaped(self, betas: np.ndarray) -> np.ndarray:
        """(N, 3) float32 metres: the body of a shape at rest. betas: (B,); those beyond the model's number are
        left out."""
        own = self._betas(betas)
        return (self.template + self.shape_directions @ own).astype(np.float32)

    def vertices(self, vectors: np.ndarray, betas: np.ndarray) -> Iterator[np.ndarray]:
        """Vertices (t, N, 3) float32 metres of T poses, some at a time.

        Args:
            vectors: (T, 3 K) rotation vectors in the parents' frames, K at most J; further joints are not turned.
            betas: (B,); those beyond the model's number are left out.
        """
        import torch

        poses = np.zeros((len(vectors), 3 * len(self.parents)), np.float32)
        poses[:, : vectors.shape[1]] = vectors[:, : poses.shape[1]]
        shape = torch.from_numpy(self._betas(betas))[None]
        arrays = [
            torch.from_numpy(np.ascontiguousarray(each, np.float32))
            for each in (self.template, self.shape_directions, self.pose_directions, self.regressor)
        ]
        parents, weights = torch.from_numpy(self.parents.astype(np.int64)), torch.from_numpy(self.weights)
        for start in range(0, len(poses), _FRAMES_AT_ONCE):
            pose = torch.from_numpy(poses[start : start + _FRAMES_AT_ONCE])
            with torch.no_grad():
                made, _ = self._lbs(shape.expand(len(pose), -1), pose, *arrays, parents, weights)
            yield made.numpy()

    def _betas(self, betas: np.ndarray) -> np.ndarray:
        own = np.zeros(self.shape_directions.shape[2], np.float32)
        count = min(len(own), len(betas))
        own[:count] = betas[:count]
        return own


def load_smpl(folder: Path, layout: str, gender: str) -> SmplModel:
    """The body model of a layout and gender in the user's folder.

    Raises: PumpsError if the package smplx is not installed; InputError if there is no such model or it is damaged.
    """
    try:
        lbs = import_module("smplx.lbs").lbs
    except ImportError as error:
        raise PumpsError(
            "The surface of SMPL's bodies needs the package smplx, which is not installed.",
            "Install it: pip install 'pumps[smplx]'. Without --body-models, `pumps skin` uses anny's bodies.",
        ) from error
    path = model_path(folder, layout, gender)
    try:
        arrays, pickled = read_arrays(path.read_bytes(), str(path), _ARRAYS)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    if pickled or set(arrays) != set(_ARRAYS):
        lacking = ", ".join(sorted({*pickled, *(set(_ARRAYS) - set(arrays))}))
        raise InputError(f"{path} lacks plain arrays of {lacking}.", "Use the .npz of its publisher.")
    numbers = {name: np.asarray(arrays[name]) for name in _ARRAYS}
    fault = _fault(numbers)
    if fault:
        raise InputError(f"{path} is damaged: {fault}.", "Use the .npz of its publisher.")
    directions = numbers["shapedirs"][..., : shapes_of(numbers["shapedirs"])].astype(np.float32)
    correctives = numbers["posedirs"].reshape(-1, numbers["posedirs"].shape[-1]).T
    parents = numbers["kintree_table"][0].astype(np.int64)
    parents[0] = -1  # files have the greatest unsigned number
    return SmplModel(
        path=path,
        template=numbers["v_template"].astype(np.float32),
        shape_directions=directions,
        pose_directions=correctives.astype(np.float32),
        regressor=numbers["J_regressor"].astype(np.float32),
        weights=numbers["weights"].astype(np.float32),
        parents=parents,
        faces=numbers["f"].astype(np.int64),
        _lbs=lbs,
    )


def _fault(arrays: dict[str, np.ndarray]) -> str | None:
    """What does not fit, as the end of a sentence; None if all fits."""
    if any(each.dtype.kind not in "fiu" for each in arrays.values()):
        return "it holds arrays that are no numbers"
    count, joints = (arrays[name].shape[0] if arrays[name].ndim else 0 for name in ("v_template", "J_regressor"))
    if not count or not joints:
        return "it has no vertices or no joints"
    shapes = {
        "v_template": (count, 3), "shapedirs": (count, 3, None), "posedirs": (count, 3, 9 * (joints - 1)),
        "J_regressor": (joints, count), "weights": (count, joints), "kintree_table": (2, joints), "f": (None, 3),
    }  # fmt: skip
    for name, shape in shapes.items():
        own = arrays[name].shape
        if len(own) != len(shape) or any(want not in (None, have) for want, have in zip(shape, own, strict=True)):
            return f"{name} has the shape {own}"
        if arrays[name].dtype.kind == "f" and not np.isfinite(arrays[name]).all():
            return f"{name} holds numbers that are not finite"
    parents = arrays["kintree_table"][0].astype(np.int64)[1:]
    if (parents < 0).any() or (parents >= np.arange(1, joints)).any():
        return "a joint does not come after its parent"
    return None
