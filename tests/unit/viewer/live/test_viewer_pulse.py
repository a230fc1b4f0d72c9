"""The conductor's status and events as plots and lines."""

from viewer.live.pulse import LINES_MAX, WORKERS_MAX, Pulse
from viewer.recording import naming


def status(left, workers=()):
    return {
        "campaigns": {"demo": {"cases": 10, "left": left, "leased": 2}},
        "workers": [{"id": w, "present": True, "held": 1} for w in workers],
    }


def scalar(logged, path):
    found = [archetype for p, archetype in logged if p == path]
    return found[-1].scalars.as_arrow_array().to_pylist()[0] if found else None


def lines(logged):
    return [a.text.as_arrow_array().to_pylist()[0] for p, a in logged if p == naming.EVENTS]


def test_throughput_over_the_latest_minute():
    pulse = Pulse()
    pulse.status(status(10), 0.0)
    assert scalar(pulse.take(), naming.THROUGHPUT) is None, "nothing can be said yet"
    pulse.status(status(8), 30.0)
    assert scalar(pulse.take(), naming.THROUGHPUT) == 4.0
    pulse.status(status(8), 90.0)
    pulse.status(status(8), 91.0)
    assert scalar(pulse.take(), naming.THROUGHPUT) == 0.0
    pulse.status(status(10), 92.0)
    assert scalar(pulse.take(), naming.THROUGHPUT) is None, "another conductor"


def test_the_latest_status_counts_and_is_taken_once():
    pulse = Pulse()
    pulse.status(status(10, ["a"]), 0.0)
    pulse.status(status(9, ["a", "b.c"]), 1.0)
    logged = pulse.take()
    assert scalar(logged, naming.RUNNING) == 2
    assert scalar(logged, naming.WORKERS_PRESENT) == 2
    plots = {path for path, _ in logged if path.startswith(f"{naming.WORKERS}/")}
    assert len(plots) == 2
    assert pulse.take() == []


def test_not_every_worker_has_a_plot():
    pulse = Pulse()
    pulse.status(status(10, [f"w{i}" for i in range(WORKERS_MAX + 5)]), 0.0)
    logged = pulse.take()
    plots = {path for path, _ in logged if path.startswith(f"{naming.WORKERS}/")}
    assert len(plots) == WORKERS_MAX
    assert scalar(logged, naming.WORKERS_PRESENT) == WORKERS_MAX + 5


def test_events_are_sentences():
    result = {"campaign": "c", "case": "x", "verdict": "pass", "outcome": "verdict"}
    pulse = Pulse()
    for fact in (
        {"fact": "worker_joined", "worker": "w", "device_class": "cpu:avx2", "slots": 2},
        {"fact": "committed", "result": {**result, "reasons": ["came to rest"]}},
        {"fact": "attempt_ended", "campaign": "c", "case": "x", "reason": "crash", "detail": ""},
        {"fact": "case_ended", "campaign": "c", "case": "x", "outcome": "cancelled", "reason": "r"},
        {"fact": "leased", "campaign": "c", "case": "x"},
        {"fact": "of the future"},
    ):
        pulse.event(fact)
    assert lines(pulse.take()) == [
        "worker w joined (cpu:avx2, 2 slots)",
        "c/x pass: came to rest",
        "c/x attempt ended without a result: crash",
        "c/x cancelled: r",
    ]


def test_a_flood_leaves_the_latest():
    pulse = Pulse()
    for index in range(LINES_MAX + 3):
        pulse.say(f"line {index}")
    told = lines(pulse.take())
    assert len(told) == LINES_MAX
    assert told[-1] == f"line {LINES_MAX + 2}"
    assert pulse.left_out == 3


def test_workers_that_are_not_here_are_not_counted():
    pulse, found = Pulse(), status(9, ["a", "b", "c"])
    found["workers"][1]["present"] = False
    pulse.status(found, 1.0)
    logged = pulse.take()
    assert scalar(logged, naming.WORKERS_PRESENT) == 2
    assert {p for p, _ in logged if p.startswith(f"{naming.WORKERS}/")} == {
        "workers/a",
        "workers/c",
    }
