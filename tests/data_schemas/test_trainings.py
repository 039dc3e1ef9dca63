"""What a checkpoint says of its trainings: fields made of the clips' rows, also of checkpoints of version 1."""

import hashlib
import json
from pathlib import Path

import pytest

from data_schemas.artefact import open_artefact, verify, write_artefact
from data_schemas.checkpoint import read_checkpoint, write_checkpoint
from data_schemas.clips import ClipRow
from data_schemas.errors import InputError
from data_schemas.kinds import KINDS
from data_schemas.trainings import Training, training_data

ROOT = Path(__file__).parents[2]
FROZEN = Path(__file__).parent / "frozen" / "checkpoint_version_1"
SHIPPED = ROOT / "stages" / "shared" / "weights"


def row(source, sha256="0" * 64, licence="CC0", skeleton="s", seconds=10.0):
    frames = round(30 * seconds)
    return ClipRow(source, source, sha256, skeleton, frames, 30.0, seconds, "train", licence)


def test_the_facts_are_those_of_the_rows():
    data = training_data(
        [
            row("data/walks, slow.zip!b.bvh", "b" * 64, "CC BY"),
            row("C:\\mocap\\walks, slow.zip!a.bvh", "a" * 64, skeleton="t"),
            row("clips/run.bvh", "", seconds=5.0),
        ]
    )
    assert (data.clips, data.seconds, data.skeletons) == (3, 25.0, 2)
    folder, archive = data.archives
    assert (folder.name, folder.loose, folder.clips, folder.sha256) == ("clips", True, 1, "")
    assert (archive.name, archive.loose, archive.clips, archive.seconds) == ("walks, slow.zip", False, 2, 20.0)
    assert archive.sha256 == hashlib.sha256(f"{'a' * 64}\n{'b' * 64}".encode()).hexdigest()
    assert archive.licences == ["CC BY", "CC0"]
    assert data.sentence == "3 clips, 0.01 hours, 2 skeletons, from loose files, walks, slow.zip"


def test_a_clip_is_seen_where_its_archive_is_named_as_a_whole():
    data = training_data([row("data/walks, slow.zip!b.bvh")])
    assert data.has_seen(row("elsewhere\\walks, slow.zip!other.bvh"))
    for source in ("slow.zip!b.bvh", "walks!b.bvh", "walks, slow.zip/b.bvh", "b.bvh"):
        assert not data.has_seen(row(source)), source
    assert training_data([row("a/b.bvh")]).has_seen(row("c/d.bvh"))  # folders are renamed


def test_trainings_come_back_as_they_were_written(tmp_path):
    trainings = (
        Training(steps=5, minutes=1.5, data=training_data([row("data/walks, slow.zip!b.bvh")])),
        Training(steps=7, minutes=2.0),
    )
    with write_artefact(tmp_path / "c", "checkpoint", stage="train-ae", config={}) as draft:
        write_checkpoint(
            draft.folder, weights={}, config={"width": 3}, optimiser=None, log=[], card="", trainings=trainings
        )
    got = read_checkpoint(tmp_path / "c")
    assert got.trainings == trainings and got.config == {"width": 3}
    content = json.loads(open_artefact(tmp_path / "c").file("config.json").read_text())
    assert content["trainings"][0]["data"]["archives"][0]["name"] == "walks, slow.zip"


@pytest.mark.parametrize("trainings", [{"a": 1}, [1], [{"steps": "many", "minutes": 1.0}], "all", None])
def test_damaged_trainings_are_named(tmp_path, trainings):
    with write_artefact(tmp_path / "c", "checkpoint", stage="train-ae", config={}) as draft:
        write_checkpoint(draft.folder, weights={}, config={}, optimiser=None, log=[], card="")
        (draft.folder / "config.json").write_text(json.dumps({"trainings": trainings}))
    with pytest.raises(InputError, match=r"config\.json is damaged"):
        read_checkpoint(tmp_path / "c")


