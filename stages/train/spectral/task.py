"""What is trained: SpecTrHuMS on coefficients, or siMLPe on joints."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from data_schemas.errors import InputError
from stages.shared.meshes.graph import edges_of
from stages.shared.meshes.measures import melv_mm, mpjpe_mm
from stages.shared.meshes.spectral_basis import SpectralBasis
from stages.shared.networks.layers.device import precision
from stages.shared.networks.spectral.joint_mlp import JointMlp
from stages.shared.networks.spectral.spectral_model import SpectralModel
from stages.shared.training.task import TrainingTask
from stages.train.spectral.config import Config
from stages.train.spectral.windows import MeshWindows, WindowDrawer, stacked

_ROWS = 8
_MELV_WINDOWS = 8
_MELV_FRAMES = 4


class SpectralTask(TrainingTask[SpectralModel]):
    """Training the autoencoder and the transformer at once."""

    def __init__(
        self, config: Config, windows: MeshWindows, basis: SpectralBasis, faces: np.ndarray, device: torch.device
    ):
        assert windows.coefficients is not None
        self.config, self.basis, self.device = config, basis, device
        torch.manual_seed(config.seed)
        networks = SpectralModel(basis.size, config.window, config.known, config.task == "complete", config.network)
        networks.autoencoder.set_statistics(*windows.statistics(config.seed))
        self.networks = networks.to(device)
        self._drawer = WindowDrawer(windows.coefficients, windows.training)
        held = windows.validation()
        self.held_back = stacked(windows.coefficients, held)
        self.true_joints = stacked(windows.joints, held).numpy() if windows.joints is not None else None
        # Joints are a linear map of vertices, and vertices of coefficients.
        self.joints_of = (
            torch.from_numpy(windows.joints.mapping @ basis.vectors) if windows.joints is not None else None
        )
        self.edges, _ = edges_of(faces)

    def drawer(self, *, elsewhere: bool = False) -> WindowDrawer:
        return self._drawer

    def loss(self, batch: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """The static loss and the transformer's, summed; no gradient is in both."""
        with precision(self.device, self.config.mixed_precision):
            static, dynamic = self.networks.losses(batch.to(self.device), self.config.static_steps)
        return static + dynamic, {"static": static.detach(), "dynamic": dynamic.detach()}

    def validate(self) -> dict[str, float]:
        """Errors over the unknown frames, millimetres: of joints if there are some, else of vertices; MELV; and the
        autoencoder's own error.

        The first figure selects the weights to keep.
        """
        known, last = self.config.known, self.config.task == "complete"
        stop = self.config.window - 1 if last else self.config.window
        made = torch.cat([self.networks(rows.to(self.device)).cpu() for rows in self.held_back.split(_ROWS)])
        true, made = self.held_back[:, known:stop], made[:, known:stop]
        count = len(self.basis.vectors)
        figures = {"rmse_mm": 1e3 * float(((made - true) ** 2).sum((-2, -1)).mean().sqrt()) / count**0.5}
        if self.joints_of is not None and self.true_joints is not None:
            joints = torch.einsum("jk,btkd->btjd", self.joints_of, made).numpy()
            figures = {"mpjpe_mm": float(mpjpe_mm(joints, self.true_joints[:, known:stop]).mean()), **figures}
        figures["melv_mm"] = self._melv(made, known)
        latents = self.networks.autoencoder.encode(self.held_back[:, :1].to(self.device))
        again = self.networks.autoencoder.decode(latents).cpu() - self.held_back[:, :1]
        figures["static_rmse_mm"] = 1e3 * float((again**2).sum((-2, -1)).mean().sqrt()) / count**0.5
        return figures

    @property
    def keeps_last(self) -> bool:
        return self.config.keep == "last"

    @property
    def keeps_both(self) -> bool:
        return self.config.keep == "both"

    def _melv(self, made: Tensor, known: int) -> float:
        """Mean edge length variation of some windows in some predicted frames, the last one among them."""
        frames = np.unique(np.linspace(0, made.shape[1] - 1, _MELV_FRAMES).round().astype(int))
        chosen = np.unique(np.linspace(0, len(made) - 1, min(_MELV_WINDOWS, len(made))).round().astype(int))
        found = []
        for row in chosen:
            still = self.basis.vertices(self.held_back[row, known - 1].numpy())
            found.append(melv_mm(self.basis.vertices(made[row, frames].numpy()), still, self.edges))
        return float(np.mean(found))


class JointTask(TrainingTask[JointMlp]):
    """Training siMLPe on the joints of the meshes."""

    def __init__(self, config: Config, windows: MeshWindows, device: torch.device):
        if windows.joints is None:
            raise InputError("These meshes have no joints, which siMLPe is trained on.", "Use --method spectral.")
        self.config, self.device = config, device
        torch.manual_seed(config.seed)
        count = len(windows.joints.mapping)
        self.networks = JointMlp(count, config.known, config.window - config.known, config.joint_network).to(device)
        self._drawer = WindowDrawer(windows.joints, windows.training)
        self.held_back = stacked(windows.joints, windows.validation())

    def drawer(self, *, elsewhere: bool = False) -> WindowDrawer:
        return self._drawer

    def loss(self, batch: Tensor, generator: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
        """Errors of positions and velocities, metres."""
        batch, known = batch.to(self.device), self.config.known
        return self.networks.loss(self.networks(batch[:, :known]), batch[:, known:]), {}

    def validate(self) -> dict[str, float]:
        """Mean error of the joints over the predicted frames, millimetres."""
        known = self.config.known
        made = self.networks(self.held_back[:, :known].to(self.device)).cpu().numpy()
        return {"mpjpe_mm": float(mpjpe_mm(made, self.held_back[:, known:].numpy()).mean())}

    @property
    def keeps_last(self) -> bool:
        return self.config.keep == "last"

    @property
    def keeps_both(self) -> bool:
        return self.config.keep == "both"
