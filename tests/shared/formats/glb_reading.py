"""A GLB read with nothing but struct, json, NumPy and SciPy, checked against the format's own rules on the way."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

_TYPES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_COMPONENTS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


@dataclass
class Glb:
    """The document and its buffer."""

    document: dict[str, Any]
    buffer: bytes

    def accessor(self, index: int) -> np.ndarray:
        """(N, width) or (N,) values of an accessor."""
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width, kind = _TYPES[accessor["type"]], np.dtype(_COMPONENTS[accessor["componentType"]])
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        assert start % kind.itemsize == 0 and "byteStride" not in view
        size = accessor["count"] * width * kind.itemsize
        assert size <= view["byteLength"] and start + size <= len(self.buffer)
        values = np.frombuffer(self.buffer, kind, accessor["count"] * width, start).reshape(-1, width)
        for bound, found in (("min", values.min(axis=0)), ("max", values.max(axis=0))):
            assert bound not in accessor or np.allclose(accessor[bound], found, rtol=1e-6)
        return values[:, 0] if width == 1 else values

    def world(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (T,), and places (T, N, 3) and rotation matrices (T, N, 3, 3) of all nodes while the clip plays."""
        nodes = self.document["nodes"]
        (animation,) = self.document["animations"]
        times = self.accessor(animation["samplers"][0]["input"])
        moves: dict[tuple[int, str], np.ndarray] = {}
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            assert sampler["interpolation"] == "LINEAR" and sampler["input"] == animation["samplers"][0]["input"]
            values = self.accessor(sampler["output"])
            assert len(values) == len(times)
            moves[channel["target"]["node"], channel["target"]["path"]] = values.astype(float)
        parents = {child: node for node, each in enumerate(nodes) for child in each.get("children", [])}
        places, turns = np.zeros((len(times), len(nodes), 3)), np.zeros((len(times), len(nodes), 3, 3))
        for node in self._order(parents):
            still = np.array(nodes[node].get("translation", (0, 0, 0)), float)
            turn = np.array(nodes[node].get("rotation", (0, 0, 0, 1)), float)
            local = moves.get((node, "translation"), np.tile(still, (len(times), 1)))
            quaternions = moves.get((node, "rotation"), np.tile(turn, (len(times), 1)))
            assert np.allclose(np.linalg.norm(quaternions, axis=1), 1, atol=1e-5)
            own = Rotation.from_quat(quaternions).as_matrix()
            if node in parents:
                above = parents[node]
                places[:, node] = places[:, above] + np.einsum("tij,tj->ti", turns[:, above], local)
                turns[:, node] = turns[:, above] @ own
            else:
                places[:, node], turns[:, node] = local, own
        return times, places, turns

    def _order(self, parents: dict[int, int]) -> list[int]:
        def depth(node: int) -> int:
            return 1 + depth(parents[node]) if node in parents else 0

        return sorted(range(len(self.document["nodes"])), key=depth)


def read_glb(data: bytes) -> Glb:
    """Take a GLB apart: one JSON and one binary chunk, padded as the format asks."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data)) and length % 4 == 0
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and size % 4 == 0
    document = json.loads(data[20 : 20 + size])
    binary, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0" and 28 + size + binary == length
    (buffer,) = document["buffers"]
    assert "uri" not in buffer and binary - 3 <= buffer["byteLength"] <= binary
    for view in document["bufferViews"]:
        assert view["byteOffset"] + view["byteLength"] <= buffer["byteLength"] and view["byteOffset"] % 4 == 0
    return Glb(document, data[28 + size :])
