"""Ticks by the wall clock, with a clock of our own: nothing sleeps here."""

from types import SimpleNamespace

import pytest

from schemas import SCHEMA_VERSION
from schemas.messages import Command, Commands, Frame, PerceptionCost, Tick
from schemas.wire.realtime import Realtime
from twin.base.errors import InfrastructureError
from twin.fabric.drive import RESEND_S, Outgoing
from twin.rig.pacing import BEHIND_S, Pacer, TickLog
from twin.rig.realtime import RealtimeLink

PERIOD_S = 0.05


class Wall:
    """A clock that goes on only when somebody waits."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


class StackOn:
    """The simulator's end, with a stack that takes ``takes_s`` to answer."""

    def __init__(self, wall, takes_s):
        self.wall, self.takes_s = wall, takes_s
        self.published = []
        self.answers = []

    def publish(self, tick, sensors, episodes):
        self.published.append((tick, sensors))
        begun = max([self.wall.now_s, *(ready for ready, _ in self.answers)])
        cost = PerceptionCost("test", 1, 0.001)
        command = Command(0, tick.token[0], tick.tick[0], tick.tick[0] / 1000, 0.0, 0.0)
        answer = Commands(SCHEMA_VERSION, tick.seq, [command], costs=[cost], wall_s=self.takes_s)
        self.answers.append((begun + self.takes_s, answer))

    def exchange(self, seq, tick, sensors, episodes, on_wait):
        self.publish(tick, sensors, episodes)
        ready, answer = self.answers.pop()
        self.wall.now_s = max(self.wall.now_s, ready)
        return answer

    def answered(self, seq, timeout_s):
        until = self.wall.now_s + timeout_s
        while self.answers and self.answers[0][0] <= until:
            ready, answer = self.answers.pop(0)
            self.wall.now_s = max(self.wall.now_s, ready)
            if answer.seq == seq:
                return answer
        self.wall.now_s = until
        return None


def tick_of(seq, tick, sensors=("vehicle",)):
    return Tick(SCHEMA_VERSION, seq, [True], [7], [tick], [tick * 50_000_000], list(sensors), 0)


def reading(name, seq, tick):
    frame = Frame(
        v=SCHEMA_VERSION,
        type=name,
        seq=seq,
        active=[True],
        case=["c"],
        token=[7],
        tick=[tick],
        sim_time_ns=[tick * 50_000_000],
        dtype="|u1",
        shape=[1],
        encoding="",
    )
    return Outgoing(name, frame, b"%c" % tick)


class Case:
    """A case of ``link``: camera every second tick."""

    def __init__(self, takes_s, works_s=0.0):
        self.wall = Wall()
        self.end = StackOn(self.wall, takes_s)
        self.link = RealtimeLink(self.end, 50_000_000, self.wall)
        self.works_s = works_s
        self.seq = 100
        self.tick = 0

    def go(self, ticks):
        """The commands of so many ticks."""
        return [self.step() for _ in range(ticks)]

    def step(self):
        names = ("vehicle", "camera") if self.tick % 2 == 0 else ("vehicle",)
        sensors = [reading(name, self.seq, self.tick) for name in names]
        episodes = [SimpleNamespace()] if self.tick == 0 else []
        now = tick_of(self.seq, self.tick, names)
        found = self.link.exchange(self.seq, now, sensors, episodes, lambda: None)
        self.seq, self.tick = self.seq + 1, self.tick + 1
        self.wall.now_s += self.works_s
        return found


def ages(case):
    """Of every tick after the first."""
    return [float(line.split(",")[2]) for line in case.link.finish().table.splitlines()[1:]]


def test_a_quick_stack_is_obeyed_one_tick_later():
    case = Case(takes_s=0.004)
    commands = case.go(41)
    assert ages(case) == [50.0] * 40
    went = case.link.finish().summary
    assert went == Realtime(40, 0, 0, 50.0, 50.0, 50.0, 1.0)
    assert went.kept_up
    # The command of tick n acts at n + 1, and says so: the simulator checks it like any other.
    assert [c.commands[0].tick for c in commands] == list(range(41))
    assert [c.commands[0].throttle for c in commands[1:4]] == [0.0, 0.001, 0.002]
    assert case.wall.now_s == pytest.approx(100.004 + 40 * PERIOD_S)


