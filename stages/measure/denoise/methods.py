"""The methods that are measured: nothing, mending, tuned plain filters, networks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from data_schemas.errors import UsageError
from data_schemas.skeleton import Motion, Skeleton
from stages.measure.denoise.config import Config
from stages.measure.denoise.windows import NoisyWindow
from stages.shared.inference.denoising import DenoiseOptions, denoise_motion
from stages.shared.inference.pose_denoising import fits_rig, refined
from stages.shared.inference.pose_model import PoseModel, load_pose_model
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.kinematics.motion_filters import FILTERS
from stages.shared.pose_tasks.denoise import RepairTask
from stages.shared.statistics.measurements import measured_joints
from stages.shared.statistics.metrics import acceleration_mm, mpjae_deg, mpjpe_mm
from stages.shared.weights.shipped import named_source

NOISY, MENDED = "noisy", "mend"
WIDTHS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
METRICS = ("mpjpe_mm", "acceleration_mm", "mpjae_deg")
Method = Callable[[Skeleton, Motion], Motion | None]  # None where it cannot run on a skeleton


def methods_of(config: Config, widths: dict[str, float]) -> dict[str, Method]:
    """Every method by its name. Raises UsageError for a name that comes twice."""
    methods: dict[str, Method] = {NOISY: lambda _, motion: motion}
    for name, width in widths.items():
        methods[name] = _cleaner(DenoiseOptions(name, width))
    methods[MENDED] = _cleaner(DenoiseOptions())
    for text in config.weights:
        name, path = named_source(text)
        if name in methods:
            raise UsageError(f"Two rows are called {name!r}.", f"Give another name: --weights NAME={path}.")
        methods[name] = _network(load_pose_model(path, ("denoise", "repair"), config.device))
    return methods


def tuned_widths(windows: Sequence[NoisyWindow]) -> dict[str, float]:
    """Each filter's width with the least MPJPE on some windows."""
    chosen = {}
    for name in FILTERS:
        scores = []
        for width in WIDTHS:
            clean = _cleaner(DenoiseOptions(name, width))
            scores.append(np.mean([figures(window, clean(window.skeleton, window.noisy))[0] for window in windows]))
        chosen[name] = WIDTHS[int(np.argmin(scores))]
    return chosen


def figures(window: NoisyWindow, made: Motion | None) -> tuple[float, ...]:
    """The values of `METRICS`, on the body's joints."""
    assert made is not None
    joints = measured_joints(window.skeleton)
    found, true = (positions_of(window.skeleton, motion)[:, joints] for motion in (made, window.true))
    angle = mpjae_deg(made.rotations[:, joints], window.true.rotations[:, joints])
    return float(mpjpe_mm(found, true)), float(acceleration_mm(found, true)), float(angle)


def _cleaner(options: DenoiseOptions) -> Method:
    def clean(skeleton: Skeleton, motion: Motion) -> Motion:
        missing = np.zeros((motion.frames, skeleton.joints), bool)
        return denoise_motion(skeleton, motion, missing, options=options).motion

    return clean


def _network(model: PoseModel) -> Method:
    mend = _cleaner(DenoiseOptions())

    def clean(skeleton: Skeleton, motion: Motion) -> Motion | None:
        if not fits_rig(model, skeleton):
            return None
        start = mend(skeleton, motion) if isinstance(model.task, RepairTask) else motion
        return refined(model, skeleton, motion, start) if start is not None else None

    return clean
