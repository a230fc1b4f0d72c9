"""The example distribution, installed by pip, all the way: run, recorded, shown, reported."""

import importlib.util
import json
import os
from pathlib import Path

import pytest
from plugin_site import install_example
from processes import outcomes

STACK = '''
from devkit.idle import IdleStack
from schemas.messages import Command


class Stops(IdleStack):
    """Brakes from the first tick on, harder when it is cold."""

    def __init__(self, slots):
        super().__init__(slots)
        self.air_c = [20.0] * slots

    def step(self, observation):
        if "thermometer" in observation.sensors:
            self.air_c = observation.sensors["thermometer"][:, 0].tolist()
        return [
            Command(
                slot=slot,
                token=int(observation.token[slot]),
                tick=int(observation.tick[slot]),
                throttle=0.0,
                brake=0.5 + 0.01 * (20.0 - self.air_c[slot]),
                steering_rad=0.0,
            )
            for slot in observation.active_slots()
        ]
'''
CAMPAIGN = """\
campaign: stop-line
control_hz: 20
camera: {width: 64, height: 36, hz: 10}
scenario: {type: stop_line, duration_s: 2, ego_speed_mps: 5, standstill_s: 0.2}
sensors: {thermometer: {hz: 10, lag_s: 1}}
autonomy: {stack: "stopping_stack:Stops", perception: {none: {type: ground_truth}}}
matrix: {scenario.line_m: [1, 4, 12], scenario.air_c: [0, 40]}
"""
CASE = "air_c_0-line_m_4"
SEEING_STACK = '''
from devkit.idle import IdleStack
from schemas.messages import Command


class Stops(IdleStack):
    """Brakes as soon as the sonar has seen anything."""

    def __init__(self, slots):
        super().__init__(slots)
        self.brake = [0.0] * slots

    def step(self, observation):
        if "sonar" in observation.sensors:
            rows, counts = observation.sensors["sonar"], observation.counts["sonar"]
            for slot in observation.active_slots():
                near_m = rows[slot, : counts[slot], 0]
                assert (near_m > 0).all()
                self.brake[slot] = 0.5 if len(near_m) else 0.0
        return [
            Command(
                slot=slot,
                token=int(observation.token[slot]),
                tick=int(observation.tick[slot]),
                throttle=0.0,
                brake=self.brake[slot],
                steering_rad=0.0,
            )
            for slot in observation.active_slots()
        ]
'''
SEEING = """\
campaign: sonar
control_hz: 20
camera: {width: 64, height: 36, hz: 10}
scenario: {type: stop_line, duration_s: 2, ego_speed_mps: 5, standstill_s: 0.2, line_m: 4}
sensors: {sonar: {hz: 10}}
autonomy: {stack: "seeing_stack:Stops", perception: {none: {type: ground_truth}}}
matrix: {sensors.sonar.range_m: [0.1, 500]}
"""
TUNNEL = """\
campaign: tunnel
camera: {width: 64, height: 36, hz: 20}
scenario: {duration_s: 1}
autonomy: {perception: {wide: {type: tunnel, share: 1}, narrow: {type: tunnel, share: 0.01}}}
matrix: {model: [wide, narrow]}
"""


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """The campaign file; the example is installed, and the stack on the path."""
    site, _ = install_example(tmp_path)
    (tmp_path / "stopping_stack.py").write_text(STACK)
    path = tmp_path / "stop-line.yaml"
    path.write_text(CAMPAIGN)
    inherited = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(site), inherited]))
    return path


def said(marked, *words, codes=(0,)):
    done = marked.run(*map(str, words))
    assert done.returncode in codes, (words, done.stdout + done.stderr)
    return done.stdout


def test_the_example_goes_all_the_way(marked, campaign, tmp_path, monkeypatch):
    three, one = tmp_path / "three", tmp_path / "one"
    assert "6 cases" in said(marked, "conductor", "validate", campaign)
    assert "conforms" in said(marked, "devkit", "check", campaign, "--ticks", 20)
    run = ("conductor", "run", campaign, "--workers", 1, "--output", "json")
    first = said(marked, *run, "--slots", 3, "--view", "record", "--out", three, codes=(1,))
    second = said(marked, *run, "--slots", 1, "--out", one, codes=(1,))
    assert json.loads(first)["fingerprint"] == json.loads(second)["fingerprint"]
    words = {case: row["verdict"] for case, row in outcomes(three).items()}
    assert set(words.values()) == {"pass", "over_the_line", "too_short"}
    assert words[CASE] == "pass"
    assert "the same" in said(marked, "conductor", "fingerprint", three, one)
    shown(marked, three)
    reported(marked, three)
    compared_and_exported(marked, one, three, tmp_path / "csv")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))  # the stack, without the example
    said(marked, "conductor", "validate", campaign, codes=(2,))


