"""Every real rig at hand, its joints renamed to j0, j1, ... and changed in all ways that leave it the same body."""

from __future__ import annotations

import zipfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from stages.formats.bvh import read_bvh
from stages.formats.bvh_motion import rig_and_poses
from stages.formats.figure import Poses, Rig, body_of, motion_of_poses
from stages.formats.sources import find_sources
from tests.kinematics.rig_changes import changed, renamed

ROOT = Path(__file__).parents[2]
DATA = ROOT / ".." / "shared" / "data"
ARCHIVES = ("bandai-namco-1.zip", "bandai-namco-2.zip", "cmu-dance.zip", "lafan1-g1.zip")
CLIPS_OF_EACH = 4
pytestmark = [pytest.mark.real, pytest.mark.skipif(not DATA.is_dir(), reason="no recordings at hand")]


@lru_cache
def _clips(archive: str) -> list[tuple[str, Rig, Poses]]:
    found = find_sources([str(DATA / archive)])
    out = []
    for at in np.linspace(0, len(found) - 1, CLIPS_OF_EACH).astype(int):
        bvh = read_bvh(found[at].read(), found[at].member)
        bvh = bvh.select(np.arange(1, min(bvh.frames, 1500)))
        out.append((found[at].member, *rig_and_poses(bvh)))
    return out


@pytest.mark.parametrize("archive", ARCHIVES)
def test_groups_of_real_rigs_need_no_names(archive: str) -> None:
    for seed, (member, rig, poses) in enumerate(_clips(archive)):
        named = motion_of_poses(body_of(rig), poses)[0]
        rng = np.random.default_rng(seed)
        bare, same = renamed(rig, poses)
        other, moved, order = changed(rig, poses, "all", rng)
        for case, places in (((bare, same), np.arange(named.joints)), ((other, moved), order)):
            found = motion_of_poses(body_of(case[0]), case[1])[0]
            assert found.groups.tolist() == named.groups[places].tolist(), member
            assert places[found.root] == named.root, member


def test_groups_of_native_cmu_skeletons_need_no_names() -> None:
    """The two subjects' ASF, bones for joints, at rest."""
    with zipfile.ZipFile(DATA / "cmu-asfamc.zip") as archive:
        texts = [archive.read(name).decode() for name in archive.namelist() if name.endswith(".asf")]
    assert len(texts) == 2
    for seed, text in enumerate(texts):
        rig, poses = _asf_rig(text)
        named = motion_of_poses(body_of(rig), poses)[0]
        groups = dict(zip(named.names, named.groups.tolist(), strict=True))
        assert [groups[n] for n in ("head", "lthumb", "rhand", "lhipjoint", "rtoes")] == [0, 1, 2, 3, 4]
        rng = np.random.default_rng(seed)
        bare, same = renamed(rig, poses)
        assert motion_of_poses(body_of(bare), same)[0].groups.tolist() == named.groups.tolist()
        other, moved, order = changed(rig, poses, "all", rng)
        assert motion_of_poses(body_of(other), moved)[0].groups.tolist() == named.groups[order].tolist()


def _asf_rig(text: str) -> tuple[Rig, Poses]:
    """Joints at the beginnings of an ASF's bones, in its own unit, standing as it was built; read apart from the
    project's reader."""
    bones: dict[str, np.ndarray] = {"root": np.zeros(3)}
    name = ""
    direction = np.zeros(3)
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["name"]:
            name = words[1]
        elif words[:1] == ["direction"]:
            direction = np.array(words[1:4], float)
        elif words[:1] == ["length"] and name:
            bones[name] = direction * float(words[1])
    names, parents = ["root"], [-1]
    for line in text.partition(":hierarchy")[2].splitlines():
        words = line.split()
        if len(words) > 1:
            names += words[1:]
            parents += [names.index(words[0])] * (len(words) - 1)
    offsets = [(0.0, 0.0, 0.0), *[tuple(bones[names[p]].tolist()) for p in parents[1:]]]
    ends = [tuple((bones[n] if j not in parents else np.zeros(3)).tolist()) for j, n in enumerate(names)]
    rig = Rig(tuple(names), tuple(parents), tuple(offsets), tuple(ends), tuple(n == "root" for n in names))  # type: ignore[arg-type]
    return rig, Poses(np.tile((0.0, 0.0, 0.0, 1.0), (1, len(names), 1)), np.zeros((1, 3)), 120.0)
