"""Catalogs of a scenario: files in the folders that it names, by the name of their catalog."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from twin.scenario.storyboard.openscenario.reader import (
    ScenarioDocument,
    ScenarioReader,
    load_document,
)
from twin.scenario.storyboard.openscenario.references import named_path
from twin.scenario.storyboard.openscenario.values import value_of

CATALOG_FILES_MAX = 1000
"""Files of one catalog folder."""


def load_catalogs(document: ScenarioDocument, reader: ScenarioReader) -> None:
    """Read the catalogs of a scenario into ``reader.catalogs``; what is wrong is noted there."""
    folders: dict[Path, None] = {}
    for directory in document.root.iterfind("CatalogLocations/*/Directory"):
        try:
            text = str(value_of(directory.get("path", ""), "s", {}, document.minor))
        except ValueError:
            continue  # said where the element is read; folders depend on no parameter here
        folder = named_path(document.path, text)
        if not text or not folder.is_dir():
            words = f"the catalog folder '{text}' is missing ({folder})"
            reader.mistakes.add(document.path, directory.sourceline, words)
            continue
        folders[folder] = None
    for folder in folders:
        paths = sorted(folder.glob("*.xosc"))
        if len(paths) > CATALOG_FILES_MAX:
            words = f"{folder} has more than {CATALOG_FILES_MAX} files"
            reader.mistakes.add(document.path, document.root.sourceline, words)
        for path in paths[:CATALOG_FILES_MAX]:
            _add(path, reader)


def _add(path: Path, reader: ScenarioReader) -> None:
    try:
        document = load_document(path)
    except ValueError as error:
        if str(error) not in reader.mistakes.lines:
            reader.mistakes.lines.append(str(error))
        return
    if document.kind != "CatalogFile":
        return  # other files may lie beside them
    root: Any = document.root.find("Catalog")
    name = str(root.get("name") or "")
    other = reader.catalogs.get(name)
    if other is not None and other[0].path != path:
        words = f"catalog '{name}' is also in {other[0].path}"
        reader.mistakes.add(path, root.sourceline, words)
        return
    names: set[str] = set()
    for item in root:
        entry = str(item.get("name"))
        if entry in names:
            reader.mistakes.add(path, item.sourceline, f"entry '{entry}' is in the catalog twice")
        names.add(entry)
    reader.catalogs[name] = document, root