def test_a_slow_stack_gets_the_newest_readings_and_its_commands_are_held():
    case = Case(takes_s=0.22)
    commands = case.go(41)
    rows = [line.split(",") for line in case.link.finish().table.splitlines()[1:]]
    new = [float(age) for _, _, age, is_new, _ in rows if is_new == "1"]
    assert len(new) == 7
    # Camera readings of even ticks that it was too busy for are not lost: they age.
    assert all(250.0 <= age <= 300.0 for age in new)
    assert max(ages(case)) <= 500.0
    went = case.link.finish().summary
    assert went.overruns == 0
    assert went.dropped == sum(row[4] == "0" for row in rows) == 32
    given = [(tick.tick[0], {s.name: s.frame.tick[0] for s in sensors})
             for tick, sensors in case.end.published[1:]]  # fmt: skip
    assert given[:3] == [
        (1, {"vehicle": 1}),
        (6, {"vehicle": 6, "camera": 6}),
        (11, {"vehicle": 11, "camera": 10}),
    ]
    assert all(s.frame.seq == tick.seq for tick, sensors in case.end.published for s in sensors)
    assert all(tick.sensors == [s.name for s in sent] for tick, sent in case.end.published[1:])
    # Costs count once, for the tick at which the command is new.
    assert sum(bool(c.costs) for c in commands) == 1 + len(new)


def test_a_stack_that_hangs_does_not_stop_the_clock():
    case = Case(takes_s=0.01)
    case.go(2)
    case.end.takes_s = 1e6
    case.go(40)
    assert max(ages(case)) == 40 * 50.0
    # Asked again as in lockstep: a message may have been lost.
    again = [tick.seq for tick, _ in case.end.published].count(102)
    assert again == 1 + int(38 * PERIOD_S / RESEND_S)
    assert case.wall.now_s == pytest.approx(100.01 + 41 * PERIOD_S)


def test_a_machine_that_is_too_slow_is_named():
    case = Case(takes_s=0.01, works_s=0.1)
    case.go(21)
    went = case.link.finish().summary
    assert went.overruns == 20
    assert not went.kept_up
    assert went.factor == pytest.approx(0.5, abs=0.01)
    assert "100.0 % of the ticks overran: the machine was too slow" in went.told()


def test_a_short_hiccup_is_caught_up_and_a_long_one_is_not():
    case = Case(takes_s=0.01)
    case.go(5)
    case.wall.now_s += 0.12
    case.go(10)
    assert case.link.finish().summary.overruns == 2
    assert case.wall.now_s == pytest.approx(100.01 + 14 * PERIOD_S)
    case.wall.now_s += 5.0
    case.go(10)
    assert case.link.finish().summary.overruns == 3
    assert case.wall.now_s == pytest.approx(100.01 + 24 * PERIOD_S + 5.0 - PERIOD_S)


def test_the_first_tick_waits_for_a_stack_that_loads():
    case = Case(takes_s=30.0)
    case.go(1)
    case.end.takes_s = 0.01
    case.go(10)
    assert case.wall.now_s == pytest.approx(130.0 + 10 * PERIOD_S)
    assert case.link.finish().summary.overruns == 0


def test_a_new_case_starts_a_new_clock_and_a_new_log():
    case = Case(takes_s=0.22)
    case.go(4)
    case.tick = 0
    case.go(3)
    assert len(ages(case)) == 2
    assert ages(case) == [50.0, 100.0]


def test_a_wrong_tick_stays_wrong():
    case = Case(takes_s=0.01)
    case.go(2)
    ready, answer = case.end.answers[0]
    wrong = Command(0, 7, 5, 0.0, 0.0, 0.0)
    case.end.answers[0] = (ready, Commands(SCHEMA_VERSION, answer.seq, [wrong]))
    assert case.step().commands[0].tick == 2 + (5 - 1)


def test_a_stack_that_gives_up_ends_the_rig():
    case = Case(takes_s=0.01)
    case.go(2)

    def fails(seq, timeout_s):
        raise InfrastructureError("stack: out of ideas")

    case.end.answered = fails
    with pytest.raises(InfrastructureError, match="out of ideas"):
        case.step()


def test_the_limits_of_falling_behind():
    pacer = Pacer(PERIOD_S, 0.0)
    assert pacer.reach(1, PERIOD_S) == 0.0
    assert (pacer.overruns, pacer.slipped_s) == (0, 0.0)
    assert pacer.reach(2, 2 * PERIOD_S + BEHIND_S) == pytest.approx(-BEHIND_S)
    assert (pacer.overruns, pacer.slipped_s) == (1, 0.0)
    pacer.reach(3, 3 * PERIOD_S + BEHIND_S + 0.001)
    assert pacer.slipped_s == pytest.approx(BEHIND_S + 0.001)


def test_percentiles_are_values_that_occurred():
    log = TickLog(50_000_000)
    for tick in range(1, 201):
        log.add(tick, 0.0, 0, new=False, given=True)
    went = log.summary(Pacer(PERIOD_S, 0.0), 10.0)
    assert (went.age_p50_ms, went.age_p99_ms, went.age_max_ms) == (5000.0, 9900.0, 10_000.0)
    assert went.factor == 1.0
    assert TickLog(1).summary(Pacer(PERIOD_S, 0.0), 0.0).told().startswith(
        "clock realtime, not repeatable: no command was held"
    )  # fmt: skip
