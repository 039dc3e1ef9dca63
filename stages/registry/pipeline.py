"""The stages of a run, in order, with the forms of `ingest`."""

from __future__ import annotations

from stages.registry.stage import Stage


def _ingest(name: str, reads: str, summary: str, example: str, *flags: str) -> Stage:
    """`pumps ingest NAME`: ingest with its format fixed. `flags` are those that only some formats have."""
    return Stage(
        ("ingest", name), summary, (reads,), "motion", example,
        arguments=("sources",), pipeline=False, form_of="ingest", fixed=(("format", name),),
        without=tuple(flag for flag in ("skeleton", "body_models") if flag not in flags),
    )  # fmt: skip


STAGES: tuple[Stage, ...] = (
    Stage(
        ("ingest", "auto"),
        "Read recordings of any format (files, folders, globs, archives) into one motion artefact.",
        ("any format",), "motion", "pumps ingest auto recordings/ more.zip -o runs/mine/ingest",
        arguments=("sources",),
    ),
    _ingest(
        "bvh", "BVH", "Read BVH files into one motion artefact.",
        "pumps ingest bvh recordings/ more.zip -o runs/mine/ingest",
    ),
    _ingest(
        "asf", "ASF/AMC", "Read Acclaim AMC files, each with the ASF in its folder.",
        "pumps ingest asf recordings/cmu.tar.gz -o runs/mine/ingest", "skeleton",
    ),
    _ingest(
        "amass", "npz", "Read AMASS files (SMPL, SMPL-H, SMPL-X).",
        "pumps ingest amass recordings/ --body-models models -o runs/mine/ingest", "body_models",
    ),
    _ingest(
        "deepmimic", "JSON", "Read DeepMimic clips (humanoid3d).",
        "pumps ingest deepmimic recordings/ -o runs/mine/ingest",
    ),
    _ingest(
        "robot", "URDF, CSV", "Read the joint angles of robots, each with the URDF near it.",
        "pumps ingest robot recordings/ --skeleton robot.urdf -o runs/mine/ingest", "skeleton",
    ),
    _ingest(
        "positions", "npy, npz, CSV", "Read joint positions, and find rotations by inverse kinematics.",
        "pumps ingest positions recordings/ --skeleton rig.bvh -o runs/mine/ingest", "skeleton",
    ),
    _ingest(
        "gltf", "glTF, GLB", "Read the animated skins of glTF and GLB files.",
        "pumps ingest gltf recordings/ -o runs/mine/ingest",
    ),
    Stage(
        ("sample-tpc",),
        "Draw points around the bones: motions become temporal point clouds.",
        ("motion",), "tpc", "pumps sample-tpc --motion runs/mine/ingest -o runs/mine/sample-tpc",
        needs=("ingest",), inputs=(("motion", "ingest"),),
    ),
    Stage(
        ("train", "ae"),
        "Train the autoencoder of point clouds.",
        ("tpc",), "checkpoint",
        "pumps train ae --preset tiny --tpc runs/mine/sample-tpc -o runs/mine/train-ae",
        needs=("sample-tpc",), inputs=(("tpc", "sample-tpc"),),
    ),
    Stage(
        ("encode",),
        "Encode the cloud of every frame as a latent vector.",
        ("tpc", "checkpoint"), "latent",
        "pumps encode --tpc runs/mine/sample-tpc --ae runs/mine/train-ae -o runs/mine/encode",
        needs=("sample-tpc", "train-ae"), inputs=(("tpc", "sample-tpc"), ("ae", "train-ae")),
    ),
    Stage(
        ("train", "lms"),
        "Train the latent motion synthesiser, which fills in missing frames.",
        ("tpc", "checkpoint", "latent"), "checkpoint",
        "pumps train lms --preset tiny --tpc runs/mine/sample-tpc --ae runs/mine/train-ae -o runs/mine/train-lms",
        needs=("sample-tpc", "train-ae", "encode"),
        inputs=(("tpc", "sample-tpc"), ("ae", "train-ae"), ("latent", "encode")),
    ),
    Stage(
        ("train", "skeleton"),
        "Train a network that turns clouds of any skeleton into motion of one rig.",
        ("BVH", "tpc"), "checkpoint",
        "pumps train skeleton --preset tiny --skeleton rig.bvh --tpc runs/mine/sample-tpc -o runs/mine/rig",
        pipeline=False,
    ),
    Stage(
        ("train", "finetune"),
        "Fine-tune the synthesiser for a task on one rig: denoise, repair, estimate, trackers.",
        ("BVH", "tpc", "checkpoint"), "checkpoint",
        "pumps train finetune --task denoise --skeleton rig.bvh --tpc runs/mine/sample-tpc -o runs/mine/denoise",
        pipeline=False,
    ),
    Stage(
        ("train", "denoiser"),
        "Train a denoiser of latents for all rigs at once, from the synthesiser of trained weights.",
        ("tpc", "checkpoint"), "checkpoint",
        "pumps train denoiser --tpc runs/mine/sample-tpc -o runs/mine/denoiser",
        pipeline=False,
    ),
    Stage(
        ("data", "pick"),
        "Copy a few test clips from the sources as BVH files, to be filled.",
        ("motion",), "BVH", "pumps data pick --motion runs/mine/ingest -o runs/mine/data-pick",
        needs=("ingest",), inputs=(("motion", "ingest"),), target="clips.txt",
    ),
    Stage(
        ("infill",),
        "Fill the missing frames between the keyframes of a BVH, or of a robot's joint angles.",
        ("BVH", "checkpoint"), "BVH", "pumps infill walk.bvh --keyframes 0,15,40 -o filled.bvh",
        arguments=("input",), needs=("data-pick", "train-ae", "train-lms"),
        inputs=(("input", "data-pick/{clip}.bvh"), ("weights", ".")), target="{clip}.bvh", writes_file=True,
    ),
    Stage(
        ("decode",),
        "Decode latents into clouds, and latents or clouds into skeletal motion.",
        ("latent", "tpc", "checkpoint", "motion"), "tpc or motion",
        "pumps decode --latent runs/mine/encode --ae runs/mine/train-ae -o runs/mine/decode",
        needs=("ingest", "train-ae", "encode"),
        inputs=(("latent", "encode"), ("ae", "train-ae"), ("motion", "ingest")),
    ),
    Stage(
        ("evaluate",),
        "Measure filling on the test clips, beside LERP and SLERP.",
        ("motion", "checkpoint"), "metrics",
        "pumps evaluate --motion runs/mine/ingest --weights small-free -o runs/mine/evaluate",
        needs=("ingest", "train-ae", "train-lms"),
        inputs=(("motion", "ingest"), ("weights", "pumps=."), ("weights", "{weights}")),
    ),
    Stage(
        ("report",),
        "Write an HTML page that works offline: results, loss curves, motions side by side.",
        ("metrics", "checkpoint", "motion", "BVH"), "HTML",
        "pumps report --metrics runs/mine/evaluate --checkpoints runs/mine/train-ae -o report.html",
        needs=("train-ae", "train-lms", "data-pick", "infill", "evaluate"),
        inputs=(
            ("metrics", "evaluate"), ("checkpoints", "train-ae"), ("checkpoints", "train-lms"),
            ("motions", "{clip}/truth=data-pick/{clip}.bvh"), ("motions", "{clip}/PUMPS=infill/{clip}.bvh"),
        ),
        target="report.html", writes_file=True,
    ),
)  # fmt: skip
