"""XML files of others, read without entities, document types or network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from schemas.escape import escape
from schemas.files.regular_file import read_regular


def read_xml(path: Path, *, root: str, bytes_max: int, depth_max: int, elements_max: int) -> Any:
    """The root element of an XML file; every element knows its line (``sourceline``).

    Args:
        path: the file.
        root: name of its root element.
        bytes_max: its largest size [bytes]; a larger one is not read.
        depth_max: how deep its elements may nest.
        elements_max: how many elements it may have.

    Raises:
        ValueError: one line with file and line: it cannot be opened, is no XML, has a document
            type, another root, or is beyond a limit.
    """
    try:
        data = read_regular(path, bytes_max)
    except OSError as error:
        raise ValueError(f"{path}:1: {error.strerror or error}") from None
    except ValueError as error:  # a path with a NUL
        raise ValueError(f"{str(path)!r}:1: {error}") from None
    return parse_xml(
        data,
        str(path),
        root=root,
        bytes_max=bytes_max,
        depth_max=depth_max,
        elements_max=elements_max,
    )


def parse_xml(
    data: bytes, path: str, *, root: str, bytes_max: int, depth_max: int, elements_max: int
) -> Any:
    """:func:`read_xml` of what a file holds; ``path`` is for messages.

    Raises:
        ValueError: as there.
    """
    if len(data) > bytes_max:
        raise ValueError(f"{path}:1: {len(data)} bytes, at most {bytes_max} are read")
    try:
        from lxml import etree  # here: an extra, and only readers of XML need it
    except ImportError:
        raise ValueError(
            f"{path}: reading it needs the package lxml: pip install 'drivetwin[scenarios]'"
        ) from None
    parser = etree.XMLPullParser(
        events=("start", "end"),
        resolve_entities=False,
        load_dtd=False,
        no_network=True,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    depth = elements = 0
    try:
        for at in range(0, len(data), _CHUNK_BYTES):
            parser.feed(data[at : at + _CHUNK_BYTES])
            for event, node in parser.read_events():
                if event == "end":
                    depth -= 1
                    continue
                depth += 1
                elements += 1
                if elements == 1:
                    _check_start(path, node, root)
                if depth > depth_max:
                    raise ValueError(
                        f"{path}:{node.sourceline}: elements nest deeper than {depth_max}"
                    )
                if elements > elements_max:
                    raise ValueError(f"{path}:{node.sourceline}: more than {elements_max} elements")
        tree = parser.close()
    except etree.XMLSyntaxError as error:
        reason = str(error.msg or "no XML").split("\n")[0]
        raise ValueError(f"{path}:{max(error.lineno or 1, 1)}: {reason}") from None
    if elements == 0:
        _check_start(path, tree, root)
    return tree


_CHUNK_BYTES = 1 << 16


def _check_start(path: str, node: Any, root: str) -> None:
    if node.getroottree().docinfo.doctype:
        raise ValueError(
            f"{path}:{node.sourceline}: a document type (DOCTYPE) is not read; remove it"
        )
    tag = str(node.tag).rpartition("}")[2]  # behind a namespace
    if tag != root:
        raise ValueError(
            f"{path}:{node.sourceline}: the root element is {escape(tag, 80)}, it must be {root}"
        )
