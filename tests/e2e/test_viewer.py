"""Looking at a campaign, recording it, and freezing whoever does: the KPIs do not notice."""

import itertools
import json
import signal

import cv2
import numpy as np
import pytest
from processes import (
    PATIENCE_S,
    Marked,
    committed,
    complete,
    has_line_to,
    nothing_left,
    outcomes,
    wait_for,
)
from recordings import begun, read_recording
from served_campaign import ServedCampaign

from twin.base.gpu.vulkan import has_vulkan
from twin.fabric.discovery import find_conductor
from twin.records.kpi_file import read_kpi
from twin.worker.rig_process import RECORDERS_MAX
from viewer.recording import naming

needs_vulkan = pytest.mark.skipif(
    not has_vulkan(), reason="no Vulkan driver; apt-get install mesa-vulkan-drivers"
)


def start(marked, folder, *options, campaign="chaos-16"):
    """A run of chaos-16 in the background."""
    return marked.start(
        *("conductor", "run", str(campaign), "--out", str(folder), "--output", "json", *options)
    )


def keeping(keep, quiet, folder):
    """A campaign file of chaos-16 that keeps such recordings."""
    text = (quiet["folder"] / "campaign.yaml").read_text()
    assert "keep: all" in text
    path = folder / f"{keep}.yaml"
    path.write_text(text.replace("keep: all", f"keep: {keep}"))
    return path


def finish(child):
    """Its JSON."""
    out, err = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 1, err
    found = json.loads(out)
    assert found["committed"] == 16
    return found


def note(folder, case):
    """What ``recording.json`` of the committed attempt says; None: there is none.

    An empty one is none: its writer was killed.
    """
    path = folder / outcomes(folder)[case]["attempt_dir"] / naming.RECORDING_NOTE
    return read_note(path) if path.exists() else None


def read_note(path):
    return json.loads(path.read_text() or "null")


def whole(folder):
    """How many recordings below a campaign folder say that they are complete."""
    notes = map(read_note, folder.glob(f"cases/*/*/{naming.RECORDING_NOTE}"))
    return sum(bool(said and said["complete"]) for said in notes)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """chaos-16, recorded by 2 workers x 2 slots."""
    folder = tmp_path_factory.mktemp("recorded") / "chaos-16"
    starter = Marked()
    try:
        with nothing_left(starter):
            child = start(starter, folder, "--workers", "2", "--slots", "2", "--view", "record")
            return {"folder": folder, **finish(child)}
    finally:
        starter.end()


def test_one_readable_recording_per_case(recorded, quiet):
    folder = recorded["folder"]
    assert recorded["fingerprint"] == quiet["fingerprint"]
    for case, row in outcomes(folder).items():
        attempt = folder / row["attempt_dir"]
        kpi = read_kpi(attempt / naming.KPI_FILE)
        found = read_recording(attempt / naming.RECORDING_FILE)
        assert found.application_id == naming.CASE_APP
        assert found.recording_id == f"chaos-16-{case}-1"
        assert found.properties["case"]["case"] == case
        assert found.properties["verdict"]["verdict"] == row["verdict"]
        said = found.properties["verdict"]
        assert said["complete"] is True, (said, note(folder, case))
        assert found.blueprints == 1
        assert note(folder, case)["complete"] is True
        # One row per KPI row; commands and pictures except at the last.
        for path in (naming.EGO, naming.SPEED, naming.DTC, naming.GAP):
            assert found.rows[path] == kpi.num_rows
        for path in (naming.CAMERA, naming.TRUTH, naming.DETECTIONS, naming.BRAKE, naming.AEB):
            assert found.rows[path] == kpi.num_rows - 1
        assert found.rows[naming.TTC] == kpi.num_rows - kpi.column("ttc_s").null_count
        assert {naming.OBSTACLE, naming.STREET, naming.SUMMARY, naming.CAMERA} <= found.static
    assert len(list(folder.rglob(naming.RECORDING_FILE))) == 16
    assert not list(folder.rglob("*.tmp"))


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_recorder_frozen_or_killed_in_the_middle(marked, quiet, tmp_path, number):
    folder = tmp_path / "c"
    child = start(marked, folder, "--workers", "1", "--slots", "2", "--view", "record")
    wait_for(lambda: committed(folder) >= 3, "three cases")
    wait_for(lambda: whole(folder), "a recording")  # its writer loads longer than a case takes
    marked.one("viewer", "record").send_signal(number)
    assert finish(child)["fingerprint"] == quiet["fingerprint"]
    notes = {case: note(folder, case) for case in outcomes(folder)}
    incomplete = [case for case, said in notes.items() if said is None or not said["complete"]]
    assert incomplete, "nothing was lost by the signal"
    assert any(said and said["complete"] for said in notes.values())
    for case in incomplete:
        path = folder / outcomes(folder)[case]["attempt_dir"] / naming.RECORDING_FILE
        if path.exists() and path.stat().st_size:
            # A recorder that died while it opened the file has left one of nobody.
            assert not begun(path) or read_recording(path).application_id == naming.CASE_APP
    assert not list(folder.rglob("*.tmp"))