def test_the_frozen_checkpoint_of_version_1_is_read():
    assert open_artefact(FROZEN, "checkpoint").manifest.schema_version == 1
    got = read_checkpoint(FROZEN)
    assert got.config == {"network": "autoencoder", "window": 24}
    assert got.weights["layer.weight"].tolist() == [[0, 1, 2], [3, 4, 5]]
    first, last = got.trainings
    assert (first.steps, first.minutes, last.steps, last.minutes) == (5, 1.0, 7, 2.5)
    assert first.data and [(each.name, each.loose) for each in first.data.archives] == [
        ("a.tar.gz", False),
        ("", True),
    ]
    assert last.data and [each.name for each in last.data.archives] == ["b.zip", "walks, slow.zip"]
    assert (last.data.clips, last.data.seconds, last.data.skeletons) == (3, 360.0, 1)
    assert last.data.sentence == "3 clips, 0.10 hours, 1 skeletons, from b.zip, walks, slow.zip"
    assert verify(FROZEN) == []  # reading changes nothing


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*/*/manifest.json")), ids=lambda p: "-".join(p.parts[-3:-1]))
def test_shipped_weights_know_what_they_were_trained_on(path):
    content = json.loads(next(path.parent.glob("data-*/config.json")).read_text())
    got = read_checkpoint(path.parent, optimiser=False)
    assert got.trainings and all(each.steps > 0 and each.data is not None for each in got.trainings)
    last = got.trainings[-1].data
    assert last and all(each.name.endswith(".zip") and not each.loose for each in last.archives)
    if json.loads(path.read_text())["schema_version"] == 1:
        assert last.sentence == content["trained_on"]


def version_1(path, config, log=()):
    """A checkpoint as version 1 wrote it."""
    with pytest.MonkeyPatch.context() as then:
        then.setitem(KINDS, "checkpoint", KINDS["checkpoint"]._replace(schema_version=1))
        with write_artefact(path, "checkpoint", stage="train-ae", config={}) as draft:
            write_checkpoint(draft.folder, weights={}, config={}, optimiser=None, log=list(log), card="")
            (draft.folder / "config.json").write_text(json.dumps(config))
    return path


def test_weights_that_tell_of_no_training_had_the_one_of_their_log(tmp_path):
    log = [{"step": 3, "seconds": 60.0}, {"step": 8, "seconds": 186.0}]
    line = "3 clips, 0.50 hours, 2 skeletons, from b.zip"
    (only,) = read_checkpoint(version_1(tmp_path / "c", {"trained_on": line}, log)).trainings
    assert (only.steps, only.minutes) == (8, 3.1) and only.data and only.data.sentence == line


@pytest.mark.parametrize("line", ["nothing", "", "3 clips from b.zip"])
def test_sentences_that_are_no_such_ones_are_unknown_data(tmp_path, line):
    config = {"trained_on": line, "trainings": [{"steps": 1, "minutes": 0.5}]}
    (only,) = read_checkpoint(version_1(tmp_path / "c", config)).trainings
    assert only == Training(steps=1, minutes=0.5, data=None)


def test_unfinished_trainings_of_version_1_tell_of_none(tmp_path):
    got = read_checkpoint(version_1(tmp_path / "c", {"training": {}, "place": {}}, [{"step": 3, "seconds": 60.0}]))
    assert got.trainings == () and got.config == {"training": {}, "place": {}}


def test_several_data_of_one_training_are_taken_together(tmp_path):
    line = "3 clips, 0.50 hours, 1 skeletons, from a; b.zip; 4 clips, 0.25 hours, 2 skeletons, from loose files"
    (only,) = read_checkpoint(version_1(tmp_path / "c", {"trained_on": line})).trainings
    assert only.data and (only.data.clips, only.data.seconds, only.data.skeletons) == (7, 2700.0, 3)
    assert [each.name for each in only.data.archives] == ["a; b.zip", ""]


def test_the_data_that_no_training_of_version_1_names_are_the_last_ones(tmp_path):
    line = "3 clips, 0.50 hours, 2 skeletons, from b.zip"
    config = {"trained_on": line, "trainings": [{"steps": 1, "minutes": 0.5}, {"steps": 2, "minutes": 1.0}]}
    got = read_checkpoint(version_1(tmp_path / "c", config))
    assert [each.data.sentence for each in got.trainings if each.data] == [line, line]


def test_damaged_settings_of_version_1_are_an_input_error(tmp_path):
    path = version_1(tmp_path / "c", {"trained_on": "nothing", "trainings": [3]})
    with pytest.raises(InputError, match="data of version 1 cannot be read"):
        read_checkpoint(path)
