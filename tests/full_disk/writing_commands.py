"""Every command that writes, once for each form of its output, with small settings; later ones read earlier ones.

In the words, {made} is the folder of what earlier commands wrote and {out} is where this one writes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

CLIPS = Path(__file__).resolve().parents[2] / "stages" / "shared" / "clips"
_ENCODER = "--encoder.width 8 --encoder.blocks 2 --encoder.neighbours 4 --encoder.heads 2"
_TRAINING = (
    "--steps 2 --batch 2 --window 32 --points 24 --warmup 1 --validate-every 2 --checkpoint-every 1 --device cpu"
)
_SPECTRAL = (
    "--window 5 --stride 1 --steps 2 --static-steps 1 --batch 2 --warmup 1 --validate-every 2 --checkpoint-every 1 "
    "--network.channels 4 --network.latent 8 --network.heads 2 --network.layers 1 --network.feedforward 8 "
    "--device cpu"
)
_LAYERS = "--synthesiser.key-layers 1 --synthesiser.fill-layers 1 --synthesiser.frame-layers 1"
_ALL = "--splits train --splits val --splits test"


@dataclass(frozen=True)
class Writing:
    """A command line that writes.

    name:      where its output lies: {made}/NAME at first, and then {out}, a path of the same last part.
    command:   the words after `pumps` that name the command.
    words:     its arguments.
    asks:      whether it needs --overwrite where there is an old output.
    replaces:  whether it writes although the same output is there.
    adds_to:   its output is put into a copy of this earlier output, which it reads too.
    """

    name: str
    command: str
    words: str
    asks: bool = True
    replaces: bool = True
    adds_to: str = ""


WRITINGS = (
    Writing(
        "motion", "ingest auto",
        f"{CLIPS}/kick.bvh {CLIPS}/dance_a.bvh {CLIPS}/punch.bvh --splits {CLIPS}/splits.json --licence CC0 "
        "--workers 1 -o {out}",
    ),
    Writing("tpc", "sample-tpc", "--motion {made}/motion --points 64 -o {out}"),
    Writing("baked", "sample-tpc", "--motion {made}/motion --points 64 --bake -o {out}"),
    Writing(
        "run/train-ae", "train ae",
        f"--tpc {{made}}/tpc {_TRAINING} {_ENCODER} --decoder.width 16 --decoder.layers 1 --decoder.heads 2 "
        "--decoder.noise 4 --decoder.point-width 8 --decoder.point-hidden 8 -o {out}",
    ),
    Writing("latent", "encode", "--tpc {made}/tpc --ae {made}/run/train-ae --device cpu -o {out}"),
    Writing(
        "run/train-lms", "train lms",
        f"--tpc {{made}}/tpc --ae {{made}}/run/train-ae {_TRAINING} --synthesiser.width 16 --synthesiser.heads 2 "
        f"{_LAYERS} --reuse 2 --kept-windows 4 -o {{out}}",
    ),
    Writing(
        "rig-network", "train skeleton",
        f"--tpc {{made}}/tpc --skeleton {CLIPS}/kick.bvh {_TRAINING} {_ENCODER} --loss-points 24 --network.width 16 "
        "--network.layers 1 --network.heads 2 -o {out}",
    ),
    Writing(
        "interpolator", "train citl",
        f"--tpc {{made}}/tpc {_TRAINING} --network.width 16 --network.heads 2 --network.key-layers 1 "
        "--network.fill-layers 1 --network.frame-layers 1 -o {out}",
    ),
    Writing(
        "completion", "train baseline",
        f"--method delta --tpc {{made}}/tpc {_TRAINING} --network.width 16 --network.heads 2 --network.layers 1 "
        "-o {out}",
    ),
    Writing(
        "denoiser", "train finetune",
        f"--task denoise --from {{made}}/run --skeleton {CLIPS}/kick.bvh --tpc {{made}}/tpc {_TRAINING} -o {{out}}",
    ),
    Writing(
        "latent-denoiser", "train denoiser", f"--from {{made}}/run --tpc {{made}}/tpc {_TRAINING} -o {{out}}"
    ),
    Writing(
        "lifter", "train finetune",
        f"--task estimate --from {{made}}/run --skeleton {CLIPS}/kick.bvh --tpc {{made}}/tpc {_TRAINING} -o {{out}}",
    ),
    Writing(
        "parts", "train body-parts",
        "--motion {made}/motion --parts 5 --network vae --rate-hz 30 --blocks 1 --latent 30 --steps 2 --batch 2 "
        "--window 16 --validate-every 2 --checkpoint-every 1 --device cpu -o {out}",
    ),
    Writing(
        "measured-parts", "measure body-parts",
        "--motion clips={made}/motion --weights mine={made}/parts --splits train --seeds 1 --max-windows 2 "
        "--device cpu -o {out}",
    ),
    Writing(
        "streamed", "stream",
        "--motion {made}/motion --weights mine={made}/parts --splits train --seeds 1 --max-clips 1 --loss 0.1 "
        "--device cpu -o {out}",
    ),
    Writing("composed.bvh", "body-parts compose", "{made}/body.toml -o {out} --device cpu"),
    Writing("cleaned.bvh", "denoise", f"{CLIPS}/kick.bvh -o {{out}}"),
    *(
        Writing(f"edited-{verb}.bvh", f"edit {verb}", f"{CLIPS}/kick.bvh {words} -o {{out}}")
        for verb, words in (
            ("trim", "--frames 5:25"), ("resample", "--fps 60"), ("mirror", ""), ("smooth", ""),
            ("loop", "--blend 0.1 --weights {made}/run --device cpu"),
            ("join", f"{CLIPS}/kick.bvh --blend 0.1 --weights {{made}}/run --device cpu"),
        )
    ),
    Writing("keypoints.json", "project", f"{CLIPS}/kick.bvh -o {{out}}"),
    Writing("lifted.bvh", "estimate", "{made}/keypoints.json -o {out} --device cpu"),
    Writing("picked", "data pick", "--motion {made}/motion --count 1 -o {out}"),
    *(
        Writing(
            f"filled{suffix}", "infill",
            f"{CLIPS}/kick.bvh --keyframes every:15 --weights {{made}}/run --points 32 --device cpu -o {{out}}",
        )
        for suffix in (".bvh", ".csv")
    ),
    Writing("demonstrated", "demo", "kick --no-open -o {out}"),
    Writing(
        "clouds", "decode",
        f"--latent {{made}}/latent --ae {{made}}/run/train-ae --points 32 --device cpu {_ALL} -o {{out}}",
    ),
    Writing(
        "decoded", "decode",
        "--tpc {made}/tpc --network {made}/rig-network --points 32 --splits test --device cpu -o {out}",
    ),
    Writing(
        "measured", "evaluate",
        "--motion {made}/motion --weights mine={made}/run --tasks transition --transitions 15 "
        "--max-windows 1 --points 32 --device cpu --keep-fills -o {out}",
    ),
    Writing(
        "page.html", "report",
        f"--metrics {{made}}/measured --checkpoints {{made}}/run/train-ae --motions kick/truth={CLIPS}/kick.bvh "
        "--fills {made}/measured --licences CC0 -o {out}",
    ),
    Writing("drawn/page.html", "report", f"--motions kick/truth={CLIPS}/kick.bvh --picture {{out}}.svg -o {{out}}"),
    *(
        Writing(f"moved{suffix}", "retarget", f"{CLIPS}/kick.bvh --to {CLIPS}/punch.bvh --method turns -o {{out}}")
        for suffix in (".bvh", ".npz")
    ),
    Writing("rerigged", "data rerig", f"--motion {{made}}/motion --rigs {{made}}/rigs {_ALL} -o {{out}}"),
    Writing("averaged", "weights average", "{made}/run/train-lms {made}/run/train-lms -o {out}"),
    Writing(
        "measured-ae", "measure ae",
        "--tpc {made}/tpc --weights mine={made}/run/train-ae --splits test --max-windows 1 --window 32 --points 24 "
        "--pictures 1 --device cpu -o {out}",
    ),
    Writing(
        "measured-latents", "measure latents",
        "--motion {made}/motion --weights {made}/run --splits test --max-windows 1 --window 8 --device cpu -o {out}",
    ),
    Writing(
        "measured-pcmrl", "measure pcmrl",
        "--truth {made}/tpc --weights mine={made}/interpolator --intervals 15 --window 46 --splits test --points 32 "
        "--device cpu -o {out}",
    ),
    Writing("measured-table1", "measure table1", "{made}/measured -o {out}"),
    Writing(
        "measured-denoise", "measure denoise",
        f"--tpc {{made}}/tpc --skeleton {CLIPS}/kick.bvh --splits train --max-windows 1 --window 32 "
        "--device cpu -o {out}",
    ),
    Writing(
        "measured-constraints", "measure constraints",
        "--motion {made}/motion --weights {made}/run --splits test --max-windows 1 --window 46 --constraints arms "
        "--device cpu -o {out}",
    ),
    Writing(
        "measured-estimate", "measure estimate",
        "--tpc {made}/tpc --weights mine={made}/lifter --splits train --max-windows 1 --window 32 "
        "--device cpu -o {out}",
    ),
    Writing(
        "measured-task", "measure task",
        "--tpc {made}/tpc --weights mine={made}/lifter --splits train --max-windows 1 --window 32 "
        "--device cpu -o {out}",
    ),
    Writing(
        "measured-motions", "measure motions",
        "--truth {made}/motion --made same={made}/motion --splits test --window 46 -o {out}",
    ),
    Writing(
        "solved/metrics", "measure solve",
        "--motion {made}/motion --intervals 15 --conditions true --points 32 --made {out}-kept --device cpu -o {out}",
    ),
    Writing("concepts", "segment", "{made}/motion -o {out}"),
    Writing(
        "grouped", "segment",
        "{made}/acting --fps 20 --actions (walk|run).bvh --cluster kmeans --clusters 2 -o {out}",
    ),
    Writing(
        "learned", "train concepts",
        "--concepts {made}/grouped --steps 2 --batch 2 --window 16 --width 8 --latent 2 --warmup 1 "
        "--validate-every 2 --checkpoint-every 1 --device cpu -o {out}",
    ),
    Writing(
        "refined.bvh", "refine",
        f"{CLIPS}/kick.bvh --action walk --weights {{made}}/learned --device cpu -o {{out}}",
    ),
    Writing(
        "recogniser", "train recogniser",
        "--concepts {made}/grouped --steps 2 --batch 2 --window 16 --width 8 --warmup 1 --validate-every 2 "
        "--checkpoint-every 1 --device cpu -o {out}",
    ),
    Writing(
        "generator", "train generator",
        "--concepts {made}/grouped --steps 2 --batch 2 --window 16 --width 8 --blocks 1 --latent 2 --warmup 1 "
        "--validate-every 2 --checkpoint-every 1 --device cpu -o {out}",
    ),
    Writing("generated", "generate", "--weights {made}/generator --count 2 --frames 12 --device cpu -o {out}"),
    Writing("refined", "refine", "{made}/generated --weights {made}/learned --device cpu -o {out}"),
    Writing(
        "measured-concepts", "measure concepts",
        "--concepts {made}/grouped --recogniser {made}/recogniser --made made={made}/generated --repetitions 2 "
        "--splits train --device cpu -o {out}",
    ),
    Writing("measured-anchors", "measure anchors", "--motion {made}/motion --splits train --lambdas 200 -o {out}"),
    Writing("packed", "weights pack", "{made}/run -o {out}"),
    Writing(
        "calibrated", "weights calibrate",
        "{out} --motion {made}/motion --splits train --splits val --max-windows 1 --intervals 15 --transitions 15 "
        "--predictions 15 --window 46 --points 32 --device cpu",
        adds_to="packed",
    ),
    Writing(
        "varied", "weights vary",
        "{out} --motion {made}/motion --splits train --splits val --max-windows 1 --intervals 15 --transitions 15 "
        "--predictions 15 --window 46 --points 32 --device cpu",
        adds_to="packed",
    ),
    Writing(
        "adapted", "weights adapt",
        f"{CLIPS}/dance_a.bvh {CLIPS}/dance_b.bvh {CLIPS}/run.bvh --weights {{made}}/packed --steps 1 --batch 2 "
        "--validate-every 1 --max-windows 2 --device cpu -o {out}",
    ),
    Writing("described.json", "inspect", f"{CLIPS}/kick.bvh -o {{out}}"),
    *(
        Writing(f"one{suffix}", "export", f"{CLIPS}/kick.bvh -o {{out}}")
        for suffix in (".glb", ".npz", ".csv", ".parquet")
    ),
    *(
        Writing(f"all-{form}", "export", f"{{made}}/motion --format {form} -o {{out}}")
        for form in ("bvh", "glb", "amass", "csv", "parquet")
    ),
    Writing(
        "fetched", "data fetch",
        "walks --catalogue {made}/catalogue.toml --acceptances {made}/accepted.json --accept-licence -o {out}",
        replaces=False,
    ),
    Writing(
        "fetched-weights", "weights fetch",
        "walks --registry {made}/weights.toml --acceptances {made}/accepted.json --accept-licence -o {out}",
        replaces=False,
    ),
    Writing(
        "cloth", "simulate-cloth",
        "--count 3 --seconds 0.2 --rows 5 --size-m 0.3 --steps-per-second 200 -o {out}",
    ),
    Writing(
        "predictor", "train spectral",
        f"--mesh {{made}}/cloth --eigenvectors 8 --known 3 {_SPECTRAL} -o {{out}}",
    ),
    Writing(
        "completer", "train spectral",
        f"--task complete --mesh {{made}}/cloth --eigenvectors 8 --known 2 {_SPECTRAL} -o {{out}}",
    ),
    Writing(
        "predicted", "predict-mesh",
        "--mesh {made}/cloth --weights {made}/predictor --frames 3 --device cpu -o {out}",
    ),
    Writing(
        "completed", "complete-mesh", "--mesh {made}/cloth --weights {made}/completer --device cpu -o {out}"
    ),
    Writing(
        "measured-meshes", "measure spectral",
        "--mesh {made}/cloth --weights mine={made}/predictor --known 3 --ahead 2 --splits test --device cpu -o {out}",
    ),
    Writing("cloth.html", "export-mesh", "{made}/cloth -o {out}"),
    Writing("skinned", "skin", f"{CLIPS}/kick.bvh --bodies {{made}}/boxes -o {{out}}"),
    Writing("merged", "artefact merge", "{made}/part-1 {made}/part-2 -o {out}"),
    Writing("written", "config write", "--run {out} --preset tiny --source {made}/motion", asks=False),
    Writing("planned", "run", "--run {out} --preset tiny --source {made}/motion --dry-run", asks=False),
    Writing("page.md", "formats", "--page {out}", asks=False),
)  # fmt: skip
FIRST_FORMS = tuple({writing.command: writing for writing in reversed(WRITINGS)}.values())
# What some of these read besides.
PREPARED = (
    Writing("rigs", "ingest bvh", "{made}/rig.bvh --workers 1 -o {out}"),
    Writing(
        "acting",
        "ingest bvh",
        f"{CLIPS}/walk.bvh {CLIPS}/run.bvh --splits {CLIPS}/splits.json --licence CC0 --workers 1 -o {{out}}",
    ),
    *(
        Writing(f"part-{part}", "sample-tpc", f"--motion {{made}}/motion --points 64 --shard {part}/2 -o {{out}}")
        for part in (1, 2)
    ),
)

# Commands beside the stages that only print.
PRINTING = frozenset(
    {
        "artefact show", "artefact verify", "artefact lineage", "config list", "config show", "config recipes",
        "results", "stages",
    }
)  # fmt: skip