@pytest.mark.usefixtures("campaign")
def test_a_ray_sensor_of_others_reaches_the_stack_row_by_row(marked, tmp_path):
    (tmp_path / "seeing_stack.py").write_text(SEEING_STACK)
    path, two, one = (tmp_path / name for name in ("sonar.yaml", "two", "one"))
    path.write_text(SEEING)
    assert "conforms" in said(marked, "devkit", "check", path, "--ticks", 20)
    run = ("conductor", "run", path, "--workers", 1)
    said(marked, *run, "--slots", 2, "--view", "record", "--out", two, codes=(1,))
    said(marked, *run, "--slots", 1, "--out", one, codes=(1,))
    words = {row["verdict"] for row in outcomes(two).values()}
    assert words == {"pass", "over_the_line"}, "one slot saw something, the other nothing"
    assert "the same" in said(marked, "conductor", "fingerprint", two, one)


@pytest.mark.usefixtures("campaign")
def test_a_perception_variant_of_others_sees_for_the_shipped_stack(marked, tmp_path, monkeypatch):
    path, out = tmp_path / "tunnel.yaml", tmp_path / "out"
    path.write_text(TUNNEL)
    said(marked, "conductor", "run", path, "--workers", 1, "--slots", 2, "--out", out, codes=(1,))
    rows = outcomes(out)
    assert {case: row["perception"]["runtime"] for case, row in rows.items()} == {
        "narrow": "python",
        "wide": "python",
    }
    assert all(row["perception"]["frames"] > 10 for row in rows.values())
    page = (out / "report.html").read_text()
    assert "the simulator&#39;s boxes in the middle of the picture" in page
    audited(marked, out, tmp_path, monkeypatch)


def audited(marked, folder: Path, tmp_path: Path, monkeypatch):
    """A plug-in of a certificate is loaded only if the auditor says so, and has it."""
    certificate = tmp_path / "tunnel.cert"
    said(marked, "conductor", "certify", folder, "-o", certificate)
    audit = ("conductor", "audit", certificate, "--workers", 1, "--out", tmp_path / "audit")
    done = marked.run(*map(str, audit))
    assert done.returncode == 2
    assert "would run the plug-in" in done.stderr
    assert "holds: 2 cases" in said(marked, *audit, "--run-stack")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))  # without the example
    done = marked.run(*map(str, audit), "--run-stack")
    assert done.returncode == 3
    assert "its campaign" in done.stderr.splitlines()[-1]


def shown(marked, folder: Path):
    """The recording holds the thermometer's readings."""
    from viewer.playback.frames import read_case

    listed = json.loads(said(marked, "viewer", "replay", folder, "--output", "json"))["cases"]
    assert len(listed) == 6
    frames = read_case(Path(next(row["path"] for row in listed if row["case"] == CASE))).frames
    read = [frame.readings["thermometer"]["air_c"] for frame in frames if frame.readings]
    assert read[0] == 20.0
    assert read == sorted(read, reverse=True)
    assert read[-1] < 15.0
    assert len(read) == sum(frame.jpeg is not None for frame in frames), "both at 10 Hz"
    if importlib.util.find_spec("mcap") is not None:
        out = folder / "case.mcap"
        said(marked, "viewer", "export", folder, CASE, "--mcap", out)
        assert b"/sensors/thermometer" in out.read_bytes()


def reported(marked, folder: Path):
    said(marked, "conductor", "report", folder, codes=(1,))
    page = (folder / "report.html").read_text()
    for text in (
        "the ego stopped at most 3 m before the line.",
        "over_the_line",
        "Before the line [m]",
        "Jerk, peak [m/s^3]",
        "To the line",
    ):
        assert text in page, text


def compared_and_exported(marked, one: Path, three: Path, out: Path):
    found = json.loads(said(marked, "conductor", "compare", one, three, "--output", "json"))
    assert found["identical"]
    shifts = {shift["name"]: shift for shift in found["shifts"]}
    assert shifts["jerk_peak_mps3"]["label"] == "Largest jerk [m/s^3]"
    assert shifts["jerk_peak_mps3"]["pairs"] == 6
    said(marked, "conductor", "export", three, "--format", "csv", "--out", out)
    head, *rows = (out / f"{CASE}.csv").read_text().splitlines()
    assert head.endswith('"to_line_m","jerk_mps3"')
    assert len(rows) > 20
    assert "jerk_peak_mps3" in (out / "summary.csv").read_text()
