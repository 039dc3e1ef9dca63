"""Linear maps of mesh sequences (spectral coefficients, joints), without the vertices where a clip has bones.

Linear blend skinning is linear in the bones' transforms, so M V(t) for a map M of vertices needs J small matrices and
not the N vertices: 0.6 MFLOP a frame instead of 42 for 512 coefficients of 13,700 vertices on 50 bones.
"""

from __future__ import annotations

import numpy as np

from data_schemas.mesh import MeshReader
from data_schemas.skinned_body import bone_matrices, mapped_skin

_FRAMES_AT_ONCE = 64


class LinearView:
    """Values M V (T, M, 3) of windows of an artefact's clips, read from the disk window by window.

    Args:
        reader: of the meshes; it must stay open.
        mapping: (M, N) float32, such as a basis' transposed vectors or a joint regressor.
    """

    def __init__(self, reader: MeshReader, mapping: np.ndarray):
        self.reader, self.mapping = reader, np.asarray(mapping, np.float32)
        self._mapped: dict[str, np.ndarray] = {}

    def window(self, clip: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """(T, M, 3) float32 of frames `start` to `stop` of a clip. Raises InputError as the reader does."""
        reader = self.reader
        if reader.is_skinned(clip):
            return self.of_bones(reader.row(clip).skeleton, *reader.bones(clip, start, stop))
        end = reader.row(clip).frames if stop is None else stop
        parts = [
            self.of_vertices(reader.vertices(clip, at, min(at + _FRAMES_AT_ONCE, end)))
            for at in range(start, end, _FRAMES_AT_ONCE)
        ]
        return np.concatenate(parts) if parts else np.zeros((0, len(self.mapping), 3), np.float32)

    def of_bones(self, body: str, rotations: np.ndarray, heads: np.ndarray) -> np.ndarray:
        """(T, M, 3) of a body's bones: rotations (T, J, 4) global xyzw, heads (T, J, 3) metres."""
        skin = self.reader.topology.skin
        assert skin is not None
        if body not in self._mapped:
            mapped = mapped_skin(skin, self.reader.body(body), self.mapping)  # (J, M, 4)
            self._mapped[body] = mapped.transpose(0, 2, 1).reshape(-1, len(self.mapping))
        matrices = bone_matrices(self.reader.body(body), rotations, heads)  # (T, J, 3, 4)
        flat = matrices.transpose(0, 2, 1, 3).reshape(len(matrices) * 3, -1)
        made = flat @ self._mapped[body]
        return made.reshape(len(matrices), 3, -1).transpose(0, 2, 1)

    def of_vertices(self, vertices: np.ndarray) -> np.ndarray:
        """(T, M, 3) of vertices (T, N, 3)."""
        return np.einsum("mn,tnd->tmd", self.mapping, vertices, optimize=True).astype(np.float32, copy=False)
