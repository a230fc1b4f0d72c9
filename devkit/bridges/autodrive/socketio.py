"""A Socket.IO client over one WebSocket, for both generations of the protocol.

Scripts of 2020 speak Engine.IO 3, current ones Engine.IO 4; libraries speak one of them, and two of
them cannot be installed side by side. What the two share is small: text packets whose first digit
is their type. What differs: in generation 3 the client sends the pings and is connected without
asking; in generation 4 the server sends them and wants to be asked.
"""

from __future__ import annotations

import contextlib
import json
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

OPEN, CLOSE, PING, PONG, MESSAGE = "0", "1", "2", "3", "4"
"""Types of Engine.IO packets."""

JOIN, LEAVE, EVENT = "0", "1", "2"
"""Types of Socket.IO packets, inside of an Engine.IO message."""

RETRY_S = 0.1
"""Wait before the next try to connect [s]."""

LISTEN_S = 1.0
"""Longest time a server of unknown generation may take to say that we are connected [s]."""

PING_S_MIN = 0.5
"""Shortest time between pings, whatever a script asks for [s]."""

MESSAGE_BYTES_MAX = 1 << 20
"""Largest message that a script may send [bytes]."""

ANSWERS_MAX = 1000
"""Most events that wait to be looked at; a script that sends more floods us."""


class SocketError(Exception):
    """The other side is not there, gone, or speaks something else; one line."""


class SocketClient:
    """One connection; events wait until they are asked for."""

    def __init__(self, connection: Any, *, pings_s: float | None) -> None:
        self._connection = connection
        self._inbox: queue.Queue[Any] = queue.Queue(ANSWERS_MAX)
        self._ended = ""
        self._pings_s = pings_s
        self._lock = threading.Lock()
        threading.Thread(target=self._read, name="socketio", daemon=True).start()
        if pings_s is not None:
            threading.Thread(target=self._ping, name="pings", daemon=True).start()

    def emit(self, event: str, data: Any) -> None:
        """Send one event.

        Raises:
            SocketError: the connection is lost.
        """
        self._send(f"{MESSAGE}{EVENT}{json.dumps([event, data])}")

    def receive(self, timeout_s: float) -> tuple[str, Any] | None:
        """The next event, or None after ``timeout_s``.

        Raises:
            SocketError: the connection is lost, or what came is no event.
        """
        try:
            return self._inbox.get(timeout=timeout_s)
        except queue.Empty:
            pass
        if self._ended:
            raise SocketError(self._ended)
        return None

    def close(self) -> None:
        """Leave; further calls fail."""
        self._ended = self._ended or "closed"
        with contextlib.suppress(Exception):
            self._connection.close()

    def _send(self, text: str) -> None:
        if self._ended:
            raise SocketError(self._ended)
        try:
            with self._lock:
                self._connection.send(text)
        except Exception as error:  # the library's own, and the socket's
            raise SocketError(f"connection lost ({_words(error)})") from None

    def _read(self) -> None:
        try:
            while True:
                self._take(self._connection.recv())
        except queue.Full:
            self._ended = f"more than {ANSWERS_MAX} events without being asked"
        except SocketError as error:
            self._ended = str(error)
        except Exception as error:
            self._ended = self._ended or f"connection lost ({_words(error)})"
        with contextlib.suppress(Exception):
            self._connection.close()

    def _take(self, packet: Any) -> None:
        if not isinstance(packet, str) or not packet:
            raise SocketError(f"sent {packet[:20]!r}, no packet of Socket.IO")
        if packet[0] == PING:
            self._send(PONG + packet[1:])
        elif packet[0] == CLOSE or packet[:2] == MESSAGE + LEAVE:
            raise SocketError("the script closed the connection")
        elif packet[:2] == MESSAGE + EVENT:
            try:
                event, *data = json.loads(packet[2:].lstrip("0123456789"))
            except (TypeError, ValueError, RecursionError):
                raise SocketError(f"sent {packet[:60]!r}, no event of Socket.IO") from None
            self._inbox.put_nowait((str(event), data[0] if data else None))

    def _ping(self) -> None:
        assert self._pings_s is not None
        pause = threading.Event()
        while not self._ended:
            with contextlib.suppress(SocketError):
                self._send(PING)
            pause.wait(self._pings_s)


def connect(host: str, port: int, timeout_s: float, on_wait: Callable[[], None]) -> SocketClient:
    """Connect as soon as somebody listens.

    Args:
        host, port: where the script listens.
        timeout_s: how long it may take [s].
        on_wait: runs between tries and may raise to give up.

    Raises:
        SocketError: nobody listens, or not with Socket.IO.
    """
    until_s = time.monotonic() + timeout_s
    # Engine.IO 3 servers take 4 as well: they do not look at the number.
    url = f"ws://{host}:{port}/socket.io/?EIO=4&transport=websocket"
    pause = threading.Event()
    while True:
        on_wait()
        try:
            connection = _open(url, max(0.1, until_s - time.monotonic()))
        except ConnectionRefusedError:
            if time.monotonic() >= until_s:
                raise SocketError(f"nobody listens after {timeout_s:g} s") from None
            pause.wait(RETRY_S)
            continue
        except Exception as error:
            raise SocketError(f"what listens there is no Socket.IO ({_words(error)})") from None
        try:
            return _join(connection, max(0.1, until_s - time.monotonic()))
        except Exception as error:
            connection.close()
            if isinstance(error, SocketError):
                raise
            raise SocketError(f"connection lost ({_words(error)})") from None


def _open(url: str, timeout_s: float) -> Any:
    from websockets.sync.client import connect as open_socket

    return open_socket(
        url,
        open_timeout=timeout_s,
        max_size=MESSAGE_BYTES_MAX,
        # Engine.IO has pings of its own, and pictures are compressed already.
        ping_interval=None,
        compression=None,
        proxy=None,
        close_timeout=0.5,
        legacy=True,  # the connection itself, without automatic reconnection
    )


def _join(connection: Any, timeout_s: float) -> SocketClient:
    """The first packets: who pings, and whether we have to ask."""
    try:
        packet = connection.recv(timeout=timeout_s)
        opened = json.loads(packet[1:])
        interval_s = float(opened["pingInterval"]) / 1000
    except TimeoutError:
        raise SocketError(f"no greeting within {timeout_s:g} s") from None
    except Exception as error:
        raise SocketError(f"what listens there is no Socket.IO ({_words(error)})") from None
    generation = 4 if "maxPayload" in opened else 3
    if generation == 3:
        try:
            first = connection.recv(timeout=LISTEN_S)
        except TimeoutError:
            generation = 4  # an early one, which waits to be asked
        else:
            if first[:2] != MESSAGE + JOIN:
                raise SocketError(f"sent {first[:20]!r} instead of a welcome")
    if generation == 4:
        connection.send(MESSAGE + JOIN)
    pings_s = max(PING_S_MIN, interval_s / 2)
    return SocketClient(connection, pings_s=pings_s if generation == 3 else None)


def _words(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
