"""The bus over Zenoh, and the one place for its options."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import socket
import threading
from collections.abc import Callable, Sequence
from typing import Any, Literal

import zenoh

from twin.base.errors import InfrastructureError, TwinError, UnreachableError, UsageError
from twin.fabric.address import IN_USE
from twin.fabric.bus import Bus, Cancel, Respond, Sample
from twin.fabric.discovery import Target
from twin.fabric.endpoint import SOCKET, check_protected, is_socket, is_tls
from twin.fabric.keys.key_file import MemberKey, WrongRoleError
from twin.fabric.keys.rights import Act, access_control, may, refusal
from twin.fabric.keys.roles import Role

Mode = Literal["router", "client", "peer"]

ACCEPT_S = 3.0
"""How long somebody who connects may take to open a session; closing ours waits for it [s]."""


def open_bus(
    mode: Mode,
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    namespace: str = "twin",
    key: MemberKey | None = None,
    shared_memory: bool = False,
    connect_timeout_s: float = 10.0,
    connect_required: bool = True,
    message_bytes_max: int = 1 << 30,
    role_socket: tuple[str, Role] | None = None,
) -> Bus:
    """Open a session. Scouting is off: it hears only the endpoints it is given.

    Beyond loopback all is TLS in both directions: who does not hold a key hears nothing, and who
    holds one is let do what its role may.

    Args:
        mode: ``router`` for the conductor, ``client`` for those who connect to it, ``peer`` for
            the two ends of a rig.
        listen: endpoints such as ``tcp/127.0.0.1:0`` or ``tls/0.0.0.0:7447`` (0: a free port), or
            a rig's socket, where nobody may do more than a stack.
        connect: endpoints to connect to.
        namespace: prefix of every key; sessions of other namespaces hear nothing.
        key: what this process shows; needed for ``tls/`` endpoints.
        shared_memory: Zenoh's own shared memory; off, because a killed publisher leaks segments.
        connect_timeout_s: how long to try to connect before giving up [s].
        connect_required: False: open at once and keep trying in the background (peers only).
        message_bytes_max: of a larger message no more is kept in memory; it does not arrive, and
            nobody is told [bytes].
        role_socket: with a key, also listen on a Unix socket: its path, and the role of all who
            come through it.

    Raises:
        UsageError: a bad endpoint, plain TCP beyond loopback, an address that is in use, or
            another fabric at ``connect``.
        InfrastructureError: nobody answers at ``connect``.
    """
    for endpoint in [*listen, *connect]:
        if not is_socket(endpoint):
            check_protected(endpoint, keyed=key is not None)
    if connect_required:
        for endpoint in filter(is_tls, connect):
            from twin.fabric.handshake import greet  # late: it loads OpenSSL for Python

            # Nobody there yet: Zenoh keeps trying until its time-out.
            with contextlib.suppress(UnreachableError):
                greet(endpoint, key)
    listening = [*listen, *([] if role_socket is None else [f"{SOCKET}/{role_socket[0]}"])]
    config = session_config(
        mode,
        listen=listening,
        connect=connect,
        namespace=namespace,
        key=key,
        shared_memory=shared_memory,
        connect_timeout_s=connect_timeout_s,
        message_bytes_max=message_bytes_max,
    )
    _restrict(config, listen, namespace, key, role_socket)
    if not connect_required:
        config.insert_json5("connect/timeout_ms", "0")
        config.insert_json5("connect/exit_on_failure", "false")
    try:
        session, endpoints = open_session(config, listen)
    except zenoh.ZError as error:
        raise _explain(error, listen, connect, key, connect_timeout_s) from None
    return _ZenohBus(session, endpoints, key)


def join(target: Target, connect_timeout_s: float, mode: Mode = "client") -> Bus:
    """Open a session to a conductor, or with mode ``peer`` to a rig, that was found.

    Raises:
        UsageError: its key is another one, or it is not protected as it has to be.
        InfrastructureError: nobody answers there.
    """
    return open_bus(
        mode,
        connect=[target.endpoint],
        namespace=target.namespace,
        key=target.key,
        connect_timeout_s=connect_timeout_s,
    )


def router_count(bus: Bus) -> int:
    """Number of Zenoh routers to which a session of :func:`open_bus` is linked."""
    assert isinstance(bus, _ZenohBus)
    return len(bus._session.info.routers_zid())


def log_refusals() -> None:
    """Have Zenoh write a line to file descriptor 1 for every handshake that fails from now on."""
    zenoh.init_log_from_env_or("off,zenoh_link_tls=warn")


def _restrict(
    config: zenoh.Config,
    listen: Sequence[str],
    namespace: str,
    key: MemberKey | None,
    role_socket: tuple[str, Role] | None,
) -> None:
    """Let each of those who come do what its role may, and nothing else."""
    if key is not None:
        plain = "tcp" in json.loads(config.get_json("transport/link/protocols"))
        through = {SOCKET: role_socket[1]} if role_socket is not None else {}
        allowed = access_control(key.fabric, namespace, plain=plain, through=through)
        config.insert_json5("access_control", json.dumps(allowed))
    elif any(map(is_socket, listen)):
        allowed = access_control("", namespace, through={SOCKET: Role.stack})
        config.insert_json5("access_control", json.dumps(allowed))


def open_session(config: zenoh.Config, listen: Sequence[str]) -> tuple[zenoh.Session, list[str]]:
    """A session, and where it listens, with real port numbers.

    Raises:
        zenoh.ZError: it cannot listen or connect.
    """
    # Every connection of this host is looked at for it.
    looked_for = any(map(_is_free_port, listen))
    before = set(_listening()) if looked_for else set()
    session = zenoh.open(config)
    opened = [port for port in _listening() if port not in before] if looked_for else []
    return session, [_with_port(endpoint, opened) for endpoint in listen]


def session_config(
    mode: Mode,
    *,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    namespace: str = "",
    key: MemberKey | None = None,
    shared_memory: bool = False,
    connect_timeout_s: float = 10.0,
    message_bytes_max: int = 1 << 30,
    protocols: Sequence[str] = (),
) -> zenoh.Config:
    """Zenoh's options of a session of ours; see :func:`open_bus` for those of them that vary.

    Args:
        namespace: empty: keys are seen as they are.
        protocols: that are spoken beside those of the endpoints.
    """
    config = zenoh.Config()
    options: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/timeout_ms": int(connect_timeout_s * 1000),
        "connect/exit_on_failure": True,
        # Reconnect quickly: the default backs off to 4 s.
        "connect/retry": {
            "period_init_ms": 50,
            "period_max_ms": 500,
            "period_increase_factor": 2,
        },
        **({"namespace": namespace} if namespace else {}),
        "transport/link/rx/max_message_size": message_bytes_max,
        **({} if key is None else {"transport/link/tls": _tls(key)}),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        # A router waits this long for scouting, which is off.
        "scouting/delay": 0,
        "transport/link/protocols": sorted(
            {*protocols, *(endpoint.partition("/")[0] for endpoint in (*listen, *connect))}
        ),
        "transport/shared_memory/enabled": shared_memory,
        # A peer that is frozen or cut off is noticed after the transport lease (default 10 s).
        "transport/link/tx/lease": 4000,
        "transport/unicast/accept_timeout": int(ACCEPT_S * 1000),
    }
    for path, value in options.items():
        config.insert_json5(path, json.dumps(value))
    return config


def _tls(key: MemberKey) -> dict[str, Any]:
    """TLS in both directions, inline: Zenoh needs no files that could be left behind."""
    certificate = base64.b64encode(key.certificate).decode()
    private = base64.b64encode(key.private).decode()
    return {
        "root_ca_certificate_base64": base64.b64encode(key.authority).decode(),
        "enable_mtls": True,
        "listen_certificate_base64": certificate,
        "listen_private_key_base64": private,
        "connect_certificate_base64": certificate,
        "connect_private_key_base64": private,
        # Members move between hosts; they are known by the certificate's name, see roles.
        "verify_name_on_connect": False,
        "close_link_on_expiration": True,
    }


def _listening() -> list[int]:
    """Ports this process listens on; Zenoh does not tell which one it took for port 0."""
    ports = (_listening_port(int(name)) for name in os.listdir("/proc/self/fd"))
    return sorted(port for port in ports if port)


def _listening_port(descriptor: int) -> int:
    """Port at which an open file listens; 0: it does not, or is no socket of the network."""
    try:
        looked_at = socket.socket(fileno=descriptor)
    except OSError:
        return 0
    try:
        if looked_at.family not in (socket.AF_INET, socket.AF_INET6):
            return 0
        listens = looked_at.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
        return int(looked_at.getsockname()[1]) if listens else 0
    except OSError:  # another thread has closed it
        return 0
    finally:
        looked_at.detach()  # it is somebody else's, and stays open


def _is_free_port(endpoint: str) -> bool:
    """Whether it listens on a port that Zenoh chooses."""
    return endpoint.endswith(":0") and not is_socket(endpoint)


def _with_port(endpoint: str, opened: list[int]) -> str:
    if not _is_free_port(endpoint):
        return endpoint
    return f"{endpoint.rpartition(':')[0]}:{opened.pop(0)}"


def _explain(
    error: Exception,
    listen: Sequence[str],
    connect: Sequence[str],
    key: MemberKey | None,
    timeout_s: float,
) -> TwinError:
    text = str(error)
    if "in use" in text:
        return UsageError(f"{', '.join(listen)}: {IN_USE}")
    if "listener" in text:
        return UsageError(f"{', '.join(listen)}: cannot listen: {_cause(text)}")
    if not connect:
        return InfrastructureError(f"cannot open a session: {_cause(text)}")
    if is_socket(connect[0]):
        return UnreachableError(
            f"{connect[0]}: no simulator answers after {timeout_s:g} s; its rig may have ended"
        )
    from twin.fabric.handshake import greet

    try:
        greet(connect[0], key, linger_s=1.0)
    except UsageError as refused:
        return refused
    except UnreachableError as silent:
        if "TLS" in str(silent):
            return silent
        return UnreachableError(
            f"{', '.join(connect)}: nobody answers after {timeout_s:g} s; "
            "check that the conductor runs and the address is right"
        )
    hint = "" if is_tls(connect[0]) else "; a conductor with a key is reached by tls/ and --key"
    return UnreachableError(
        f"{connect[0]}: something listens there, but opened no session within {timeout_s:g} s{hint}"
    )


def _cause(text: str) -> str:
    """Zenoh's messages end in source positions of the build machine; keep the sentence."""
    return " ".join(text.split(" at /")[0].split())