def test_another_recorder_takes_the_place_of_a_killed_one(marked, quiet, tmp_path):
    """On the same rig: campaigns that come later are recorded; but not for ever."""
    served = ServedCampaign(marked, tmp_path)
    served.start()
    text = (quiet["folder"] / "campaign.yaml").read_text()
    assert "campaign: chaos-16" in text

    def recorded_of(number):
        """Recordings of campaign ``number`` that are complete once its cases have ended."""
        name = f"chaos-{number}"
        (tmp_path / f"{name}.yaml").write_text(text.replace("chaos-16", name))
        submit = ("conductor", "submit", str(tmp_path / f"{name}.yaml"))
        assert marked.run(*submit, "--state", str(served.state)).returncode == 0
        folder = served.state / name
        wait_for(lambda: complete(folder), name)
        return whole(folder)

    options = ("--state", str(served.state), "--slots", "2", "--view", "record")
    worker = marked.start("twin", "worker", *options)
    numbers = itertools.count()
    assert any(recorded_of(number) for number in itertools.islice(numbers, 9))
    simulator, recorder = marked.one("twin", "sim"), marked.one("viewer", "record")
    recorder.kill()
    assert any(recorded_of(number) for number in itertools.islice(numbers, 9))
    assert marked.one("twin", "sim") == simulator
    seen = {recorder.pid}

    def end_them():
        for process in marked.processes("viewer", "record"):
            seen.add(process.pid)
            process.kill()
        return len(seen) == RECORDERS_MAX

    wait_for(end_them, "the last recorder")
    assert recorded_of(next(numbers)) == 0
    worker.terminate()
    _, err = worker.communicate()
    assert err.count("another recorder takes the next ones") == RECORDERS_MAX - 1
    assert err.count("not recorded any more") == 1
    served.finish()


