"""What counts as this host's loopback, and what is refused to be plain."""

import re
import socket

import pytest

from twin.base.errors import UsageError
from twin.fabric import endpoint as endpoints
from twin.fabric.address import check_free
from twin.fabric.endpoint import (
    allow_plain,
    check_endpoint,
    check_protected,
    demand_keys,
    is_exposed,
    is_loopback,
    to_listen,
)

HERE = ["tcp/127.0.0.1:0", "tcp/127.8.9.1:7447", "tcp/[::1]:0", "tcp/localhost:7447"]
BEYOND = [
    "tcp/0.0.0.0:0",
    "tcp/[::]:0",
    "tcp/:::0",
    "tcp/10.1.2.3:7447",
    "tcp/[fe80::1%eth0]:7447",
    "tcp/login1:7447",
    "tcp/localhost.example.org:7447",
    "tcp/127.1:7447",
    "tcp/[::ffff:127.0.0.1]:7447",
]


@pytest.mark.parametrize("endpoint", HERE)
def test_loopback_may_be_plain(endpoint):
    assert is_loopback(endpoint)
    assert to_listen(endpoint, keyed=False) == endpoint
    check_protected(endpoint, keyed=False)


@pytest.mark.parametrize("endpoint", BEYOND[:2] + BEYOND[3:])
def test_beyond_loopback_is_never_plain(endpoint):
    assert not is_loopback(endpoint)
    assert to_listen(endpoint, keyed=False) == "tls" + endpoint[3:]
    for keyed in (True, False):
        with pytest.raises(UsageError, match=r"plain TCP is for this host's loopback only; use tl"):
            check_protected(endpoint, keyed=keyed)


@pytest.mark.parametrize("endpoint", [*HERE, *BEYOND[:2]])
def test_plain_beyond_loopback_is_for_who_typed_it_and_has_no_key(endpoint, monkeypatch):
    beyond = endpoint in BEYOND
    assert is_exposed(endpoint) is beyond
    if beyond:
        with pytest.raises(UsageError, match="or type --insecure: whoever reaches it may then"):
            check_protected(endpoint, keyed=False)
    monkeypatch.setattr(endpoints, "_plain_allowed", False)  # put back afterwards
    allow_plain()
    assert to_listen(endpoint, keyed=False) == endpoint
    check_protected(endpoint, keyed=False)
    assert to_listen(endpoint, keyed=True) == "tls" + endpoint[3:], "a key still means TLS"
    if beyond:
        with pytest.raises(UsageError, match=r"with --key FILE \(`conductor keygen` makes one\)$"):
            check_protected(endpoint, keyed=True)
    with pytest.raises(UsageError, match="needs a key"):
        check_protected("tls/10.1.2.3:7447", keyed=False)


@pytest.mark.parametrize("endpoint", HERE)
def test_commands_do_not_trust_loopback_unless_told_to(endpoint, monkeypatch):
    """Every user of a host reaches it: one may command us there, or pose as who does."""
    for name in ("_plain_allowed", "_keys_demanded"):
        monkeypatch.setattr(endpoints, name, False)  # put back afterwards
    demand_keys()
    assert to_listen(endpoint, keyed=False) == "tls" + endpoint[3:]
    with pytest.raises(UsageError, match=r"any user of this host may pose .* type --insecure$"):
        check_protected(endpoint, keyed=False)
    allow_plain()
    assert to_listen(endpoint, keyed=False) == endpoint
    check_protected(endpoint, keyed=False)


@pytest.mark.parametrize("endpoint", HERE)
def test_with_a_key_loopback_is_tls_too(endpoint):
    assert to_listen(endpoint, keyed=True) == "tls" + endpoint[3:]


@pytest.mark.parametrize("endpoint", ["tls/[::1]:7447", "tls/[fd00::1]:0"])
def test_what_zenoh_cannot_do_is_said(endpoint):
    with pytest.raises(UsageError, match="TLS does not work with IPv6 addresses"):
        check_protected(endpoint, keyed=True)
    check_protected("tls/[::]:7447", keyed=True)


def test_tls_needs_a_key():
    with pytest.raises(UsageError, match=r"give --state FOLDER .* or --key FILE or TWIN_KEY"):
        check_protected("tls/127.0.0.1:7447", keyed=False)
    check_protected("tls/10.1.2.3:7447", keyed=True)


@pytest.mark.parametrize(
    "endpoint",
    [
        BEYOND[2],
        "tcp/10.0.0.1:7447,tcp/127.0.0.1:0",
        "tcp/127.0.0.1#iface=eth0:7447",
        "tcp/127.0.0.1?x:7447",
        "tcp/127.0.0.1/:7447",
        "tcp/127.0.0.1:٣",
        "tcp/127.0.0.1:²",
        "quic/127.0.0.1:7447",
        "TLS/127.0.0.1:7447",
        "tcp/127.0.0.1 :7447",
    ],
)
def test_what_zenoh_could_read_otherwise_is_no_endpoint(endpoint):
    with pytest.raises(UsageError, match="expected tcp/HOST:PORT or tls/HOST:PORT"):
        check_endpoint(endpoint)


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]", "localhost"])
def test_an_address_is_free_until_somebody_listens_there(host):
    family = socket.AF_INET6 if host == "[::1]" else socket.AF_INET
    with socket.socket(family) as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("::1" if host == "[::1]" else "127.0.0.1", 0))
        endpoint = f"tls/{host}:{taken.getsockname()[1]}"
        taken.listen()
        if host != "localhost":  # which may stand for both
            with pytest.raises(UsageError, match=f"{re.escape(endpoint)}: address already in use"):
                check_free(endpoint)
        with socket.create_connection(taken.getsockname()[:2]) as near:
            far, _ = taken.accept()
            far.close()  # what remains of it waits for a minute
            assert near.recv(1) == b""
    check_free(endpoint)
    check_free(endpoint)


def test_what_is_no_address_of_this_host_is_named():
    for endpoint, reason in (
        ("tcp/192.0.2.1:0", "Cannot assign requested address"),
        ("tcp/no-such-host.invalid:0", "[A-Z]"),
    ):
        with pytest.raises(UsageError, match=f"{endpoint}: cannot listen: {reason}") as error:
            check_free(endpoint)
        assert "give an address of this host with --listen" in str(error.value)
