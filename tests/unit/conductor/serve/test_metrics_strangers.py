"""The Prometheus endpoint: who may ask for it, by which name, and where it may be."""

from __future__ import annotations

import http.client
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from conductor.serve.metrics import checked_address, serving_metrics
from twin.base.errors import UsageError
from twin.fabric import endpoint


def ask(url: str, host: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", urlsplit(url).port or 0, timeout=60)
    try:
        connection.request("GET", "/metrics", headers={"Host": host})
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:9100", "[::1]:9100", "LOCALHOST:1"])
def test_by_names_of_loopback(host: str) -> None:
    with serving_metrics("127.0.0.1:0", dict) as url:
        assert ask(url, host)[0] == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:9100", "localhost.evil.example", "", "10.0.0.1", "\x1b[2J"],
)
def test_no_other_name_leads_there(host: str) -> None:
    with serving_metrics("127.0.0.1:0", dict) as url:
        status, text = ask(url, host)
    assert status == 403
    assert text.startswith("asked for ")
    assert "allowed: localhost, 127.0.0.1, [::1]" in text
    assert len(text.splitlines()) == 1
    assert text.strip().isprintable()


def test_beyond_loopback_by_its_names_and_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endpoint, "_plain_allowed", False)  # put back afterwards
    endpoint.allow_plain()
    with serving_metrics("0.0.0.0:0", dict) as url:
        for host in (socket.gethostname(), "10.0.0.1:9100", "localhost"):
            assert ask(url, host)[0] == 200, host
        assert ask(url, "evil.example")[0] == 403


@pytest.mark.parametrize("address", ["0.0.0.0:0", "[::]:0", "10.0.0.1:9100", "node1:9100"])
def test_beyond_loopback_insecure_has_to_be_typed(address: str) -> None:
    with pytest.raises(UsageError, match="type --insecure") as caught:
        checked_address(address)
    assert str(caught.value).startswith(f"--metrics {address}: ")
    assert len(str(caught.value).splitlines()) == 1


def test_serve_says_so_before_it_makes_anything(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "conductor", "serve", "--state", "s", "--metrics", "0.0.0.0:0"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr.startswith("conductor: --metrics 0.0.0.0:0: plain HTTP beyond")
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
