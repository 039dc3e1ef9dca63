"""Every stage, in order: the command that runs it, what it reads and writes. Help, README and tests come from here.

Modules are named by strings, so that asking what stages there are loads none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stages.shared.contract import StageConfig, StageReport


@dataclass(frozen=True)
class Stage:
    """One stage of the pipeline, or a tool beside it.

    command:   the words after `pumps` ("train", "ae"). `auto` at their end means the stage itself, beside its forms.
    summary:   one sentence for help and tables.
    reads:     kinds of artefacts or files that it reads.
    writes:    kind of artefact or file that it writes; "" for a tool that only prints.
    example:   a command line that a user would type.
    arguments: fields of its Config that are given by position, not by flag.
    needs:     in a run, the stages whose outputs it reads.
    inputs:    in a run, how those outputs are given to it: (field of its Config, place). A place is a path in the
               run's folder that begins with a stage's name, "." for the folder itself, or {weights} for weights to
               compare; {clip} stands for each of the run's clips in turn. "LABEL=" may come before a place.
    target:    in a run, the file in its folder that is there when the stage is done.
    writes_file: whether its output is that file instead of the folder.
    pipeline:  False for a tool that is not a node of a run.
    form_of:   for a further command of a stage, the stage's name: the two share their settings.
    fixed:     settings that this command fixes, which have no flags.
    without:   settings that have no meaning for this command, and have no flags.
    """

    command: tuple[str, ...]
    summary: str
    reads: tuple[str, ...]
    writes: str
    example: str
    arguments: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    target: str = "manifest.json"
    writes_file: bool = False
    pipeline: bool = True
    form_of: str = ""
    fixed: tuple[tuple[str, str], ...] = ()
    without: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Its table in a preset, its config file and its folder in a run: the words typed ("train-ae")."""
        return "-".join(word for word in self.command if word != "auto")

    @property
    def package(self) -> str:
        """The package that holds `config.Config` and `run.run`: the words typed again ("stages.train.ae")."""
        words = stage_named(self.form_of).command if self.form_of else self.command
        return ".".join(("stages", *(word.replace("-", "_") for word in words if word != "auto")))

    def config_type(self) -> type[StageConfig]:
        """The stage's Config. Loads no torch."""
        return import_module(f"{self.package}.config").Config

    def runner(self) -> Callable[..., StageReport]:
        """The stage's `run(config, *, progress)`. Loads whatever the stage computes with."""
        return import_module(f"{self.package}.run").run


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
        "pumps evaluate --motion runs/mine/ingest --weights tiny -o runs/mine/evaluate",
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
    Stage(
        ("retarget",),
        "Put a motion on another rig, with any joint names and proportions.",
        ("BVH", "checkpoint"), "BVH", "pumps retarget walk.bvh --to rig.bvh -o walk_on_rig.bvh",
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

# What `pumps --help` shows: panel -> words after `pumps`, in the order of reading.
PANELS = {
    "Animate": ("infill", "retarget", "inspect", "export", "report", "formats", "doctor"),
    "Data": ("data", "ingest", "artefact"),
    "Train": ("sample-tpc", "encode", "train", "weights", "config"),
    "Research": ("evaluate", "measure", "decode", "results", "stages"),
}

GROUP_SUMMARIES = {
    "data": "List and download public data sets; pick clips, or put them on other rigs.",
    "ingest": "Read recordings into a motion artefact.",
    "measure": "Measure one part: autoencoders, latents, the solver, motions.",
    "train": "Train a network.",
    "weights": "List and show the weights that come with pumps; average, calibrate and pack your own.",
}

# Names of stages in 0.1.0 -> names now. Settings files and `--set` may have the old ones for one more version.
OLD_NAMES = {
    "average-checkpoints": "weights-average",
    "calibrate": "weights-calibrate",
    "fetch-data": "data-fetch",
    "list-data": "data-list",
    "list-weights": "weights-list",
    "pack-weights": "weights-pack",
    "pick-clips": "data-pick",
    "retarget-clips": "data-rerig",
    "show-weights": "weights-show",
}
# Those of them that were commands. They are not in help, and are removed in the next version.
OLD_WORDS = ("average-checkpoints", "calibrate", "pack-weights", "pick-clips", "retarget-clips")


def stage_named(name: str) -> Stage:
    """The stage with this name. Raises KeyError."""
    for stage in STAGES:
        if stage.name == name:
            return stage
    raise KeyError(f"no stage is called {name!r}; there are {', '.join(NAMES)}")


def downstream_of(names: set[str]) -> set[str]:
    """The pipeline stages that must run again when these have, themselves included."""
    stale = set(names)
    for stage in PIPELINE:  # in order, so that one pass reaches everything
        if stale.intersection(stage.needs):
            stale.add(stage.name)
    return stale


PIPELINE = tuple(stage for stage in STAGES if stage.pipeline)
NAMES = tuple(stage.name for stage in STAGES if not stage.form_of)
