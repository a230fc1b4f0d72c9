"""Lines of Zenoh become sentences, each once in a while."""

import pytest

from twin.fabric.refusals import PERIOD_S, Refusals, reason_of

HEAD = "\x1b[2m2026-11-22T00:25:31.0Z\x1b[0m \x1b[33m WARN\x1b[0m acc-0 zenoh_link_tls::unicast: "
HINT = ". Hint: increase the system open file limit."


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ("peer sent no certificates", "it showed no key"),
        ("invalid peer certificate: UnknownIssuer", "its key is of another fabric or rig"),
        ("received fatal alert: UnknownCA", "its key is of another fabric or rig"),
        ("invalid peer certificate: certificate expired: verification time 1", "has expired"),
        ("received corrupt message of type InvalidContentType", "it does not speak TLS"),
        ("something new", "the handshake failed: something new"),
        ("a name\x1b[2J\rall is well", r"failed: a name\x1b[2J\rall is well"),
    ],
)
def test_reasons(said, reason):
    assert reason_of(HEAD + said + HINT).endswith(reason)


@pytest.mark.parametrize(
    "line", ["", "conductor serves", f"{HEAD}Skipping name verification of TLS server"]
)
def test_other_lines_say_nothing(line):
    assert reason_of(line) == ""


def test_a_flood_is_counted():
    refusals, line = Refusals(), f"{HEAD}peer sent no certificates{HINT}"
    sentence = "refused a connection: it showed no key"
    assert refusals.take(line, 0.0) == sentence
    assert [refusals.take(line, float(n)) for n in range(1, 10)] == [""] * 9
    assert refusals.take(line, PERIOD_S) == f"{sentence} (9 more before)"
    assert refusals.take(f"{HEAD}received fatal alert: UnknownCA{HINT}", 1.0)
    for number in range(1000):
        refusals.take(f"{HEAD}reason {number}{HINT}", 2.0)
    assert len(refusals._said_s) <= 101
