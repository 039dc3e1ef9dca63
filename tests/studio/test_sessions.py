"""Sessions: opened, changed, undone, filled, edited, saved; and what is on the disk after a kill."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette")
pytest.importorskip("httpx2")

from data_schemas.errors import InputError, UsageError
from stages.shared.formats.bvh import read_bvh
from stages.shared.formats.bvh_motion import motion_of
from stages.shared.kinematics.forward_numpy import positions_of
from stages.shared.weights.shipped import default_weights
from stages.studio.bench import _with_result
from stages.studio.session import MOST_CHANGES, FillSettings, MotionRecord, Session, Sessions, State
from stages.studio.worker import CancelledError, Worker
from tests.studio.bench_in_folder import CLIPS, TOKEN, Page, bench_in

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with bench_in(tmp_path_factory.mktemp("sessions") / "folder", "kick", "jump") as bench:
        yield Page(bench, "kick.bvh")


def test_a_file_is_opened_with_keys_and_its_points(page: Page) -> None:
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    motion = session["state"]["motion"]
    assert session["state"]["settings"]["constraints"]["keyframes"].startswith("0,15,30")
    where = f"sessions/{session['id']}/motions/{motion}"
    about = page.ask(where)
    raw = page.client.get(f"/{TOKEN}/api/{where}/points").content
    points = np.frombuffer(raw, "<i2").reshape(about["frames"], about["nodes"], 3) * about["scale"] + about["origin"]
    skeleton, read, _ = motion_of(read_bvh((CLIPS / "kick.bvh").read_bytes(), "kick"))
    true = positions_of(skeleton, read)[:, skeleton.root]
    assert np.abs(points[:, about["root"]] - true).max() <= 0.51 * about["scale"] < 1e-3
    assert set(about["ends"]) == {"left_hand", "right_hand", "left_foot", "right_foot", "head"}
    assert page.ask("start")["first"] == "kick.bvh" and "kick.bvh" in page.ask("files")


def test_changes_are_undone_and_redone(page: Page) -> None:
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    first = session["state"]["settings"]
    changed = page.settings(session, keyframes="0,40")
    assert changed["undo"] == "Changed"
    undone = page.post(changed, "history", move="undo")
    assert undone["state"]["settings"] == first and undone["redo"] == "Changed"
    redone = page.post(undone, "history", move="redo")
    assert redone["state"]["settings"]["constraints"]["keyframes"] == "0,40"
    assert "nothing to redo" in page.post(redone, "history", 400, move="redo")["error"]


def test_two_pages_do_not_mix(page: Page) -> None:
    """Each page has a session of its own; of two pages with one session, the one that is out of date is told so."""
    one, two = (page.ask("open", "POST", {"file": name}) for name in ("kick.bvh", "jump.bvh"))
    page.settings(one, keyframes="0,9")
    assert page.session(two)["state"] == two["state"]
    page.settings(one, 409, keyframes="0,12")
    assert page.session(one)["state"]["settings"]["constraints"]["keyframes"] == "0,9"
    own = f"sessions/{two['id']}/motions/m99"
    assert "no such motion" in page.ask(own, status=404)["error"]


def test_bad_constraints_and_files_are_sentences(page: Page) -> None:
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    page.settings(session, 400, keyframes=3)
    answer = page.client.post(f"/{TOKEN}/api/upload?name=x.bvh", content=b"HIERARCHY\nROOT")
    assert answer.status_code == 404 and "x.bvh" not in os.listdir(page.bench.folder.path)
    known = page.ask("sessions")
    assert page.client.post(f"/{TOKEN}/api/upload?name=x.txt", content=b"no motion").status_code == 404
    assert page.ask("sessions") == known, "a file that cannot be read begins no session"


def test_fill_and_edit_are_repeated_by_the_saved_commands_to_the_byte(
    page: Page, fast_python: tuple[str, ...]
) -> None:
    folder = page.bench.folder.path
    session = page.ask("open", "POST", {"file": "kick.bvh"})
    job = page.wait(page.post(session, "edit", verb="trim", options={"frames": "3:40"}))
    assert job["state"] == "done", job
    session = page.session(session)
    assert session["state"]["settings"]["constraints"]["keyframes"] == "12,27"  # 15 and 30 of the whole clip
    session = page.settings(session, keyframes="0,20,36", pins=[{"end": "right_hand", "frames": "5-8"}])
    job = page.wait(page.post(session, "fill", samples=2))
    assert job["state"] == "done" and len(job["made"]["motions"]) == 2, job
    session = page.session(session)
    assert session["state"]["results"] == job["made"]["motions"]
    made = page.post(session, "save", motion=session["state"]["results"][1], name="saved.bvh")
    assert made["files"] == ["saved.bvh", "saved.json", "saved.sh"]
    assert made["commands"] == [
        "pumps edit trim kick.bvh --frames=3:40 -o saved.step2.bvh",
        "pumps infill saved.step2.bvh --constraints saved.json --device=cpu --sample=2 -o saved.bvh",
    ]
    saved = (folder / "saved.bvh").read_bytes()
    (folder / "saved.bvh").unlink()
    for line in made["commands"]:
        words = [*fast_python, "-m", "pumps_cli", *shlex.split(line)[1:], "--quiet"]
        subprocess.run(words, cwd=folder, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert (folder / "saved.bvh").read_bytes() == saved
    assert session["motions"][session["state"]["results"][1]]["told"][-1].startswith("Of 2 fills, sample 2 is")
    gone = page.post(session, "discard", motion=session["state"]["results"][0])
    assert gone["state"]["results"] == job["made"]["motions"][1:]
    on = page.post(gone, "choose", motion=job["made"]["motions"][1])
    assert on["state"]["motion"] == job["made"]["motions"][1] and not on["state"]["results"]
    assert page.post(on, "history", move="undo")["state"] == gone["state"]


def test_a_fill_is_cancelled_and_the_next_one_works(page: Page) -> None:
    session = page.settings(page.ask("open", "POST", {"file": "jump.bvh"}), keyframes="0,20")
    long, waiting = (page.post(session, "fill", samples=8) for _ in range(2))
    for job in (waiting, long):
        page.ask(f"sessions/{session['id']}/jobs/{job['id']}", "DELETE")
        assert page.wait(job)["state"] == "cancelled"
    session = page.session(session)
    kept = page.bench.sessions.folder(session["id"])
    left = {path.stem for path in kept.glob("m*.*")}
    assert left == set(session["motions"]), "nothing is left of what was cancelled"
    bad = page.settings(session, keyframes="0,1")
    assert "nothing to fill" in page.wait(page.post(bad, "fill", samples=1))["error"]


def test_a_killed_server_loses_nothing(tmp_path: Path) -> None:
    """All that was answered is on the disk: another server's page goes on."""
    with bench_in(tmp_path / "folder", "kick") as bench:
        page = Page(bench)
        session = page.settings(page.ask("open", "POST", {"file": "kick.bvh"}), keyframes="0,7,30")
        again = Sessions(bench.folder.sessions()).load(session["id"])  # without the first one's memory
        assert again.model_dump(mode="json")["history"][-1] == session["state"]
        assert [each["id"] for each in Page(bench).ask("sessions")] == [session["id"]]
        broken = bench.sessions.folder(session["id"]) / "session.json"
        broken.write_text(json.dumps({**json.loads(broken.read_text()), "cursor": 99}))
        with pytest.raises(InputError, match="damaged"):
            Sessions(bench.folder.sessions()).load(session["id"])


