"""The tasks that are measured, by name. Imports nothing, so that configs may name them."""

from __future__ import annotations

TASK_NAMES = ("interpolation", "transition", "prediction")
INTERPOLATION, TRANSITION, PREDICTION = TASK_NAMES
RETARGETING = "retargeting"
RECONSTRUCTION = "reconstruction"
DENOISING = "denoising"
ESTIMATION = "estimation"
POSE_TASK = "pose task"  # of any name, by `pumps measure task`
OF_PAGES = (DENOISING, ESTIMATION, POSE_TASK)  # no filling: a metrics artefact of these is shown as its page
