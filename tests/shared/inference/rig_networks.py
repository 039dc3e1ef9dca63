"""A network of a rig that was never trained."""

from __future__ import annotations

from pathlib import Path

import torch

from data_schemas.artefact import write_artefact
from data_schemas.checkpoint import write_checkpoint
from stages.shared.networks.layers.sizes import EncoderSizes, SkeletonSizes
from stages.shared.networks.pcmrl.skeleton_network import SkeletonNetwork
from stages.shared.pointcloud.rig import rig_of_motion
from tests.shared.inference.examples import humanoid, swinging

ENCODER, SIZES = EncoderSizes(width=8, blocks=2, neighbours=4, heads=2), SkeletonSizes(width=16, layers=1, heads=2)


def write_random_rig_network(path: Path, *, above: bool = False, window: int = 16) -> Path:
    """A checkpoint as `pumps train skeleton` writes it, its network random."""
    skeleton = humanoid(above=above)
    rig = rig_of_motion(skeleton, swinging(skeleton, 9))
    torch.manual_seed(0)
    network = SkeletonNetwork(rig.body, ENCODER, SIZES)
    with torch.no_grad():
        network.out.weight.mul_(3)
    weights = {name: value.numpy() for name, value in network.state_dict().items()}
    config = {"network": "skeleton", "encoder": ENCODER.model_dump(), "skeleton": SIZES.model_dump()}
    config |= {"rig": rig.plain(), "window": window, "points": 40}
    with write_artefact(path, "checkpoint", stage="test", config={}, licences=["test only"]) as draft:
        write_checkpoint(draft.folder, weights=weights, config=config, optimiser=None, log=[], card="random")
    return path