@pytest.mark.parametrize("source", ["m1", "m2", "m3", "../m0"])
def test_a_motion_made_from_itself_is_refused(tmp_path: Path, source: str) -> None:
    with bench_in(tmp_path / "folder", "kick") as bench:
        page = Page(bench)
        session = page.ask("open", "POST", {"file": "kick.bvh"})
        file = bench.sessions.folder(session["id"]) / "session.json"
        held = json.loads(file.read_text())
        step = {"stage": "edit-mirror", "name": "m"}
        held["motions"] |= {"m2": {**step, "source": source}, "m3": {**step, "source": "m2"}}
        file.write_text(json.dumps(held))
        bench.sessions = Sessions(bench.folder.sessions())
        if source == "m1":
            assert set(page.session(session)["motions"]) == {"m1", "m2", "m3"}
            return
        told = page.post(session, "save", 404, motion="m3", name="a.bvh")["error"]
        assert told == f"The session {session['id']} is damaged. Open the file again."


def test_plain_interpolation_is_that_of_the_keys(page: Page) -> None:
    session = page.ask("open", "POST", {"file": "kick.bvh"})

    def points(what: str) -> np.ndarray:
        where = f"sessions/{session['id']}/{what}"
        about, raw = page.ask(where), page.client.get(f"/{TOKEN}/api/{where}/points").content
        return (
            np.frombuffer(raw, "<i2").reshape(about["frames"], about["nodes"], 3) * about["scale"] + about["origin"]
        )

    motion = f"motions/{session['state']['motion']}"
    root = page.ask(f"sessions/{session['id']}/{motion}")["root"]
    session = page.settings(session, keyframes="4,20,36")
    made, true = points("plain"), points(motion)
    between = [*range(5, 20), *range(21, 36)]
    np.testing.assert_allclose(np.delete(made, between, 0), np.delete(true, between, 0), atol=2e-3)
    np.testing.assert_allclose(made[12, root], (true[4, root] + true[20, root]) / 2, atol=2e-3)
    assert np.abs(made - true)[12].max() > 0.05
    session = page.settings(session, keyframes="4,12,36")
    np.testing.assert_allclose(points("plain")[12], true[12], atol=2e-3)
    page.settings(session, keyframes=None)
    assert "Nothing says which frames are keys" in page.ask(f"sessions/{session['id']}/plain", status=400)["error"]


