"""Stages beside the pipeline: tools for files, weights and data, and what measures one part."""

from __future__ import annotations

from stages.registry.stage import Stage

STAGES: tuple[Stage, ...] = (
    Stage(
        ("denoise",),
        "Clean a noisy motion on its own skeleton: mend noisy and missing frames, keep the others.",
        ("any format", "checkpoint"), "BVH, GLB, npz, CSV, Parquet", "pumps denoise noisy.bvh -o clean.bvh",
        arguments=("input",), pipeline=False,
    ),
    Stage(
        ("retarget",),
        "Put a motion on another rig, with any joint names and proportions.",
        ("BVH", "checkpoint"), "BVH", "pumps retarget walk.bvh --to rig.bvh -o walk_on_rig.bvh",
        arguments=("input",), pipeline=False,
    ),
    Stage(
        ("estimate",),
        "Turn 2D keypoints of a video into motion on a rig.",
        ("JSON", "CSV", "npz", "checkpoint"), "BVH", "pumps estimate keypoints.json --skeleton rig.bvh -o moved.bvh",
        arguments=("input",), pipeline=False,
    ),
    Stage(
        ("data", "rerig"),
        "Put test clips on the rigs of other recordings, to measure on skeletons that no training used.",
        ("motion",), "motion",
        "pumps data rerig --motion runs/mine/ingest --rigs runs/others/ingest -o runs/mine/on-other-rigs",
        pipeline=False,
    ),
    Stage(
        ("train", "citl"),
        "Train an interpolator of one skeleton's poses, on motions of that skeleton (PC-MRL).",
        ("tpc",), "checkpoint",
        "pumps train citl --preset pcmrl --tpc runs/mine/adapted-tpc -o runs/mine/train-citl",
        pipeline=False,
    ),
    Stage(
        ("weights", "average"),
        "Average several trainings that started from the same weights.",
        ("checkpoint",), "checkpoint",
        "pumps weights average runs/mine/lms-1 runs/mine/lms-2 -o runs/mine/train-lms",
        arguments=("checkpoints",), pipeline=False,
    ),
    Stage(
        ("measure", "ae"),
        "Measure autoencoders on held-out clouds: the rows of PUMPS Table 2.",
        ("tpc", "checkpoint"), "metrics",
        "pumps measure ae --tpc runs/mine/sample-tpc --weights mine=runs/mine/train-ae -o runs/mine/measure-ae",
        pipeline=False,
    ),
    Stage(
        ("measure", "latents"),
        "Measure how much latents change with the points, sigma or the skeleton.",
        ("motion", "checkpoint"), "metrics",
        "pumps measure latents --motion runs/mine/ingest --weights tiny -o runs/mine/measure-latents",
        pipeline=False,
    ),
    Stage(
        ("measure", "pcmrl"),
        "Measure as PC-MRL's tables do: fill a skeleton's own motions, compare adapted motions with their sources.",
        ("tpc", "checkpoint"), "metrics",
        "pumps measure pcmrl --truth runs/mine/sample-tpc --weights mine=runs/mine/train-citl -o runs/mine/measure",
        pipeline=False,
    ),
    Stage(
        ("measure", "motions"),
        "Compare motions with the true motions of the same clips and joints.",
        ("motion",), "metrics",
        "pumps measure motions --truth runs/mine/ingest --made network=runs/mine/decode -o runs/mine/measure-motions",
        pipeline=False,
    ),
    Stage(
        ("measure", "estimate"),
        "Measure networks from 2D keypoints to motion on held-out clips of their rig: PUMPS Table 3.",
        ("tpc", "checkpoint"), "metrics",
        "pumps measure estimate --tpc runs/mine/sample-tpc --weights mine=runs/mine/lifter -o runs/mine/measured",
        pipeline=False,
    ),
    Stage(
        ("measure", "denoise"),
        "Measure denoising on held-out clips with noise added: mending, filters, networks (PUMPS Table 4).",
        ("motion", "checkpoint"), "metrics",
        "pumps measure denoise --motion runs/mine/ingest -o runs/mine/measure-denoise",
        pipeline=False,
    ),
    Stage(
        ("measure", "solve"),
        "Measure how well skeletons follow clouds: true, noisy, scaled, on unusual rigs.",
        ("motion", "checkpoint"), "metrics",
        "pumps measure solve --motion runs/mine/ingest -o runs/mine/measure-solve",
        pipeline=False,
    ),
    Stage(
        ("weights", "calibrate"),
        "Measure how reliable weights are, on clips they were not trained on, and store the result with them.",
        ("checkpoint", "motion"), "", "pumps weights calibrate runs/mine --motion runs/mine/ingest",
        arguments=("weights",), pipeline=False,
    ),
    Stage(
        ("weights", "pack"),
        "Make the networks of a run small enough to share, with one model card.",
        ("checkpoint",), "checkpoint", "pumps weights pack runs/mine -o weights/mine",
        arguments=("run",), pipeline=False, target="lms/manifest.json",
    ),
    Stage(
        ("weights", "list"),
        "List the weights that come with pumps: size, licences, training data.",
        (), "", "pumps weights list",
        pipeline=False,
    ),
    Stage(
        ("weights", "show"),
        "Show what is known about weights: licences, validation, what they are good and bad at.",
        ("checkpoint",), "", "pumps weights show tiny",
        arguments=("name",), pipeline=False,
    ),
    Stage(
        ("export",),
        "Write motions as BVH, GLB with an animated skin, AMASS-like npz, CSV or Parquet.",
        ("any format", "motion"), "BVH, GLB, npz, CSV, Parquet", "pumps export walk.bvh -o walk.glb",
        arguments=("input",), pipeline=False,
    ),
    Stage(
        ("project",),
        "Project a motion into a camera, as 2D keypoints of a pose detector.",
        ("any format",), "JSON", "pumps project walk.bvh -o walk_keypoints.json",
        arguments=("input",), pipeline=False,
    ),
    Stage(
        ("inspect",),
        "Show what a motion file holds: skeleton, body groups, unit, facing, frame rate, problems.",
        ("any format",), "", "pumps inspect walk.bvh",
        arguments=("path",), pipeline=False,
    ),
    Stage(
        ("data", "list"),
        "List public data sets: licence, size, home page.",
        (), "", "pumps data list",
        pipeline=False,
    ),
    Stage(
        ("data", "fetch"),
        "Download a public data set and verify it; an interrupted download continues.",
        (), "archives", "pumps data fetch 100style -o data --accept-licence",
        arguments=("name",), pipeline=False,
    ),
    Stage(
        ("doctor",),
        "Check this installation: versions, devices, weights.",
        (), "", "pumps doctor",
        pipeline=False,
    ),
)  # fmt: skip
