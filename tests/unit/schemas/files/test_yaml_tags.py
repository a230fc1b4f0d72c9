"""Explicit tags of YAML: each value is what it would be without, or one line says what is wrong."""

from __future__ import annotations

import pytest

from schemas.files.yaml_file import YamlError, parse_yaml

MISFITS = (
    *('!!int ""', '!!float ""', "!!bool maybe", "!!null 3", "!!int 0x", "!!int 1:99:a"),
    *("!!int 0b2", "!!int 5.0", "!!float x", "!!map x", "!!seq 3", "!!str [1]", "!!int {a: 1}"),
    *("!!float 1:2e5:3", "!!bool 1", "!!int", "!!float", "!!bool"),
)
FOREIGN = (
    *("!!timestamp zzz", "!!timestamp 2020-99-99", "!!timestamp 2020-01-01", "!!binary x"),
    *("!!set {a}", "!!omap [a]", "!!pairs 3", "!!python/object:os.system x", "!own x"),
    *("!!merge x", "!<tag:example.org,2000:x> 1", "!!value x"),
)


@pytest.mark.parametrize("value", MISFITS)
@pytest.mark.parametrize("where", ["a: {}", "- {}", "{}", "? {}\n: 1"])
def test_a_value_that_does_not_fit_its_tag_is_one_line(value: str, where: str) -> None:
    with pytest.raises(YamlError, match=r"^c\.yaml:\d+:\d+: .+ is no !!\w+; leave the tag out$"):
        parse_yaml(where.format(value), "c.yaml")


@pytest.mark.parametrize("value", FOREIGN)
@pytest.mark.parametrize("where", ["a: {}", "{}", "? {}\n: 1"])
def test_a_type_that_no_file_holds_is_one_line_that_says_which_there_are(
    value: str, where: str
) -> None:
    with pytest.raises(
        YamlError, match=r"^c\.yaml:\d+:\d+: tag '.+'; leave it out, or one of !!str"
    ):
        parse_yaml(where.format(value), "c.yaml")


def test_tags_that_fit_change_a_value_or_nothing() -> None:
    text = "{a: !!str 5, b: !!int '5', c: !!float 5, d: !!bool 'true', e: !!null ''}"
    expected = {"a": "5", "b": 5, "c": 5.0, "d": True, "e": None}
    assert parse_yaml(text, "x") == expected
    assert type(parse_yaml(text, "x")["c"]) is float
    assert parse_yaml("!!map {a: !!seq [1]}", "x") == {"a": [1]}


@pytest.mark.parametrize(
    "text",
    [
        "base: &b {x: 1}\nown: {? !!merge '<<' : *b}",
        "a: &a {x: 1}\nb: &b {? !!merge k : [" + "*a, " * 50 + "]}",
        "{? !!merge x : 3}",
    ],
)
def test_a_merge_key_is_a_tag_like_any_other(text: str) -> None:
    with pytest.raises(YamlError, match="tag '!!merge'"):
        parse_yaml(text, "c.yaml")


def test_the_sign_of_a_merge_is_plain_text() -> None:
    assert parse_yaml("a: &a {x: 1}\nb: {<<: *a}", "x")["b"] == {"<<": {"x": 1}}


def test_a_value_without_end_is_cut_in_the_line() -> None:
    with pytest.raises(YamlError) as caught:
        parse_yaml(f"a: !!bool {'x' * 1_000_000}", "c.yaml")
    assert len(str(caught.value)) < 200