def test_the_page_gets_a_few_lines_of_every_stage(page: Page) -> None:
    session = page.ask("open", "POST", {"file": "jump.bvh"})
    for verb, options in (
        ("mirror", {}),
        ("smooth", {"seconds": 0.2}),
        ("trim", {"frames": "0:30"}),
        ("denoise", {}),
    ):
        job = page.wait(page.post(session, "edit", verb=verb, options=options))
        session = page.session(session)
        made = session["motions"][job["made"]["motions"][0]]
        assert made["gist"] and set(made["gist"]) <= set(made["told"]), verb


def test_a_session_of_another_person_names_no_weights_of_its_own(tmp_path: Path) -> None:
    with bench_in(tmp_path / "folder", "kick") as bench:
        page = Page(bench)
        session = page.ask("open", "POST", {"file": "kick.bvh"})
        file = bench.sessions.folder(session["id"]) / "session.json"
        file.write_text(file.read_text().replace(f'"{default_weights()}"', '"../elsewhere"'))
        bench.sessions = Sessions(bench.folder.sessions())
        assert "no weights '../elsewhere'" in page.post(session, "fill", samples=1, status=400)["error"]
        assert "no weights" in page.post(session, "edit", verb="loop", options={}, status=400)["error"]


def with_motion(session: Session, motion: str, source: str = "") -> Session:
    """The session gone on with a motion of its own, which a stage made."""
    record = MotionRecord(name=motion, stage="edit-mirror", source=source)
    held = session.model_copy(update={"motions": {**session.motions, motion: record}})
    return held.with_state(held.state.model_copy(update={"label": motion, "motion": motion}))


def test_undone_work_is_removed_when_something_else_is_done(tmp_path: Path) -> None:
    sessions = Sessions(tmp_path)
    session = sessions.create(FillSettings(weights="small-free", seed=0))
    for motion in ("m1", "m2"):
        session = sessions.change(session.id, lambda old, m=motion: with_motion(old, m))
        sessions.bvh(session, motion).write_text("motion")
    undone = sessions.change(session.id, lambda old: old.moved(-1))
    assert sessions.bvh(undone, "m2").exists(), "it can be redone"
    session = sessions.change(session.id, lambda old: with_motion(old, "m3", source="m1"))
    assert set(session.motions) == {"m1", "m3"}
    assert sorted(path.name for path in sessions.folder(session.id).glob("m*")) == ["m1.bvh"]


