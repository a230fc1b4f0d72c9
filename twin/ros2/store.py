"""ROS 2 message types: classes, CDR bytes, definitions and RIHS01 hashes, by the library rosbags.

The library brings the types of ROS 2's own packages; those of other packages are in
``interfaces/<package>/msg``. What the type hashes are made of: REP 2011 and 2016.
"""

from __future__ import annotations

import importlib
import struct
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from twin.base.errors import UsageError

DISTRIBUTIONS = ("jazzy", "kilted", "lyrical")
"""Distributions of ROS 2 whose types are known."""

MESSAGE_BYTES_MAX = 64 << 20
"""Largest message that is decoded [bytes]."""

INTERFACES = Path(__file__).parent / "interfaces"
"""Folder of the ``.msg`` files."""


_SERVICES: dict[str, tuple[list[tuple[str, str]], list[tuple[str, str]]]] = {
    "std_srvs/srv/Trigger": ([], [("success", "bool"), ("message", "string")]),
    "std_srvs/srv/SetBool": ([("data", "bool")], [("success", "bool"), ("message", "string")]),
    "std_srvs/srv/Empty": ([], []),
}
"""Services by name: fields of request and response. rosbags has none."""


class MessageError(ValueError):
    """Bytes that are no message of their type, or a message whose fields do not fit; one line."""


class TypeStore:
    """The message types of one distribution. Names are written ``std_msgs/msg/String``."""

    def __init__(self, distribution: str = "jazzy") -> None:
        """Load the types.

        Raises:
            UsageError: no such distribution, or rosbags is not installed.
        """
        if distribution not in DISTRIBUTIONS:
            raise UsageError(
                f"ROS 2 distribution '{distribution}' given, allowed: {', '.join(DISTRIBUTIONS)}"
            )
        self.distribution = distribution
        library = _library("rosbags.typesys")
        self._errors = (_library("rosbags.serde").SerdeError, struct.error)
        self._types = library.get_typestore(library.Stores[f"ROS2_{distribution.upper()}"])
        self._types.max_sequence_length = MESSAGE_BYTES_MAX
        parsed: dict[str, Any] = {}
        for path in sorted(INTERFACES.glob("*/msg/*.msg")):
            name = f"{path.parents[1].name}/msg/{path.stem}"
            parsed |= library.get_types_from_msg(path.read_text(encoding="utf-8"), name)
        self._types.register(parsed)
        node = _library("rosbags.interfaces").Nodetype
        for name, (constants, fields) in list(self._types.fielddefs.items()):
            self._types.fielddefs[name] = constants, [(key, _octet(d)) for key, d in fields]
        for service, (request, response) in _SERVICES.items():
            self._types.register(_service(node, service, request, response))

    def names(self) -> list[str]:
        """All types, sorted."""
        return sorted(self._types.fielddefs)

    def knows(self, type_name: str) -> bool:
        """Whether there is such a type."""
        return type_name in self._types.fielddefs

    def make(self, type_name: str, **fields: Any) -> Any:
        """A message; sequences of numbers are arrays of NumPy.

        Raises:
            KeyError: no such type.
            TypeError: other fields than the type has.
        """
        return self._types.types[type_name](**fields)

    def constant(self, type_name: str, name: str) -> Any:
        """Value of a constant of a type."""
        return getattr(self._types.types[type_name], name)

    def type_hash(self, type_name: str) -> str:
        """RIHS01 hash of a type, ``RIHS01_`` and 64 hexadecimal digits.

        Raises:
            UsageError: no such type.
        """
        self._check(type_name)
        found: str = self._types.hash_rihs01(type_name)
        return found

    def definition(self, type_name: str) -> str:
        """The type and all that it uses in the form ``ros2msg`` of MCAP files.

        Raises:
            UsageError: no such type.
        """
        self._check(type_name)
        text, _ = self._types.generate_msgdef(type_name, ros_version=2)
        return str(text)

    def encode(self, message: Any) -> bytes:
        """CDR bytes, little-endian, with the encapsulation header.

        Raises:
            MessageError: a field's value does not fit its type.
        """
        name = message.__msgtype__
        try:
            return bytes(self._types.serialize_cdr(message, name, little_endian=True))
        except (*self._errors, TypeError, ValueError, AttributeError, AssertionError) as error:
            raise MessageError(f"{name}: cannot be written: {_line(error)}") from None

    def decode(self, type_name: str, data: bytes | memoryview) -> Any:
        """The message that is in CDR bytes of a peer who is not trusted.

        Raises:
            UsageError: no such type.
            MessageError: other bytes, or more than :data:`MESSAGE_BYTES_MAX`.
        """
        self._check(type_name)
        if len(data) > MESSAGE_BYTES_MAX:
            raise MessageError(
                f"{type_name}: {len(data)} bytes, allowed: up to {MESSAGE_BYTES_MAX}"
            )
        try:
            return self._types.deserialize_cdr(data, type_name)
        # What a generated reader raises at the end of its bytes depends on the field it was at.
        except (*self._errors, ValueError, IndexError, TypeError, OverflowError) as error:
            raise MessageError(f"{type_name}: no message of this type: {_line(error)}") from None

    def _check(self, type_name: str) -> None:
        if not self.knows(type_name):
            raise UsageError(
                f"message type '{type_name}' is not known; known are those of ROS 2 "
                f"{self.distribution} and of {', '.join(packages())}"
            )


@cache
def type_store(distribution: str = "jazzy") -> TypeStore:
    """The store of a distribution, made once; making one takes some tenths of a second."""
    return TypeStore(distribution)


def packages() -> Sequence[str]:
    """Packages whose interfaces lie here."""
    return sorted(path.name for path in INTERFACES.iterdir() if (path / "msg").is_dir())


def _octet(description: Any) -> Any:
    """ROS 2 reads ``char`` as uint8, also in hashes; the library keeps it apart."""
    if not isinstance(description, tuple):
        return "uint8" if description == "char" else description
    return tuple(_octet(part) for part in description)


def _service(
    node: Any, name: str, request: list[tuple[str, str]], response: list[tuple[str, str]]
) -> dict[str, Any]:
    """A service as types of messages, of which REP 2016 makes its hash: request, response, event,
    and one that holds the three under the service's own name."""

    def plain(fields: list[tuple[str, str]]) -> Any:
        return [], [(field, (node.BASE, (kind, 0))) for field, kind in fields]

    def named(kind: str) -> Any:
        return (node.NAME, kind)

    parts = {f"{name}_Request": plain(request), f"{name}_Response": plain(response)}
    event = [("info", named("service_msgs/msg/ServiceEventInfo"))]
    event += [
        (part, (node.SEQUENCE, (named(f"{name}_{part.capitalize()}"), 1)))
        for part in ("request", "response")
    ]
    whole = [
        (f"{part}_message", named(f"{name}_{part.capitalize()}"))
        for part in ("request", "response", "event")
    ]
    return {**parts, f"{name}_Event": ([], event), name: ([], whole)}


def _library(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise UsageError(
            "ROS 2 messages need the package rosbags; "
            "install it with: pip install 'drivetwin[ros2]'"
        ) from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