class _ZenohBus:
    def __init__(self, session: zenoh.Session, endpoints: list[str], key: MemberKey | None) -> None:
        self.endpoints = endpoints
        self._key = key
        self._session = session
        self._declared: list[Any] = []
        self._publishers: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._closed = False
        _OPEN.add(self)

    def publish(
        self, key: str, payload: bytes, attachment: bytes = b"", *, block: bool = False
    ) -> None:
        self._check(Act.publish, key)
        control = zenoh.CongestionControl.BLOCK if block else zenoh.CongestionControl.DROP
        try:
            self._session.put(
                key, payload, attachment=attachment or None, congestion_control=control
            )
        except zenoh.ZError:
            if not self._closed:
                raise

    def _check(self, act: Act, key: str) -> None:
        """Raise WrongRoleError for what the other side would drop without a word."""
        member_key = self._key
        if member_key is not None and not may(member_key.role, act, key):
            raise WrongRoleError(f"{member_key.path}: {refusal(member_key.role, act, key)}")

    def wanted(self, key: str) -> bool:
        if key not in self._publishers:
            self._publishers[key] = self._session.declare_publisher(key)
        return bool(self._publishers[key].matching_status.matching)

    def release(self, key: str) -> None:
        publisher = self._publishers.pop(key, None)
        if publisher is not None and not self._closed:
            publisher.undeclare()

    def subscribe(self, key: str, handler: Callable[[Sample], None]) -> Cancel:
        self._check(Act.subscribe, key)

        def receive(sample: zenoh.Sample) -> None:
            attachment = sample.attachment
            handler(
                Sample(
                    str(sample.key_expr),
                    sample.payload.to_bytes(),
                    attachment.to_bytes() if attachment is not None else b"",
                )
            )

        subscriber = self._session.declare_subscriber(
            key, zenoh.handlers.Callback(receive, indirect=False)
        )
        self._declared.append(subscriber)

        def cancel() -> None:
            self._declared.remove(subscriber)
            if not self._closed:
                subscriber.undeclare()  # type: ignore[no-untyped-call]

        return cancel

    def serve(self, key: str, handler: Callable[[bytes, Respond], None]) -> Cancel:
        self._check(Act.answer, key)

        def receive(query: zenoh.Query) -> None:
            payload = query.payload.to_bytes() if query.payload is not None else b""

            def respond(answer: bytes) -> None:
                try:
                    query.reply(key, answer)
                    query.drop()  # type: ignore[no-untyped-call]
                except zenoh.ZError:
                    pass  # the asker is gone; it will ask again

            handler(payload, respond)

        queryable = self._session.declare_queryable(
            key, zenoh.handlers.Callback(receive, indirect=False)
        )
        self._declared.append(queryable)

        def cancel() -> None:
            self._declared.remove(queryable)
            if not self._closed:
                queryable.undeclare()  # type: ignore[no-untyped-call]

        return cancel

    def request(self, key: str, payload: bytes, timeout_s: float) -> bytes | None:
        replies = self._get(key, payload, timeout_s)
        if len(replies) != 1 or replies[0].ok is None:
            return None
        return replies[0].ok.payload.to_bytes()

    def gather(self, key: str, payload: bytes, timeout_s: float) -> list[bytes]:
        # By default one reply per key survives: a case that runs twice answers twice on one.
        replies = self._get(key, payload, timeout_s, zenoh.ConsolidationMode.NONE)
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

    def _get(
        self,
        key: str,
        payload: bytes,
        timeout_s: float,
        consolidation: zenoh.ConsolidationMode = zenoh.ConsolidationMode.AUTO,
    ) -> list[zenoh.Reply]:
        self._check(Act.ask, key)
        try:
            return list(
                self._session.get(
                    key, payload=payload, timeout=timeout_s, consolidation=consolidation
                )
            )
        except zenoh.ZError:
            return []

    def announce(self, key: str) -> None:
        self._check(Act.announce, key)
        self._declared.append(self._session.liveliness().declare_token(key))

    def watch(self, key: str, handler: Callable[[str, bool], None]) -> None:
        self._check(Act.watch, key)

        def receive(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._declared.append(
            self._session.liveliness().declare_subscriber(
                key, zenoh.handlers.Callback(receive, indirect=False), history=True
            )
        )

    def close(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._session.close()  # type: ignore[no-untyped-call]
        _OPEN.discard(self)


_OPEN: set[_ZenohBus] = set()
"""Closed ones leave: a viewer that waits for days opens thousands."""


def _close_all() -> None:
    for bus in list(_OPEN):
        bus.close()


# The interpreter hangs at exit while a session with callbacks is open, also after an uncaught
# exception; threading's own exit hooks run before that point.
threading._register_atexit(_close_all)  # type: ignore[attr-defined]