def test_as_many_changes_are_undone_as_the_bound_says() -> None:
    session = Session(id="0" * 16, history=(State(label="Began", settings=FillSettings(weights="w", seed=0)),))
    for number in range(MOST_CHANGES + 5):
        session = session.with_state(session.state.model_copy(update={"label": str(number)}))
    session = session.moved(-MOST_CHANGES)
    assert session.state.label == "4"
    with pytest.raises(UsageError, match="nothing to undo"):
        session.moved(-1)


def test_links_in_a_session_are_not_followed(tmp_path: Path) -> None:
    sessions = Sessions(tmp_path / "sessions")
    session = sessions.create(FillSettings(weights="small-free", seed=0))
    session = sessions.change(session.id, lambda old: with_motion(old, "m1"))
    (tmp_path / "secret").write_text("secret")
    (sessions.folder(session.id) / "m1.bvh").symlink_to(tmp_path / "secret")
    with pytest.raises(InputError, match="is a link"):
        sessions.bvh(session, "m1")
    (tmp_path / "sessions" / ("f" * 16)).symlink_to(sessions.folder(session.id))
    for name in ("f" * 16, "../" + session.id):
        with pytest.raises(InputError, match="no such session"):
            sessions.load(name)


def test_a_result_leaves_the_settings_of_a_page_current(tmp_path: Path) -> None:
    """A page may change settings while a fill adds results; it may not undo what it has not seen."""
    with bench_in(tmp_path / "folder", "kick") as bench:
        page = Page(bench)
        seen = page.ask("open", "POST", {"file": "kick.bvh"})
        base = seen["state"]["motion"]
        record = MotionRecord(name="fill", stage="infill", source=base)
        bench._keep(seen["id"], "m2", record, _with_result)
        page.post(seen, "history", 409, move="undo")
        changed = page.settings(seen, keyframes="0,9")
        assert changed["state"]["results"] == ["m2"]
        page.settings(seen, 409, keyframes="0,12")
        (bench.sessions.folder(seen["id"]) / "m3.bvh").write_text("made")
        lost = record.model_copy(update={"source": "m99"})
        with pytest.raises(UsageError, match="undone meanwhile"):
            bench._keep(seen["id"], "m3", lost, _with_result)
        assert "m3" not in page.session(seen)["motions"]
        assert not list(bench.sessions.folder(seen["id"]).glob("m3*"))


def test_what_a_cancelled_stage_still_sends_answers_no_later_call(tmp_path: Path) -> None:
    def cancelled(label: str, done: float, total: float) -> None:
        raise CancelledError

    worker = Worker(default_weights(), "cpu")
    clip = {"input": str(CLIPS / "kick.bvh")}
    try:
        with pytest.raises(CancelledError):
            worker.run("export", {**clip, "output": tmp_path / "first.csv"}, cancelled)
        report = worker.run("export", {**clip, "output": tmp_path / "next.csv"}, lambda *_: None)
        assert report.output == tmp_path / "next.csv" and (tmp_path / "next.csv").exists()
    finally:
        worker.close()


def test_a_stage_that_is_ready_when_it_is_cancelled_adds_no_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with bench_in(tmp_path / "folder", "kick") as bench:
        page = Page(bench)
        session = page.ask("open", "POST", {"file": "kick.bvh"})
        run = bench._worker.run

        def ready(stage: str, values: dict[str, Any], told: Any) -> Any:
            report = run(stage, values, told)
            (job,) = bench.jobs.of(session["id"])
            job.state = "cancelled"
            return report

        monkeypatch.setattr(bench._worker, "run", ready)
        job = page.wait(page.post(session, "edit", verb="mirror", options={}))
        assert job["state"] == "cancelled"
        bench.jobs.close()
        bench.jobs._thread.join()
        assert list(page.session(session)["motions"]) == ["m1"]
        assert {path.stem for path in bench.sessions.folder(session["id"]).glob("m*.*")} == {"m1"}


def test_models_are_loaded_once_and_not_after_the_end(tmp_path: Path) -> None:
    with bench_in(tmp_path / "folder") as bench:
        bench.warm()
        process = bench._worker._process
        bench.warm()
        assert bench._worker._process is process
    bench.warm()
    assert not process.is_alive() and bench._worker._process is process
