"""Endpoints such as ``tcp/HOST:PORT``: which of them leave this host, and how they are spoken."""

from __future__ import annotations

import ipaddress

from twin.base.errors import UsageError

NAMESPACE = "twin"
"""Default of ``--namespace``."""

PROTOCOLS = ("tcp", "tls")
"""``tcp`` is plain, see :func:`allow_plain` and :func:`demand_keys`; ``tls`` needs a key."""

LOOPBACK = "tcp/127.0.0.1:0"
"""A free port that only this host reaches."""

SOCKET = "unixsock-stream"
"""Protocol of a socket in a rig's own folder, followed by ``/`` and its absolute path; nobody gives
one on a command line but a worker to its stack."""


LATER = "-"
"""Value of ``--connect`` for a stack's host that will be told later."""

_plain_allowed = False
_keys_demanded = False


def allow_plain() -> None:
    """Allow this process plain TCP anywhere from now on: somebody typed ``--insecure``.

    It holds for the process, because what it opens must not depend on which way the word took.
    """
    global _plain_allowed
    _plain_allowed = True


def plain_is_allowed() -> bool:
    """Whether :func:`allow_plain` was called."""
    return _plain_allowed


def demand_keys() -> None:
    """Forbid this process plain TCP on loopback, too, from now on, unless it is allowed:
    commands are careful, because every user of a host reaches its loopback."""
    global _keys_demanded
    _keys_demanded = True


def _may_be_plain(endpoint: str) -> bool:
    return _plain_allowed or (is_loopback(endpoint) and not _keys_demanded)


def is_exposed(endpoint: str) -> bool:
    """Whether others than this host could read and write there: plain TCP beyond loopback."""
    return not is_tls(endpoint) and not is_loopback(endpoint)


def check_endpoint(endpoint: str) -> None:
    """Raise UsageError unless ``endpoint`` looks like ``tcp/HOST:PORT`` or ``tls/HOST:PORT``."""
    protocol, host, port = _parts(endpoint)
    digits = port.isascii() and port.isdecimal()
    if protocol not in PROTOCOLS or not host or not digits or not _is_host(host):
        raise UsageError(
            f"endpoint '{endpoint}': expected tcp/HOST:PORT or tls/HOST:PORT, "
            "e.g. tcp/127.0.0.1:7447"
        )
    if int(port) > 65535:
        raise UsageError(f"endpoint '{endpoint}': port {port}, allowed: 0-65535")


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host without brackets, and port."""
    _, host, port = _parts(endpoint)
    return host.strip("[]"), int(port)


def is_tls(endpoint: str) -> bool:
    """Whether ``endpoint`` is spoken with TLS."""
    return endpoint.startswith("tls/")


def is_socket(endpoint: str) -> bool:
    """Whether ``endpoint`` is a socket in the file system; who may open it, the folder says."""
    return endpoint.startswith(f"{SOCKET}/")


def is_loopback(endpoint: str) -> bool:
    """Whether only this host can be meant; names other than ``localhost`` never count."""
    _, host, _ = _parts(endpoint)
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def to_listen(endpoint: str, *, keyed: bool) -> str:
    """``endpoint`` as it is listened on: with TLS beyond loopback, and wherever a key was given or
    is demanded; after :func:`allow_plain` as it stands.

    Raises:
        UsageError: it is no endpoint.
    """
    check_endpoint(endpoint)
    if keyed or not _may_be_plain(endpoint):
        return f"tls/{endpoint.partition('/')[2]}"
    return endpoint


def check_protected(endpoint: str, *, keyed: bool) -> None:
    """Raise UsageError if ``endpoint`` is TLS and there is no key, or plain beyond loopback and
    there is one, or plain where nobody typed ``--insecure`` though it has to be."""
    check_endpoint(endpoint)
    if is_tls(endpoint) and not keyed:
        raise UsageError(
            f"{endpoint}: needs a key of the fabric; give --state FOLDER (`viewer`: --run), which "
            "finds your own, or --key FILE or TWIN_KEY (`conductor invite` makes one)"
        )
    if is_tls(endpoint) and "[" in endpoint and "/[::]:" not in endpoint:
        # Zenoh 1.10 takes the brackets for a part of the server's name.
        raise UsageError(
            f"{endpoint}: TLS does not work with IPv6 addresses; use the host's name or IPv4 "
            "address, or [::] to listen on all interfaces"
        )
    if is_exposed(endpoint) and (keyed or not _plain_allowed):
        end = "" if keyed else ", or type --insecure: whoever reaches it may then read and command"
        raise UsageError(
            f"{endpoint}: plain TCP is for this host's loopback only; "
            f"use tls/{endpoint.partition('/')[2]} with --key FILE (`conductor keygen` makes one)"
            f"{end}"
        )
    if not is_tls(endpoint) and not keyed and not _may_be_plain(endpoint):
        raise UsageError(
            f"{endpoint}: plain TCP, where any user of this host may pose as the other side; give "
            "--state FOLDER (`viewer`: --run) or tls/ with --key FILE, or type --insecure"
        )


def _parts(endpoint: str) -> tuple[str, str, str]:
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    return protocol, host, port


def _is_host(host: str) -> bool:
    """A name or a bracketed IPv6 address: nothing that Zenoh would read as an option."""
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1].replace(":", "").replace("%", "")
    return all(c.isalnum() or c in "-._" for c in host)
