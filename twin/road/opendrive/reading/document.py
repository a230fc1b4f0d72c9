"""An XML document of untrusted origin as a tree with line numbers, within named limits.

No document type, so no entity and nothing that grows; nothing else is opened, nor a network asked.
"""

from __future__ import annotations

import io
import re
from typing import Any

FILE_BYTES_MAX = 64 << 20
"""Largest file [bytes]."""
ELEMENTS_MAX = 1_000_000
"""Most elements of a file."""
DEPTH_MAX = 32
"""Deepest nesting; OpenDRIVE itself needs about ten."""

_ENCODINGS = frozenset({"utf-8", "us-ascii", "ascii", "iso-8859-1", "latin-1", "windows-1252"})
"""In these ``<`` is one byte and nothing else is, so that what stands before the root is seen."""
_DECLARATION = re.compile(
    rb"<\?xml\s[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]{1,40})[\"'][^>]*?\?>"
)
_BEFORE_ROOT = re.compile(rb"\s+|<\?.*?\?>|<!--.*?-->", re.DOTALL)
_REASON_CHARS_MAX = 200


def parse_document(data: bytes, name: str) -> Any:
    """The root element (``lxml.etree``) of ``data``; every element knows its line.

    Args:
        data: the content of the file.
        name: of the file, for messages.

    Raises:
        ValueError: not XML, beyond a limit, with a document type, or lxml is not installed; one
            line that names the file and the line in it.
    """
    try:
        from lxml import etree
    except ImportError:
        raise ValueError(
            f"{name}: lxml is needed to read it: pip install 'drivetwin[scenarios]'"
        ) from None
    if len(data) > FILE_BYTES_MAX:
        raise ValueError(f"{name}: {len(data)} bytes, at most {FILE_BYTES_MAX} are read")
    encoding = _checked_prolog(data, name)
    events = etree.iterparse(
        io.BytesIO(data),
        events=("start", "end"),
        encoding=encoding,
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
        huge_tree=False,
    )
    depth = count = 0
    try:
        for event, element in events:
            if event == "end":
                depth -= 1
                continue
            depth += 1
            count += 1
            if depth > DEPTH_MAX:
                raise ValueError(
                    f"{name}:{element.sourceline}: nested deeper than {DEPTH_MAX} elements"
                )
            if count > ELEMENTS_MAX:
                raise ValueError(f"{name}:{element.sourceline}: more than {ELEMENTS_MAX} elements")
    except etree.XMLSyntaxError as error:
        reason = (error.msg or "no XML").split(", line ")[0][:_REASON_CHARS_MAX]
        raise ValueError(f"{name}:{max(error.lineno or 1, 1)}: not XML: {reason}") from None
    return events.root


def _checked_prolog(data: bytes, name: str) -> str:
    """The encoding; what stands before the root has no document type."""
    zero = data.find(b"\0")
    if zero >= 0:
        line = data.count(b"\n", 0, zero) + 1
        raise ValueError(f"{name}:{line}: a zero byte; XML in UTF-8 is needed")
    at = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    encoding = "utf-8"
    declared = _DECLARATION.match(data, at)
    if declared:
        encoding = declared[1].decode("ascii").lower()
        if encoding not in _ENCODINGS:
            raise ValueError(f"{name}:1: encoding {encoding!r}; UTF-8 is needed")
    while match := _BEFORE_ROOT.match(data, at):
        at = match.end()
    if data[at : at + 2] == b"<!":
        line = data.count(b"\n", 0, at) + 1
        raise ValueError(
            f"{name}:{line}: <!DOCTYPE>: document types and entities are refused; take it out"
        )
    return encoding
