"""Film strips: pixels against slow rendering by rays, a PNG that other programs read, rows and columns of a strip."""

from __future__ import annotations

import base64
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_schemas.errors import InputError
from stages.export_mesh.config import Config
from stages.export_mesh.page import Played
from stages.export_mesh.raster import drawn, png_of, view_of
from stages.export_mesh.run import run
from stages.export_mesh.strip import strip_of
from tests.shared.meshes.figures import write_arms
from tests.shared.meshes.shapes import ball


def _read_png(data: bytes) -> np.ndarray:
    """(height, width, 3) of an unfiltered PNG, chunk by chunk, with the checks of a reader."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, found = 8, {}
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        name, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        assert struct.unpack(">I", data[at + 8 + length : at + 12 + length])[0] == zlib.crc32(name + body)
        found[name], at = body, at + 12 + length
    width, height, depth, kind = struct.unpack(">IIBB", found[b"IHDR"][:10])
    assert (depth, kind) == (8, 2)
    rows = np.frombuffer(zlib.decompress(found[b"IDAT"]), np.uint8).reshape(height, 1 + 3 * width)
    assert (rows[:, 0] == 0).all()
    return rows[:, 1:].reshape(height, width, 3)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_a_png_holds_its_pixels(width: int, height: int, seed: int):
    pixels = np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)
    assert np.array_equal(_read_png(png_of(pixels)), pixels)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_pixels_are_covered_where_rays_hit_the_mesh_and_show_its_nearest_triangle(seed: int):
    """A ray through each of the four points of a pixel, intersected with every triangle."""
    vertices, faces = ball(12, seed)
    low, scale, size = np.array([-1.1, -1.1]), 6.0, 13
    made = drawn(vertices.astype(np.float64), faces, (1.0, 1.0, 1.0), (size, size), low, scale)
    corners = vertices.astype(np.float64)[faces]
    inverses = np.linalg.inv(
        np.concatenate([corners[..., :2], np.ones((len(faces), 3, 1))], axis=2).transpose(0, 2, 1)
    )
    shares = np.ones((size, size, 4))
    for row, column, part in np.ndindex(shares.shape):
        x, y = low + np.array([column + 0.25 + 0.5 * (part % 2), row + 0.25 + 0.5 * (part // 2)]) / scale
        hit = inverses @ [x, y, 1]
        depths = np.where((hit >= 0).all(1), (hit * corners[..., 2]).sum(1), -np.inf)
        if np.isfinite(depths).any():
            shares[row, column, part] = _light_of(*corners[int(depths.argmax())])
    expected = np.round(255 * shares.mean(-1)).astype(int)[::-1]
    assert np.abs(made[..., 0].astype(int) - expected).max() <= 1
    assert (expected < 255).sum() > 50 and (expected == 255).any()


def _light_of(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    toward = np.array([0.4, 0.8, 0.5]) / np.linalg.norm([0.4, 0.8, 0.5])
    return round(48 * (0.35 + 0.5 * abs(normal @ toward) + 0.15 * abs(normal[2]))) / 48


def test_a_view_turns_and_keeps_lengths():
    view = view_of(0.6, 0.15)
    assert np.allclose(view @ view.T, np.eye(3)) and np.linalg.det(view) == pytest.approx(1)
    assert np.allclose(view_of(0, 0), np.eye(3)) and view_of(0.6, 0)[1].tolist() == [0, 1, 0]


def test_a_strip_has_a_row_for_each_artefact_and_a_column_for_each_pose(tmp_path: Path):
    write_arms(tmp_path / "arms", clips=2, frames=30)
    beside = (f"again={tmp_path / 'arms'}",)
    given = {"input": tmp_path / "arms", "name": "truth", "poses": 4, "overwrite": True}
    run(Config(**given, output=tmp_path / "a.svg", beside=beside, start=5, frames=16))
    text = (tmp_path / "a.svg").read_text()
    one, other = [_read_png(base64.b64decode(data)) for data in re.findall('base64,([^"]+)', text)]
    assert ">truth (arm-0)<" in text and ">again (arm-0)<" in text
    assert re.findall(r">([\d.]+) s<", text) == ["0.20", "0.40", "0.60", "0.80"]
    covered = [(each != 255).any(2) for each in (one, other)]
    assert np.array_equal(*covered) and not np.array_equal(one, other)  # another colour of the same frames
    poses = np.split(covered[0], 4, axis=1)
    assert all(0.05 < pose.mean() < 0.9 for pose in poses) and not np.array_equal(poses[0], poses[-1])


def test_clips_of_several_rates_are_refused():
    vertices, faces = ball(6, 0)
    clips = [Played("a", name, vertices[None], fps) for name, fps in (("one", 25.0), ("other", 30.0))]
    with pytest.raises(InputError, match=r"several rates \(25, 30 frames a second\)"):
        strip_of(clips, {"one": faces, "other": faces}, np.array([0]), 0)
    assert "0.04 s" in strip_of(clips[:1], {"one": faces}, np.array([0]), 1)


def test_clips_that_only_one_artefact_holds_are_refused(tmp_path: Path):
    write_arms(tmp_path / "arms", clips=2, frames=30)
    write_arms(tmp_path / "one", clips=1, frames=30)
    given = {"input": tmp_path / "arms", "beside": (f"one={tmp_path / 'one'}",)}
    run(Config(**given, output=tmp_path / "a.html"))
    text = (tmp_path / "a.html").read_text()
    assert '"arm-0"' in text and '"arm-1"' not in text
    with pytest.raises(InputError, match="arm-1"):
        run(Config(**given, output=tmp_path / "b.svg", clip=("arm-1",)))
