"""One real run of each command, on one small campaign: the end-to-end test of the quick lane."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest
from foreign_campaigns import campaign
from processes import PATIENCE_S, outcomes, recorded_run
from typer.main import get_command
from waiting import wait_for

pytestmark = pytest.mark.quick
HERE = Path(__file__).parent

ELSEWHERE = {
    "conductor bench": "a measurement",
    "conductor bench-report": "a measurement",
    "conductor bench-run": "a measurement: tests/unit/conductor/bench/test_bench_run",
    "conductor bench-search": "a measurement",
    "conductor bench-store": "a measurement",
    "conductor bench-tls": "a measurement",
    **{f"conductor new {what}": "test_new" for what in ("campaign", "plugin", "scenario", "stack")},
    "conductor relay": "two hosts: test_two_hosts",
    "conductor compare": "two runs: test_compare_page",
    "conductor driving": "free driving: tests/unit/conductor/report/driving/test_driving_page",
    "devkit check-models": "asked by conductors: test_network_campaign",
    "devkit evaluate": "a dataset: tests/unit/devkit/detector/test_scoring",
    "devkit host": "started by every worker here",
    "devkit import-darknet": "a file of weights: tests/unit/devkit/detector/test_model_commands",
    "devkit parity": "published logs: tests/unit/devkit/replaying/test_parity",
    "devkit quantize": "pictures: tests/unit/devkit/detector/integer/test_quantize",
    "devkit train": "torch: tests/unit/devkit/training/test_training_command",
    "hpc bundle": "half a gigabyte of wheels: test_offline",
    "hpc cancel": "a scheduler: test_slurm",
    "hpc enter": "a container runtime: test_containers",
    "hpc fetch image": "a registry of images: tests/unit/hpc/test_inputs",
    "hpc fetch repository": "a repository: test_foreign_places",
    "hpc image build": "Apptainer: test_offline",
    "hpc image context": "half a gigabyte of wheels: tests/unit/hpc/test_image",
    "hpc leave": "podman: tests/unit/twin/sandbox/test_enter",
    "hpc pull": "ssh: tests/unit/hpc/test_hpc_commands",
    "hpc requeue": "a scheduler: test_slurm",
    "hpc scale": "a scheduler: test_scale",
    "hpc shell": "a scheduler: test_slurm",
    "hpc status": "a scheduler: test_slurm",
    "hpc submit": "a scheduler: test_slurm",
    "twin bench": "measurements: test_bench_trends",
    "twin dataset": "minutes: tests/kernel/test_dataset_files",
    "twin play": "a scenario file: tests/unit/twin/play/test_play_command",
    "twin reenact": "a case that was changed from outside: test_intervene_in_a_case",
    "twin validate campaign": "asked by conductors: tests/unit/conductor/run/test_twin_check",
    "twin validate road": "a road file: tests/unit/twin/road/opendrive/test_road_command",
    "twin validate scenario": "a scenario file: "
    "tests/unit/twin/scenario/storyboard/openscenario/test_broken_scenarios",
    "twin validate vehicle": "manoeuvres: tests/kernel/test_vehicle_validation",
    "twin worker": "started by every conductor here",
    "viewer bench": "a measurement",
    "viewer live": "test_viewer",
    "viewer look": "a running case: test_intervene_in_a_case",
    "viewer play": "a scenario file: test_viewer_play",
    "viewer pause": "a running case: test_intervene_in_a_case",
    "viewer release": "a running case: test_intervene_in_a_case",
    "viewer replay": "a display: test_viewer",
    "viewer resume": "a running case: test_intervene_in_a_case",
    "viewer set": "a running case: test_intervene_in_a_case",
    "viewer shot": "a graphics driver: test_viewer",
    "viewer step": "a running case: test_intervene_in_a_case",
    "viewer takeover": "a terminal: test_intervene_in_a_case",
    "viewer web": "a browser: test_viewer_web",
}
"""Commands that need more than this file has, and where they run."""

READ = [
    ("conductor", "verify", "{run}"),
    ("conductor", "certify", "{run}", "-o", "{tmp}/run.cert"),
    ("conductor", "audit", "{tmp}/run.cert", "--cases", "1", "--out", "{tmp}/audit"),
    ("conductor", "fingerprint", "{run}"),
    ("conductor", "report", "{run}", "--films", "failures"),
    ("conductor", "export", "{run}", "--format", "autodrive-csv", "--out", "{tmp}/csv"),
    ("conductor", "regress", "{run}", "--case", "{case}", "--into", "{tmp}/kept.yaml"),
    ("conductor", "validate", "{file}", "--axis", "weather=clear", "--set", "deadline_s=30"),
    ("conductor", "fields", "scenario"),
    ("conductor", "campaigns"),
    ("conductor", "doctor", "--out", "{tmp}"),
    ("twin", "judge", "{run}"),
    ("twin", "driving", "--part", "3", "--commit", "0" * 40, "--out", "{tmp}/driving"),
    ("twin", "snapshot", "--out", "{tmp}/sheet.png", "--weather", "clear", "--time", "12:00"),
    ("twin", "memory"),
    ("twin", "validate", "scene", "downtown"),
    ("twin", "validate", "lidar", "spinning_16"),
    ("twin", "validate", "radar", "mid_range"),
    ("devkit", "models"),
    ("devkit", "darknet-cfg", "yolov2-tiny"),
    ("devkit", "check", "devkit.idle:IdleStack", "--ticks", "20"),
    ("devkit", "replay", "{run}"),
    ("viewer", "frame", "{run}", "{case}", "--out", "{tmp}/frame.png", "--at", "1"),
    ("devkit", "detect", "yolov2-tiny-w25", "{tmp}/frame.png"),
    ("viewer", "strip", "{run}", "{case}", "--out", "{tmp}/strip.jpg", "--at", "1"),
    ("viewer", "export", "{run}", "{case}", "--mcap", "{tmp}/case.mcap"),
    ("viewer", "export", "{run}", "{case}", "--mcap", "{tmp}/ros.mcap", "--ros2", "--truth"),
    ("conductor", "replay-log", "{tmp}/ros.mcap", "-o", "{tmp}/replayed"),
    ("hpc", "render", "{file}", "--scheduler", "slurm", "--time", "10:00", "--workers", "1"),
    ("hpc", "doctor"),
]
"""On a finished run, in this order."""

SERVED = [
    ("conductor", "submit", "{noop}"),
    ("conductor", "status"),
    ("conductor", "explain", "small", "{waiting}"),
    ("conductor", "pause", "small"),
    ("conductor", "resume", "small"),
    ("conductor", "cancel", "small"),
    ("conductor", "retry", "small"),
    ("conductor", "invite", "--role", "viewer", "-o", "{tmp}/viewer.key"),
    ("conductor", "revoke", "{tmp}/viewer.key"),
    ("conductor", "drain", "{worker}"),
    ("conductor", "stop"),
]
"""At a conductor that serves, in this order."""


BAR = "━"
"""Part of a bar of progress, which is for terminals."""
WARPS_LINE = "Warp CUDA"
"""Begins what Warp says where there is no GPU, which is nothing to warn about."""
ALSO = {"report": 1, "doctor": 3}
"""Exit codes that are no mistake: a case did not pass, no scheduler is here."""


def every_command() -> set[str]:
    """The names of all commands, those of groups too."""
    found = set()
    for program in ("twin", "conductor", "devkit", "viewer", "hpc"):
        group = get_command(importlib.import_module(f"{program}.cli").app)
        shown = {name: each for name, each in group.commands.items() if not each.hidden}
        for name, command in shown.items():
            below = getattr(command, "commands", {})
            whole = {f"{program} {name} {each}" for each in below} or {f"{program} {name}"}
            found |= {f"{program} {name}"} & set(ELSEWHERE) or whole
    return found


def test_no_command_is_left_out():
    here = {"conductor run", "conductor serve", "conductor keygen"}
    for words in (*READ, *SERVED):
        name = " ".join(words[:2])
        here.add(f"{name} {words[2]}" if name == "twin validate" else name)
    assert here | set(ELSEWHERE) == every_command()
    assert not here & set(ELSEWHERE)
    files = {word.partition(": ")[2] or word for word in ELSEWHERE.values() if "test_" in word}
    folders = {file: Path(__file__).parents[2] if "/" in file else HERE for file in files}
    assert not [file for file in files if not (folders[file] / f"{file}.py").exists()]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A finished run of two short cases, recorded in every way."""
    folder = tmp_path_factory.mktemp("every")
    path = campaign(folder, "every", {}, matrix={"weather": ["clear", "heavy_fog"]})
    done = recorded_run(path, folder / "run")
    said = [*(folder / "run").glob("logs/*"), *(folder / "run").glob("cases/*/*/log.txt")]
    assert said
    for text in (done.stderr, *(log.read_text(errors="replace") for log in said)):
        assert WARPS_LINE not in text
    return path, folder / "run"


