"""The table of keys: derived from the types, complete, and the one that the documentation shows."""

from pathlib import Path
from typing import Annotated

import pytest
from msgspec import Meta, Struct

from schemas.campaign import Campaign
from schemas.files.yaml_file import load_yaml
from schemas.plan import parse_plan
from schemas.reference import FieldKey, keys_of, markdown

DOCUMENT = Path(__file__).parents[3] / "docs/campaign.md"


class Inner(Struct, tag_field="type", tag="inner"):
    """What is inside."""

    size_m: Annotated[float, Meta(gt=0)] = 1.5
    """How large [m]."""


class Outer(Struct):
    """A file."""

    name: str
    """Whose."""
    parts: dict[str, Inner] = {}
    """By name."""
    list_of: list[Annotated[int, Meta(ge=1, le=9)]] = []


def test_keys_carry_what_the_types_say():
    assert keys_of(Outer) == [
        FieldKey("name", "text", "", "Whose."),
        FieldKey("parts", "map to section", "", "By name."),
        FieldKey("parts.<name>.type", "inner", "inner", "What is inside."),
        FieldKey("parts.<name>.size_m", "number, above 0", "1.5", "How large [m]."),
        FieldKey("list_of", "list of integer, 1 to 9", "[]", ""),
    ]


@pytest.mark.parametrize("key", keys_of(Campaign), ids=lambda key: key.path)
def test_every_key_of_a_campaign_is_explained(key):
    assert key.meaning
    assert key.allowed


def test_the_documentation_shows_these_keys():
    """After a change: replace the table by what schemas.reference.markdown gives."""
    assert DOCUMENT.read_text().endswith("\n## All keys\n\n" + markdown(keys_of(Campaign)))


def test_the_example_of_the_documentation_is_valid(tmp_path):
    example = tmp_path / "example.yaml"
    example.write_text(DOCUMENT.read_text().split("```yaml\n")[1].split("```")[0])
    plan, mistakes = parse_plan(load_yaml(example))
    assert mistakes == []
    assert len(plan.cases) == 2 * 2 * 2 * 2 - 2 * 2 + 1
