"""Messages of an MCAP file or a rosbag2 folder, decoded by the definitions that it holds."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from twin.drives.drive import NAME_CHARS_MAX

METADATA = "metadata.yaml"
"""File by which a folder is known to be rosbag2's."""
DEFINITION_CHARS_MAX = 200_000
"""Longest definition of a type [characters]."""
CONNECTIONS_MAX = 10_000
"""Most topics of a recording."""
MESSAGE_BYTES_MAX = 64 << 20
"""Largest message that is decoded [bytes]."""


MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of an MCAP file."""


def _state(path: Path) -> str:
    """What is wrong with a recording that cannot be read, in words, and what to do about it."""
    try:
        with path.open("rb") as file:
            begins = file.read(len(MAGIC)) == MAGIC
            file.seek(-min(len(MAGIC), path.stat().st_size), 2)
            ends = file.read() == MAGIC
    except OSError:
        begins, ends = False, False
    if begins and not ends:
        return (
            "its end is missing, as when recording was cut off; `mcap recover` (the command line "
            "of mcap.dev) writes what is there into a new file"
        )
    return "damaged, or no recording of ROS 2"


class MessageStream:
    """A recording, as a context manager."""

    def __init__(self, path: Path) -> None:
        """``path``: an MCAP file, or ``metadata.yaml`` of a folder.

        Raises:
            ImportError: rosbags is not installed.
        """
        self.path = path
        bags, self._types = (
            importlib.import_module(f"rosbags.{name}") for name in ("rosbag2", "typesys")
        )
        self._serde = importlib.import_module("rosbags.serde")
        with self._lines():
            self._reader = bags.Reader(path.parent if path.name == METADATA else path)

    @contextmanager
    def _lines(self) -> Iterator[None]:
        """What the libraries raise of damaged files is of many kinds; here it is one line."""
        try:
            yield
        except MemoryError:
            raise ValueError(f"{self.path}: not enough memory to read it") from None
        except Exception as error:
            words = " ".join(str(error).split())[:160]
            raise ValueError(
                f"{self.path}: {_state(self.path)}: {type(error).__name__}: {words}"
            ) from None

    def __enter__(self) -> MessageStream:
        with self._lines():
            self._reader.open()
        if len(self._reader.connections) > CONNECTIONS_MAX:
            raise ValueError(f"{self.path}: more than {CONNECTIONS_MAX} topics")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._reader.close()

    def topics(self) -> dict[str, str]:
        """Type by topic; of a topic with several types, the first."""
        types: dict[str, str] = {}
        for connection in self._reader.connections:
            types.setdefault(connection.topic, connection.msgtype)
        return types

    def told(self) -> list[str]:
        """A line per topic, for people."""
        return [
            f"{c.topic[:NAME_CHARS_MAX]} ({c.msgtype[:80]}, {c.msgcount})"
            for c in sorted(self._reader.connections, key=lambda c: (c.topic, c.id))
        ]

    def messages(self, wanted: set[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of recording [ns] and message of the wanted topics; None: no such message.

        Raises:
            ValueError: a definition cannot be read; one line.
        """
        types = self.topics()
        chosen = [
            c for c in self._reader.connections if c.topic in wanted and c.msgtype == types[c.topic]
        ]
        if not chosen:
            return
        store = self._store_of(chosen)
        stored = self._reader.messages(connections=chosen)
        while True:
            with self._lines():
                row = next(stored, None)
            if row is None:
                return
            connection, time_ns, data = row
            message: Any = None
            if len(data) <= MESSAGE_BYTES_MAX:
                try:
                    message = store.deserialize_cdr(data, connection.msgtype)
                # What a generated reader raises depends on the field at which its bytes end.
                except (self._serde.SerdeError, IndexError, TypeError, OverflowError, ValueError):
                    message = None
            yield connection.topic, time_ns, message

    def _store_of(self, chosen: list[Any]) -> Any:
        """Types of the wanted topics: as the recording defines them, else as they are known."""
        library = self._types
        store = library.get_typestore(library.Stores.EMPTY)
        known = library.get_typestore(library.Stores.LATEST)
        parsed: dict[str, Any] = {}
        for connection in chosen:
            text = connection.msgdef.data
            if len(text) > DEFINITION_CHARS_MAX:
                raise ValueError(f"{self.path}: {connection.topic}: a definition that is too long")
            try:
                if not text:
                    parsed |= _with_parts(known.fielddefs, connection.msgtype)
                elif text.startswith("=" * 80 + "\nIDL: "):
                    for part in text.split("=" * 80 + "\n")[1:]:
                        parsed |= library.get_types_from_idl(part.split("\n", 1)[1])
                else:
                    parsed |= library.get_types_from_msg(text, connection.msgtype)
            except (library.TypesysError, KeyError, IndexError, ValueError) as error:
                words = " ".join(str(error).split())[:120]
                raise ValueError(
                    f"{self.path}: {connection.topic}: its definition cannot be read: {words}"
                ) from None
        try:
            store.register(parsed)
            for connection in chosen:
                store.get_msgdef(connection.msgtype)
        # A definition that names what is not there, or itself, or words of Python.
        except (library.TypesysError, KeyError, SyntaxError, RecursionError, ValueError) as error:
            words = " ".join(str(error).split())[:120]
            raise ValueError(
                f"{self.path}: its definitions cannot be used: {type(error).__name__}: {words}"
            ) from None
        return store


def _with_parts(definitions: dict[str, Any], type_name: str) -> dict[str, Any]:
    """A type and all that it uses, of a library's own."""
    found: dict[str, Any] = {}
    open_names = [type_name]
    while open_names:
        name = open_names.pop()
        if name not in found:
            found[name] = definitions[name]
            open_names += [n for n in _named(definitions[name][1]) if n in definitions]
    return found


def _named(description: Any) -> Iterator[str]:
    if isinstance(description, str):
        yield description
    elif isinstance(description, list | tuple):
        for part in description:
            yield from _named(part)