@needs_vulkan
def test_a_picture_of_a_moment(marked, recorded, tmp_path):
    folder = recorded["folder"]
    rows = outcomes(folder)
    braked = next(c for c, row in rows.items() if row["scalars"]["aeb_time_s"] is not None)
    out = tmp_path / "pictures" / "aeb.png"
    done = marked.run(
        *("viewer", "shot", str(folder), braked, "--at", "aeb", "--out", str(out)),
        *("--size", "800x450"),
    )
    assert done.returncode == 0, done.stderr
    assert f"AEB trigger at {rows[braked]['scalars']['aeb_time_s']:.2f} s" in done.stdout
    picture = cv2.imread(str(out))
    assert picture.shape == (450, 800, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 500
    colours = picture.reshape(-1, 3).astype(int)
    blue = (colours[:, 0] > 180) & (colours[:, 2] < 120)
    assert blue.sum() > 50, "the ego's trail and the speed plot"


def test_replay_without_a_display_says_what_to_do(marked, recorded, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    case = next(iter(outcomes(recorded["folder"])))
    done = marked.run("viewer", "replay", str(recorded["folder"]), case, "--at", "0.5")
    assert done.returncode == 0, done.stderr
    assert f"cases/{case}/attempt-1/{naming.RECORDING_FILE} ." in done.stdout
    assert "rerun recording.rrd" in done.stdout
    assert "0.5 s" in done.stdout


def test_the_recordings_of_a_campaign_as_a_table(marked, recorded, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    folder, rows = recorded["folder"], outcomes(recorded["folder"])
    done = marked.run("viewer", "replay", str(folder), "--output", "json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["missing"] == []
    assert [row["case"] for row in found["cases"]] == sorted(rows)
    for row in found["cases"]:
        kept = rows[row["case"]]
        assert (row["verdict"], row["passed"]) == (kept["verdict"], kept["passed"])
        if (aeb_time_s := kept["scalars"]["aeb_time_s"]) is not None:
            assert row["moment_s"] == pytest.approx(aeb_time_s)
    done = marked.run("viewer", "replay", str(folder))
    assert done.returncode == 0, done.stderr
    assert all(case in done.stdout for case in rows)
    assert "viewer web" in done.stdout


@needs_vulkan
def test_the_table_opens_in_the_viewer_with_every_case_at_its_moment(recorded):
    from viewer.playback.catalogue import read_catalogue
    from viewer.playback.replay import open_catalogue
    from viewer.playback.window import window

    catalogue = read_catalogue(recorded["folder"], "aeb")
    moments = {row.recording_id: row.moment.sim_time_ns for row in catalogue.rows}
    with window([str(row.found.path) for row in catalogue.rows], headless=True) as shown:
        open_catalogue(shown, catalogue)
        wait_for(lambda: "/dataset/" in shown.client.get_location(), "the table")
        state = shown.client.get_state()
        times = {r.store_id.rpartition(":")[2]: r.current_time for r in state.recordings}
        assert times == moments


def look(marked, folder, *options):
    """``viewer live`` on the run in ``folder``, which may not have begun; its hub's URL."""
    viewer = marked.start(
        *("viewer", "live", "--run", str(folder), "--wait", "60", *options),
        *("--no-window", "--output", "json"),
    )
    return viewer, lambda: json.loads(viewer.stdout.readline())


def test_the_result_page_shows_what_the_camera_saw(marked, recorded, tmp_path):
    folder = recorded["folder"]
    rows = outcomes(folder)
    page = tmp_path / "docs" / "chaos.md"
    done = marked.run("conductor", "report", str(folder), "--markdown", str(page))
    assert done.returncode == 1, done.stderr
    assert done.stdout.splitlines()[-1] == str(page)
    text = page.read_text()
    assert recorded["fingerprint"] in text
    assert "No picture" not in text
    shown = sorted(path.name for path in page.with_suffix("").glob("case-*.jpg"))
    lost = [c for c, row in rows.items() if row["verdict"] != "pass"]
    assert shown
    assert {f"case-{case}.jpg" for case in lost} >= set(shown)
    for name in shown:
        assert f"](chaos/{name})" in text
        assert cv2.imread(str(page.with_suffix("") / name)).shape[1] == 640


@needs_vulkan
def test_running_cases_are_shown_live(marked, quiet, tmp_path):
    from viewer.playback.window import window

    folder = tmp_path / "c"
    case = "yolov3-1300-heavy_rain"
    viewer, said = look(marked, folder, "--case", case)
    hello = said()
    campaign = keeping("failed", quiet, tmp_path)
    options = ("--workers", "2", "--view", "record+live")
    found = finish(start(marked, folder, *options, campaign=campaign))
    assert found["fingerprint"] == quiet["fingerprint"]
    for name, row in outcomes(folder).items():
        said_of_it = note(folder, name)
        assert said_of_it["complete"] is True, "the viewer took nothing from the recorder"
        assert said_of_it["kept"] is (row["verdict"] != "pass")
        path = folder / row["attempt_dir"] / naming.RECORDING_FILE
        assert path.exists() is said_of_it["kept"]
    assert hello["laptop"][0].startswith("ssh -N -L 9876:127.0.0.1:")
    with window(["--connect", hello["hub"]], headless=True) as shown:

        def arrived():
            found = {r.location: r for r in shown.client.get_state().recordings if r.timelines}
            wall = [r for where, r in found.items() if naming.OVERVIEW_APP in where]
            alone = [r for where, r in found.items() if naming.CASE_APP in where]
            return (wall[0], alone[0]) if wall and alone else None

        def laid_out(recording, names):
            # The blueprint may arrive after the data: a client that joins late
            # is sent both, in no promised order.
            def look():
                shown.client.set_location(recording.location)
                state = shown.client.get_state()
                assert not [report for view in state.views for report in view.reports]
                return names <= {view.name for view in state.views}

            return look

        wall, alone = wait_for(arrived, "the wall and the case in a native viewer")
        assert [timeline.name for timeline in wall.timelines] == [naming.WALL]
        assert {timeline.name for timeline in alone.timelines} == {naming.SIM_TIME, naming.TICK}
        assert f"recording_id=chaos-16-{case}-1" in alone.location
        views = {"Cases", "Running and latest", "Cases per minute", "Conductor"}
        wait_for(laid_out(wall, views), "the views of the wall")
        views = {"Street", "Planner", "Speed [m/s]", "Events"}
        wait_for(laid_out(alone, views), "the views of the case")
    viewer.send_signal(signal.SIGINT)
    counts = said()
    assert viewer.wait(PATIENCE_S) == 0
    assert counts["received"] >= counts["cases"] >= 8
    assert counts["ended"] >= 8
    assert counts["logged"] >= 2
    assert counts["attempts_in_full"] == 1
    assert counts["strangers"] == 0
    assert f"{case}: " in viewer.stderr.read(), "what the conductor says of it"


def test_a_frozen_viewer_holds_nobody_up(marked, quiet, tmp_path):
    folder = tmp_path / "c"
    viewer, said = look(marked, folder)
    options = ("--workers", "1", "--slots", "2", "--view", "record+live")
    child = start(marked, folder, *options, campaign=keeping("none", quiet, tmp_path))
    said()
    entry = folder / "conductor.json"
    wait_for(
        lambda: entry.exists() and has_line_to(viewer.pid, find_conductor(folder).endpoint),
        "a viewer that sees all",
    )
    seen = committed(folder)
    wait_for(lambda: committed(folder) >= seen + 2, "two cases that it sees")
    assert marked.processes("viewer", "record") == [], "nothing is recorded"
    viewer.send_signal(signal.SIGSTOP)
    assert finish(child)["fingerprint"] == quiet["fingerprint"]
    assert viewer.poll() is None
    viewer.send_signal(signal.SIGCONT)
    viewer.send_signal(signal.SIGINT)
    assert said()["received"] >= 1
    assert viewer.wait(PATIENCE_S) == 0


def test_a_conductor_that_moves_is_found_again(marked, tmp_path):
    """``--run`` names a folder: the next conductor of it may listen elsewhere."""
    folder = tmp_path / "state"
    viewer, said = look(marked, folder)
    said()
    endpoints = []
    for _ in range(2):
        conductor = marked.start("conductor", "serve", "--state", str(folder))
        line = conductor.stdout.readline()
        endpoints.append(line.split(" at ")[1].strip())
        heard = viewer.stderr.readline()
        while f"connected to {endpoints[-1]}" not in heard:
            assert heard, "the viewer has ended"
            assert len(heard.splitlines()) == 1
            heard = viewer.stderr.readline()
        conductor.send_signal(signal.SIGINT)
        assert conductor.wait(PATIENCE_S) == 130
    assert endpoints[0] != endpoints[1]
    viewer.send_signal(signal.SIGINT)
    assert viewer.wait(PATIENCE_S) == 0


def test_mistakes_are_one_line(marked, quiet, recorded, tmp_path):
    case = next(iter(outcomes(quiet["folder"])))
    done = [
        (marked.start("viewer", *arguments), words)
        for arguments, words in [
            (["shot", str(recorded["folder"]), f"{case}x"], f"did you mean '{case}'?"),
            (["replay", str(quiet["folder"]), case], "--view record"),
            (["shot", str(tmp_path), case], "not a campaign folder"),
            (
                ["shot", str(recorded["folder"]), case, "--at", "soon"],
                "expected aeb, closest, or seconds",
            ),
            (["live"], "give one of --connect"),
            (
                ["live", "--run", str(tmp_path), "--wait", "0"],
                "no conductor serves this folder",
            ),
            (["live", "--connect", "nowhere"], "expected tcp/HOST:PORT"),
            (["live", "--connect", "tls/h:1"], "needs a key of the fabric"),
        ]
    ]
    for child, words in done:
        _, err = child.communicate(timeout=PATIENCE_S)
        assert child.returncode == (3 if "serves" in words else 2), err
        assert words in err
        assert len(err.splitlines()) == 1