def test_a_run_and_all_that_reads_it(marked, ran, tmp_path):
    path, run = ran
    names = {"run": run, "tmp": tmp_path, "file": path, "case": min(outcomes(run))}
    for command in READ:
        words = [word.format(**names) for word in command]
        done = marked.run(*words)
        assert done.returncode in (0, ALSO.get(words[1], 0)), (
            words,
            done.stdout[-500:],
            done.stderr[-2000:],
        )
        assert done.stdout or done.stderr, words
        assert WARPS_LINE not in done.stderr, words
        assert BAR not in done.stderr, words


def test_a_conductor_that_serves_and_all_that_asks_it(marked, tmp_path):
    state = tmp_path / "state"
    noop = tmp_path / "noop.yaml"
    noop.write_text("campaign: small\nsimulator: noop\nmatrix: {repeat: [0, 1, 2]}\n")
    assert marked.run("conductor", "keygen", "--state", str(state)).returncode == 0
    conductor = marked.start("conductor", "serve", "--state", str(state))
    wait_for((state / "conductor.json").exists, "a conductor that listens")
    names = {"tmp": tmp_path, "noop": noop}
    for command in SERVED:
        if command[1] == "drain":
            marked.start("twin", "worker", "--state", str(state))
            names["worker"] = wait_for(lambda: next(iter(workers(marked, state)), ""), "a worker")
        words = [word.format(**names) for word in command]
        done = marked.run(*words, "--state", str(state))
        assert done.returncode == 0, (words, done.stdout[-500:], done.stderr[-2000:])
        if command[1] == "submit":
            names["waiting"] = wait_for(lambda: case_of(state / "small"), "a case")
    assert conductor.wait(PATIENCE_S) == 0


def case_of(folder):
    return min(outcomes(folder)) if (folder / "outcomes.json").exists() else ""


def workers(marked, state):
    done = marked.run("conductor", "status", "--state", str(state), "--output", "json")
    return [worker["id"] for worker in json.loads(done.stdout)["workers"]]
