"""A hand on running cases of a real rig: what it changes, and that nobody else notices."""

import asyncio
import contextlib
import json
import math
import os
import pty
import signal
import subprocess
import sys
import threading

import pytest
from processes import MARK, PATIENCE_S, committed, complete, outcomes, suspended, wait_for
from test_conductor_restart import serve

from conductor.records.fingerprint import fingerprint
from devkit.client import AsyncClient, Client, running_cases
from schemas.wire.interventions import JOURNAL_FILE
from twin.base.errors import TwinError, UnreachableError, UsageError
from twin.fabric.interventions import find_in_rig
from twin.fabric.zenoh_bus import open_bus
from twin.rig.interventions.journal import read_journal

EARLY_TICK = 20
"""Of the forty of a case; half of them are steered."""


def caught(state, but=(), before_tick=math.inf):
    """A hand on some running case, which stands still; those that came further are let go."""

    def catch():
        for found in running_cases(run=state):
            if found.case in but:
                continue
            try:
                case = Client(found.case, run=state)
            except UsageError:
                continue  # it has just ended
            try:
                if case.pause() < before_tick:
                    return case
                case.resume()
            except UsageError:
                pass
            case.close()
        return None

    return wait_for(catch, "a case to be caught")


@contextlib.contextmanager
def slowed(stack):
    """A stack gets a tenth of the time during the block: its cases, which take a fraction of a
    second, can be caught on a busy machine too."""
    done = threading.Event()

    def brake():
        while not done.wait(0.005):
            with suspended([stack]):
                done.wait(0.05)

    thread = threading.Thread(target=brake)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def reached(case, tick):
    wait_for(lambda: case.look().tick >= tick, f"tick {tick} of {case.state.case}")
    return case.state


def test_one_case_is_steered_another_paused_and_all_verdicts_stay(marked, quiet, tmp_path):
    state = tmp_path / "state"
    campaign = state / "chaos-16"
    conductor = serve(marked, state)
    marked.run("conductor", "submit", "chaos-16", "--state", str(state))
    worker = marked.start("twin", "worker", "--state", str(state), "--slots", "2")
    stack = marked.one("devkit", "host")
    with contextlib.ExitStack() as hands:
        with slowed(stack):
            case = hands.enter_context(caught(state, before_tick=EARLY_TICK))
            other = hands.enter_context(caught(state, but=[case.state.case]))
        name, still = case.state.case, other.state.case
        before, held = case.look(), other.look()
        assert before.paused
        assert before.changes == held.changes == 0
        # Both slots stand still, for as long as somebody wants: no lease ends, no deadline comes.
        explain = ("conductor", "explain", "chaos-16", name, "--state", str(state))
        wait_for(lambda: "it keeps its verdict" in marked.run(*explain).stdout, "the word of it")
        assert case.look().tick == before.tick
        # The other slot goes on, and takes one case after the other.
        other.resume()
        done = committed(campaign)
        wait_for(lambda: committed(campaign) >= done + 3, "three more cases")
        assert case.look().tick == before.tick
        _steered(marked, case, state, name)
        assert asyncio.run(_async_look(state, name)).changes == case.state.changes
        wait_for(lambda: "no verdict" in marked.run(*explain).stdout, "the word of it")
        case.resume()
        wait_for(lambda: complete(campaign), "the end of the campaign")
        with pytest.raises(TwinError, match=r"ended|does not run|does not answer"):
            case.pause()
    told = marked.run(*explain).stdout
    for child, code in ((worker, 0), (conductor, 1)):  # cases of two seconds end in no pass
        child.send_signal(signal.SIGTERM)
        assert child.wait(PATIENCE_S) == code
    rows = outcomes(campaign)
    assert (rows[name]["attempts"], len(rows[name]["steered"])) == (2, 1)
    assert rows[name]["attempt_dir"].endswith("/attempt-2")
    assert "no verdict of attempt 1: steered by hand" in told
    assert (rows[still]["attempts"], rows[still]["steered"]) == (1, [])
    assert not rows[name]["charges"]
    assert fingerprint(campaign).sha256 == quiet["fingerprint"]
    _reenacted(marked, campaign / "cases" / name / "attempt-1", tmp_path)


