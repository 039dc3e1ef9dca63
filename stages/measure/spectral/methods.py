"""Methods that predict a window of meshes: plain ones, networks of meshes, of joints, and of skeletons."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from data_schemas.errors import InputError, UsageError
from data_schemas.mesh import MeshReader
from data_schemas.skeleton import Motion
from data_schemas.skinned_body import skinned_vertices
from stages.measure.spectral.config import Config
from stages.shared.inference.cloud_sources import SynthesisedClouds
from stages.shared.inference.filling import FillOptions, fill_motion
from stages.shared.inference.models import Models, load_weights
from stages.shared.inference.spectral import (
    JointWeights,
    SpectralWeights,
    is_joint_mlp,
    load_joint_mlp,
    load_spectral,
)
from stages.shared.meshes.body_rig import BodyRig, rig_of_body
from stages.shared.meshes.linear_views import LinearView
from stages.shared.meshes.windows import MeshWindow
from stages.shared.weights.shipped import named_source, parts_of, weights_folder

TRUTH, REPEAT, CONSTANT = "truth", "repeat last", "constant velocity"
_PUMPS = "PUMPS"


@dataclass(frozen=True)
class Predicted:
    """What a method made of a window.

    joints: (ahead, K, 3) metres, None for meshes without joints. vertices: the meshes (F, N, 3) metres of the
    frames asked for, 0 for the first predicted one; None for a method that knows no surface.
    """

    joints: np.ndarray | None
    vertices: Callable[[np.ndarray], np.ndarray] | None


class MeshViews:
    """The artefact with the linear maps that methods read. joints: None for meshes without joints."""

    def __init__(self, reader: MeshReader, config: Config):
        self.reader, self.known, self.ahead, self.seed = reader, config.known, config.ahead, config.seed
        regressor = reader.topology.joints
        self.joints = LinearView(reader, regressor.matrix(reader.topology.count)) if regressor.names else None


Method = Callable[[MeshViews, MeshWindow], Predicted]


def true_window(views: MeshViews, window: MeshWindow) -> Predicted:
    """The frames as they are."""
    start = window.start + views.known
    joints = views.joints.window(window.clip, start, window.stop) if views.joints is not None else None

    def vertices(frames: np.ndarray) -> np.ndarray:
        return np.concatenate([views.reader.vertices(window.clip, start + f, start + f + 1) for f in frames.tolist()])

    return Predicted(joints, vertices)


def extrapolated(views: MeshViews, window: MeshWindow, *, moving: bool) -> Predicted:
    """The last known frame, or the line through the last two, of vertices and joints."""
    stop = window.start + views.known
    share = np.arange(1, views.ahead + 1)[:, None, None] * float(moving)
    joints = None
    if views.joints is not None:
        before, last = views.joints.window(window.clip, stop - 2, stop)
        joints = last + share * (last - before)

    def vertices(frames: np.ndarray) -> np.ndarray:
        before, last = views.reader.vertices(window.clip, stop - 2, stop)
        return last + share[frames] * (last - before)

    return Predicted(joints, vertices)


@dataclass
class SpectralMethod:
    """SpecTrHuMS: coefficients of the known frames in, of the next frames out."""

    weights: SpectralWeights
    _view: LinearView | None = field(default=None, init=False)
    _joints: np.ndarray | None = field(default=None, init=False)  # (K, k) of coefficients

    def __call__(self, views: MeshViews, window: MeshWindow) -> Predicted:
        basis = self.weights.basis
        if self._view is None:
            self._view = LinearView(views.reader, basis.vectors.T)
        known = self._view.window(window.clip, window.start, window.start + views.known)
        made = self.weights.predict(known[None], views.ahead)[0]
        joints = None
        if views.joints is not None:
            if self._joints is None:
                self._joints = views.joints.mapping @ basis.vectors
            joints = np.einsum("jk,tkd->tjd", self._joints, made)
        return Predicted(joints, lambda frames: basis.vertices(made[frames]))


@dataclass
class JointMethod:
    """siMLPe: joints alone."""

    weights: JointWeights

    def __call__(self, views: MeshViews, window: MeshWindow) -> Predicted:
        if views.joints is None:
            raise InputError("These meshes have no joints, which siMLPe needs.", "Leave its weights out.")
        known = views.joints.window(window.clip, window.start, window.start + views.known)
        made = self.weights.predict(known[None])[0]
        if len(made) < views.ahead:
            raise UsageError(f"These weights predict {len(made)} frames, and {views.ahead} are asked for.")
        return Predicted(made[: views.ahead], None)


@dataclass
class SkeletonMethod:
    """PUMPS: the skeleton of the body is filled by `infill`'s models, and the body is skinned afterwards.

    The pelvis of the result is put back to where meshes without root motion have it.
    """

    models: Models
    removed: bool
    _rigs: dict[str, BodyRig] = field(default_factory=dict, init=False)

    def __call__(self, views: MeshViews, window: MeshWindow) -> Predicted:
        reader = views.reader
        skin, row = reader.topology.skin, reader.row(window.clip)
        if skin is None or not reader.is_skinned(window.clip):
            raise InputError("PUMPS predicts skeletons, and these meshes have no bones.", "Leave --pumps out.")
        body = reader.body(row.skeleton)
        if row.skeleton not in self._rigs:
            self._rigs[row.skeleton] = rig_of_body(skin, body)
        rig = self._rigs[row.skeleton]
        stop = window.start + views.known
        given = rig.motion_of(*reader.bones(window.clip, window.start, stop), row.fps)
        known = np.arange(views.known + views.ahead) < views.known
        # Unknown rows hold the last known pose; they are not read.
        rows = np.minimum(np.arange(len(known)), views.known - 1)
        motion = Motion(given.rotations[rows], given.root_positions[rows], row.fps)
        filled = fill_motion(
            rig.skeleton, motion, known, SynthesisedClouds(self.models), seed=views.seed, options=FillOptions()
        ).motion
        rotations, heads = rig.on_bones(filled.at(slice(views.known, None)))
        if self.removed:
            rotations, heads = rig.without_root(rotations, heads)
        joints = views.joints.of_bones(row.skeleton, rotations, heads) if views.joints is not None else None
        return Predicted(joints, lambda frames: skinned_vertices(skin, body, rotations[frames], heads[frames]))


def methods_of(config: Config, reader: MeshReader) -> tuple[dict[str, Method], list[Path]]:
    """The methods by name, and the checkpoints that they are of.

    Raises: UsageError for two rows of one name; InputError for weights of another connectivity, task or window.
    """
    methods: dict[str, Method] = {
        TRUTH: true_window,
        REPEAT: lambda views, window: extrapolated(views, window, moving=False),
        CONSTANT: lambda views, window: extrapolated(views, window, moving=True),
    }
    paths = []
    for text, last in (*((text, False) for text in config.weights), *((text, True) for text in config.last)):
        name, source = named_source(text)
        if name in methods or (name == _PUMPS and config.pumps is not None):
            flag = "--last" if last else "--weights"
            raise UsageError(f"Two rows are called {name!r}.", f"Give another name: {flag} NAME={source}.")
        if is_joint_mlp(source):
            joint = load_joint_mlp(source, config.device, last=last)
            reader.check_connectivity(joint.connectivity, source)
            known, methods[name] = joint.known, JointMethod(joint)
        else:
            spectral = load_spectral(source, config.device, last=last)
            spectral.check_task("predict")
            reader.check_connectivity(spectral.connectivity, source)
            known, methods[name] = spectral.known, SpectralMethod(spectral)
        if known > config.known:
            raise UsageError(f"{source} predicts from {known} frames, and --known is {config.known}.")
        if Path(source) not in paths:
            paths.append(Path(source))
    if config.pumps is not None:
        removed = reader.artefact.manifest.config.get("root") == "removed"
        methods[_PUMPS] = SkeletonMethod(load_weights(config.pumps, config.device), removed)
        paths += parts_of(weights_folder(config.pumps))
    return methods, paths
