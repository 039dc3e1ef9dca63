"""Files through the real commands: outputs that exist, suffixes, formats, members of archives."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from stages.shared.formats.readers import recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import source_named
from tests.shared.inference.examples import write_random_weights

CLIPS = Path(__file__).resolve().parents[2] / "stages" / "shared" / "clips"
WRITTEN = (".glb", ".npz", ".csv", ".parquet")


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_random_weights(tmp_path_factory.mktemp("weights") / "mine")


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A short recording, by itself and in an archive whose folder a glob would not match."""
    path = tmp_path / "walk.bvh"
    path.write_bytes((CLIPS / "walk.bvh").read_bytes())
    with zipfile.ZipFile(tmp_path / "more.zip", "w") as archive:
        archive.write(path, "takes [1]/walk.bvh")
        archive.write(CLIPS / "kick.bvh", "takes [1]/kick.bvh")
    return path


def commands(walk: Path, weights: Path) -> dict[str, list[str]]:
    """Commands that write a file, without their -o."""
    return {
        "infill": ["infill", str(walk), "--keyframes", "every:10", "--weights", str(weights), "--points", "48"],
        "retarget": ["retarget", str(walk), "--to", str(CLIPS / "kick.bvh"), "--method", "turns"],
        "export": ["export", str(walk)],
        "report": ["report", "--motions", f"truth={walk}"],
    }


@pytest.mark.parametrize("name", ["infill", "retarget", "export", "report"])
def test_an_output_that_exists_is_refused_and_an_input_is_never_replaced(pumps, walk, weights, name: str):
    words = commands(walk, weights)[name]
    output = walk.with_name("out.html" if name == "report" else "out.bvh")
    assert pumps(*words, "-o", output).code == 0
    before = output.stat().st_mtime_ns
    refused = pumps(*words, "-o", output)
    assert refused.code == 2 and f"{output} exists. Give --overwrite" in refused.err
    assert output.stat().st_mtime_ns == before
    assert pumps(*words, "-o", output, "--overwrite").code == 0
    digest = hashlib.sha256(walk.read_bytes()).hexdigest()
    onto_itself = pumps(*words, "-o", walk, "--overwrite")
    assert onto_itself.code == 2 and hashlib.sha256(walk.read_bytes()).hexdigest() == digest
    if name != "report":  # whose output is not a BVH at all
        assert "must not be replaced" in onto_itself.err


@pytest.mark.parametrize("name", ["infill", "retarget", "export"])
def test_a_suffix_that_is_not_written_names_those_that_are(pumps, walk, weights, name: str):
    ran = pumps(*commands(walk, weights)[name], "-o", walk.with_name("out.fbx"))
    assert ran.code == 2 and not walk.with_name("out.fbx").exists()
    for suffix in (".bvh", *WRITTEN):
        assert suffix in ran.err


def test_a_report_is_an_html_page_with_an_svg_picture(pumps, walk, weights):
    words = commands(walk, weights)["report"]
    assert "Name a file of .html, .htm." in pumps(*words, "-o", walk.with_name("page.pdf")).err
    picture = ("--picture", walk.with_name("picture.png"))
    assert "Name a file of .svg." in pumps(*words, "-o", walk.with_name("page.html"), *picture).err


@pytest.mark.parametrize("name", ["infill", "retarget"])
def test_other_formats_are_what_export_makes_of_the_bvh(pumps, walk, weights, name: str):
    """The same code writes them: the same bytes, except for the decimals that the BVH keeps."""
    words = commands(walk, weights)[name]
    folder = walk.parent / "made"
    assert pumps(*words, "-o", folder / "clip.bvh").code == 0
    for suffix in WRITTEN:
        assert pumps(*words, "-o", folder / f"clip{suffix}").code == 0
        exported = walk.parent / "exported" / f"clip{suffix}"
        assert pumps("export", folder / "clip.bvh", "-o", exported).code == 0
        ours, theirs = folder / f"clip{suffix}", exported
        if name == "infill":
            assert ours.read_bytes() == theirs.read_bytes(), suffix
        if suffix == ".glb":
            (mine,), (other,) = (recordings_in(source_named(str(path)), Asked()) for path in (ours, theirs))
            assert mine.skeleton.names == other.skeleton.names
            assert np.abs(mine.motion.rotations - other.motion.rotations).max() < 1e-4


def test_a_member_of_an_archive_works_wherever_a_file_does(pumps, walk, weights):
    folder = walk.parent
    member, rig = f"{folder}/more.zip!takes [1]/walk.bvh", f"{folder}/more.zip!takes [1]/kick.bvh"
    fill = ["--keyframes", "every:10", "--weights", weights, "--points", "48"]
    pairs = {
        "infill.bvh": (["infill", walk, *fill], ["infill", member, *fill]),
        "retarget.bvh": (
            ["retarget", walk, "--to", CLIPS / "kick.bvh", "--method", "turns"],
            ["retarget", member, "--to", rig, "--method", "turns"],
        ),
        "export.glb": (["export", walk], ["export", member]),
        "rig.bvh": (["export", walk, "--rig", walk], ["export", member, "--rig", member]),
    }
    for name, (plain, of_archive) in pairs.items():
        for where, words in (("plain", plain), ("archive", of_archive)):
            ran = pumps(*words, "-o", folder / where / name)
            assert ran.code == 0, ran.err
        assert (folder / "plain" / name).read_bytes() == (folder / "archive" / name).read_bytes(), name
    shown = [pumps("inspect", path).out for path in (walk, member)]
    assert shown[0].splitlines()[1:] == shown[1].splitlines()[1:]
    assert pumps("ingest", "bvh", member, "-o", folder / "motion").code == 0
    assert pumps("report", "--motions", f"truth={member}", "-o", folder / "page.html").code == 0
    places = folder / "places.npy"
    (recording,) = recordings_in(source_named(str(walk)), Asked())
    np.save(places, np.zeros((4, len(recording.skeleton.names), 3)) + np.arange(3))
    told = pumps("inspect", places, "--skeleton", member)
    assert "no member" not in told.err and "does not exist" not in told.err, told.err
    assert "no member 'other.bvh'" in pumps("inspect", places, "--skeleton", f"{folder}/more.zip!other.bvh").err