def _steered(marked, case, state, name):
    """Everything that a hand can do, through every way in."""
    tick = case.state.tick
    assert case.step(3) == tick
    assert reached(case, tick + 3).tick == tick + 3
    where = ("--run", str(state / "chaos-16"))
    done = marked.run("viewer", "set", name, "weather=heavy_snow", "hour=22.5", *where)
    assert done.returncode == 0, done.stderr
    assert f"{name}: environment at tick {tick + 3}; this attempt gives" in done.stdout
    shown = marked.run("viewer", "look", name, *where, "--output", "json")
    found = json.loads(shown.stdout)
    assert (found["weather"], found["time_of_day_min"], found["paused"]) == (
        *("heavy_snow", 22.5 * 60),
        True,
    )
    walker = next(o for o in case.look().objects if o.kind == "pedestrian" and o.present)
    assert walker.name
    moved = marked.run("viewer", "set", name, f"object.{walker.name}.y_m=2.5", *where)
    assert moved.returncode == 0, moved.stderr
    now = next(o for o in case.look().objects if o.object == walker.object)
    assert (now.y_m, now.by_hand) == (2.5, True)
    wrong = marked.run("viewer", "set", name, "object.nobody=free", *where)
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert "object 'nobody': not in this case" in wrong.stderr
    case.remove(walker.object)
    spot = {"x_m": case.state.x_m + 25.0, "y_m": 3.0, "speed_mps": 1.0, "yaw_rad": -1.5}
    assert case.spawn("pedestrian", **spot) == walker.object
    case.set(lights="low+left", x_m=case.state.x_m - 2.0, y_m=0.1, yaw_deg=1.0, speed_mps=9.0)
    case.drive(throttle=0.4, steering_rad=0.05)
    assert case.look().taken_over
    case.step(5)
    reached(case, tick + 8)
    case.drive(brake=1.0)
    case.step(5)
    assert reached(case, tick + 13).brake > 0.0
    assert case.release() == tick + 13
    assert not case.look().taken_over
    _beside_the_rig(marked, case)
    _by_keyboard(marked, case, where)
    _refused(marked, case, where)


def _beside_the_rig(marked, case):
    """The rig's own session is its stack's, and a stack may not steer."""
    line = marked.one("devkit", "host").cmdline()
    told = {name: line[line.index(f"--{name}") + 1] for name in ("connect", "rig", "namespace")}
    bus = open_bus("peer", connect=[told["connect"]], namespace=told["namespace"])
    with pytest.raises(UnreachableError, match="does not answer"):
        find_in_rig(bus, told["rig"], case.state.case)
    bus.close()


def _by_keyboard(marked, case, where):
    """`viewer takeover` in a terminal: keys are pedals, N is a tick, Q gives back."""
    terminal, theirs = pty.openpty()
    child = subprocess.Popen(
        [sys.executable, "-m", "viewer", "takeover", case.state.case, *where],
        stdin=theirs,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, MARK: marked.mark, "TMPDIR": str(marked.temporary)},
    )
    marked.children.append(child)
    try:
        wait_for(lambda: case.look().taken_over, "the driver")
        tick = case.state.tick
        os.write(terminal, b"ww\x1b[Dnn")
        wait_for(lambda: case.look().tick == tick + 2, "two ticks")
        assert case.state.throttle > 0.0
        assert case.state.steering_rad > 0.0
        os.write(terminal, b"q")
        assert child.wait(PATIENCE_S) == 0
        assert "given back" in child.stderr.read().decode()
        assert not case.look().taken_over
    finally:
        os.close(terminal)
        os.close(theirs)


def _refused(marked, case, where):
    """What cannot be done says so and changes nothing."""
    changes = case.look().changes
    for wrong, words in (
        (lambda: case.set(weather="fogg"), "weather 'fogg': allowed: clear"),
        (lambda: case.set(wether="clear"), "unknown setting 'wether'; did you mean 'weather'"),
        (lambda: case.set(gnss_noise=2.0), "the campaign has no sensors.gnss"),
        (lambda: case.spawn("horse", x_m=0.0, y_m=0.0), "the scene has bus, car, cyclist"),
        (lambda: case.drive(throttle=1.5), "takeover: throttle: given 1.5"),
        (lambda: case.move(99, x_m=0.0, y_m=0.0), "object: given 99"),
    ):
        with pytest.raises(UsageError, match=words):
            wrong()
    assert case.look().changes == changes
    for arguments, words in (
        (("set", "nobody", "hour=3", *where), "no case 'nobody' in chaos-16"),
        (("set", case.state.case, "hour=25", *where), "hour: given 25"),
        (("takeover", case.state.case, *where), "takeover reads the keyboard of a terminal"),
        (("pause", case.state.case), "give one of --connect"),
    ):
        done = marked.run("viewer", *arguments)
        assert done.returncode == 2, done.stderr
        assert words in done.stderr
        assert len(done.stderr.splitlines()) == 1


async def _async_look(state, name):
    async with AsyncClient(name, run=state) as case:
        return await case.look()


def _reenacted(marked, attempt, tmp_path):
    """The journal alone gives the attempt's values again, in a rig of another size."""
    _, entries, end = read_journal(attempt)
    assert len(entries) >= 10
    assert end is not None
    again = marked.run("twin", "reenact", str(attempt), "--slots", "3")
    assert again.returncode == 0, again.stdout + again.stderr
    assert "the same values, to the last bit" in again.stdout
    # With one change less they are others, so the comparison means something.
    lines = (attempt / JOURNAL_FILE).read_text().splitlines()
    torn = tmp_path / JOURNAL_FILE
    torn.write_text("\n".join(line for line in lines if '"takeover"' not in line))
    other = marked.run("twin", "reenact", str(torn))
    assert other.returncode == 1, other.stdout + other.stderr
    assert "other values: the attempt had" in other.stdout
