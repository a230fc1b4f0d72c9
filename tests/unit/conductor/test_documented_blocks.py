"""Blocks of the documentation that are no commands: campaigns are valid, code compiles and imports
what exists, and every other file of a known form can be read.

Commands are checked by ``test_documented_commands``; those of Start and of the tutorials run in
``tests/e2e/test_tutorials``.
"""

from __future__ import annotations

import ast
import importlib
import json
import tomllib

import msgspec
import pytest
import yaml
from page_blocks import PAGES, Block, blocks, every_block

from schemas.campaign import Campaign
from schemas.files.yaml_file import load_yaml
from schemas.plan import parse_plan
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native

PACKAGES = ("schemas", "twin", "devkit", "conductor", "viewer", "hpc", "drivetwin")
KEYS = {field.encode_name for field in msgspec.structs.fields(Campaign)}
SHELLS = {"sh", "text", "json5", "toctree"}
"""Languages that are checked elsewhere, or are no language."""


def whole(part: dict) -> str:
    """What a part of a campaign lacks to be one."""
    text = "" if "campaign" in part else "campaign: part\n"
    cases = {"matrix", "cases", "search", "rulebook"} & set(part)
    return text if cases else text + "matrix: {repeat: [0]}\n"


def name_of(block: Block) -> str:
    return block.name


@pytest.mark.parametrize("block", every_block("yaml"), ids=name_of)
def test_a_documented_file_is_valid(block, tmp_path):
    data = yaml.safe_load(block.text)
    path = tmp_path / (block.file or "file.yaml")
    if isinstance(data, dict) and isinstance(data.get("scenario"), str):
        path.write_text(block.text)
        compile_native(load_native(path))
    elif isinstance(data, dict) and set(data) <= KEYS:
        path.write_text(block.text + whole(data))
        _, mistakes = parse_plan(load_yaml(path))
        assert not mistakes


@pytest.mark.parametrize("block", every_block("python"), ids=name_of)
def test_documented_code_imports_what_exists(block):
    for node in ast.walk(ast.parse(block.text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGES):
            module = importlib.import_module(node.module)
            for alias in node.names:
                if not hasattr(module, alias.name):
                    importlib.import_module(f"{node.module}.{alias.name}")
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.startswith(PACKAGES):
                    importlib.import_module(alias.name)


@pytest.mark.parametrize("block", every_block("toml", "json"), ids=name_of)
def test_a_documented_table_can_be_read(block):
    (tomllib.loads if block.language == "toml" else json.loads)(block.text)


def test_every_language_is_known():
    every = [block for page in PAGES for block in blocks(page)]
    known = {"yaml", "python", "toml", "json", *SHELLS}
    assert not [f"{block.name}: {block.language}" for block in every if block.language not in known]
    assert len(every) > 150


def test_a_comment_without_a_reason_is_refused(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- not run: it cannot be had here -->\n```sh\ntrue\n```\n")
    (block,) = blocks(page)
    assert (block.run, block.checked, block.line) == (False, True, 2)
    page.write_text("<!-- not run -->\n```sh\ntrue\n```\n")
    with pytest.raises(ValueError, match="not run"):
        blocks(page)
