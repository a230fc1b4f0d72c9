"""All keys of scenario files as tables, a section each, for the manual."""

from __future__ import annotations

from msgspec import Struct

from schemas.reference import keys_of, markdown
from twin.scenario.storyboard.native import orders, sections, watches

SECTIONS: tuple[tuple[str, type[Struct]], ...] = (
    ("The file", sections.NativeScenario),
    ("ego", sections.EgoStart),
    ("actors.<name>", sections.ActorStart),
    ("actors.<name>.idm", sections.IdmSettings),
    ("events.<name>", sections.StoryEvent),
    ("events.<name>.when.<name>", watches.ActorWatch),
    ("below and above", watches.ValueRange),
    ("Places: reaches, at, meet_at, ego_reaches", watches.ScenarioSpot),
    ("events.<name>.do.<name>", orders.ActorOrders),
    ("arrive", orders.ArriveOrder),
    ("keep", orders.KeepOrder),
    ("lamps", orders.LampOrders),
    ("end", sections.ScenarioEnd),
)
"""Titles of tables, and what they are about."""


def reference_tables() -> str:
    """Markdown: a heading and a table for every section."""
    parts = []
    for title, section in SECTIONS:
        keys = [key for key in keys_of(section) if not _nested(key.path)]
        heading = f"`{title}`" if "<" in title or (title.islower() and " " not in title) else title
        parts.append(f"### {heading}\n\n{markdown(keys)}")
    return "\n".join(parts)


def _nested(path: str) -> bool:
    """Whether a key belongs to a section that has a table of its own."""
    return "." in path.removesuffix(".<name>")
