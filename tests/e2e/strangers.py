"""People who reach a port of ours without the key: they mind no rule and use Zenoh themselves."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path

import zenoh

from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import MemberKey, load_key
from twin.fabric.keys.roles import Role

SILENCE_S = 2.0
"""How long somebody waits for an answer that must not come."""


class Stranger:
    """A Zenoh session with certificates of its own choice, or with none."""

    def __init__(self, endpoint: str, tls: dict[str, object], patience_s: float = 0.5) -> None:
        """Try to get in for ``patience_s``; with the key it takes 5 ms where nobody else works."""
        config = zenoh.Config()
        for name, value in {
            "mode": "client",
            "namespace": "twin",
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": int(1000 * patience_s),
            "scouting/multicast/enabled": False,
            "transport/link/tls": tls,
        }.items():
            config.insert_json5(name, json.dumps(value))
        try:
            self._session: zenoh.Session | None = zenoh.open(config)
        except zenoh.ZError:
            self._session = None

    @property
    def inside(self) -> bool:
        """Whether it got a session."""
        return self._session is not None

    def answers(self, asked: Sequence[tuple[str, bytes]], wait_s: float) -> list[list[bytes]]:
        """What comes back for each of several requests (key, payload), all under way at once."""
        assert self._session is not None
        under_way = [self._session.get(key, payload=data, timeout=wait_s) for key, data in asked]
        return [
            [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
            for replies in under_way
        ]

    def close(self) -> None:
        """Go away."""
        if self._session is not None:
            self._session.close()


def options_of(key: MemberKey) -> dict[str, object]:
    """Zenoh's TLS options of somebody who holds ``key``."""
    return _options(key.authority, key.certificate, key.private)


def certificates_on(keys: Path, folder: Path) -> dict[str, dict[str, object]]:
    """Kind of stranger -> its TLS options, with what can be seen of the real ``keys``."""
    real = load_key(keys, Role.viewer)
    own = load_key(make_keys(folder / "strangers"), Role.admin)
    return {
        "plain": {},
        "no certificate": _options(real.authority),
        "own authority": _options(own.authority, own.certificate, own.private),
        "own certificate": _options(real.authority, own.certificate, own.private),
    }


def _options(authority: bytes, certificate: bytes = b"", private: bytes = b"") -> dict[str, object]:
    found: dict[str, object] = {
        "root_ca_certificate_base64": base64.b64encode(authority).decode(),
        "verify_name_on_connect": False,
    }
    if certificate:
        found["enable_mtls"] = True
        found["connect_certificate_base64"] = base64.b64encode(certificate).decode()
        found["connect_private_key_base64"] = base64.b64encode(private).decode()
    return found
