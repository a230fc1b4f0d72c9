"""The Prometheus endpoint: a scrape reads the conductor's status; user errors are one line."""

from __future__ import annotations

import socket
import urllib.request
from pathlib import Path

import pytest
from conductor_bench import hello, next_of, result, submit
from unit.conductor.ops_bench import running_hub, serving

from conductor.serve.metrics import parse_address, serving_metrics
from twin.base.errors import UsageError


def scrape(url: str) -> dict[str, float]:
    with urllib.request.urlopen(url) as answer:
        lines = answer.read().decode().splitlines()
    return {k: float(v) for k, v in (s.rsplit(" ", 1) for s in lines if not s.startswith("#"))}


def test_a_scrape(tmp_path: Path) -> None:
    with (
        running_hub() as hub,
        serving(tmp_path, hub) as conductor,
        serving_metrics("127.0.0.1:0", conductor.snapshot) as url,
    ):
        conductor.request(submit())
        conductor.request(hello())
        leases = conductor.request(next_of(worker="w1", seq=1, k=2)).leases
        conductor.request(
            next_of(worker="w1", seq=2, k=0, results=[result(leases[0])], held=[leases[1].token])
        )
        found = scrape(url)
    prefix = "drivetwin_conductor"
    assert found[f'{prefix}_cases{{campaign="alpha",state="passed"}}'] == 1
    assert found[f'{prefix}_cases{{campaign="alpha",state="leased"}}'] == 1
    assert found[f'{prefix}_cases{{campaign="alpha",state="waiting"}}'] == 2
    assert found[f'{prefix}_disagreements{{campaign="alpha"}}'] == 0
    assert found[f"{prefix}_leases"] == 1
    assert found[f'{prefix}_workers{{present="true"}}'] == 1
    assert found[f"{prefix}_requests_total"] == 4
    assert found[f"{prefix}_refused_total"] == 0
    assert found[f"{prefix}_commits_total"] >= 3
    assert found[f"{prefix}_journal_seconds_total"] > 0
    assert found[f"{prefix}_epoch"] == 1


def test_before_the_start_there_is_nothing() -> None:
    with serving_metrics("127.0.0.1:0", dict) as url:
        assert scrape(url) == {}


def test_a_port_in_use_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        with (
            pytest.raises(UsageError, match="already in use") as caught,
            serving_metrics(address, dict),
        ):
            pass
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("127.0.0.1:9100", ("127.0.0.1", 9100)),
        ("9100", ("127.0.0.1", 9100)),
        (":9100", ("127.0.0.1", 9100)),
        ("0.0.0.0:0", ("0.0.0.0", 0)),
        ("[::1]:65535", ("::1", 65535)),
    ],
)
def test_addresses(text: str, expected: tuple[str, int]) -> None:
    assert parse_address(text) == expected


@pytest.mark.parametrize("text", ["", "localhost", "127.0.0.1:", "127.0.0.1:65536", "h:-1"])
def test_bad_addresses(text: str) -> None:
    with pytest.raises(UsageError, match=r"expected HOST:PORT"):
        parse_address(text)
