"""What one process tells another has a type: no function of theirs returns a bare dict."""

import ast
from pathlib import Path

from house.statements import statements

ROOT = Path(__file__).resolve().parents[2]
TALKING = (
    "schemas",
    *("conductor/core", "conductor/serve", "conductor/journal", "conductor/run"),
    *("conductor/commands", "conductor/trust"),
    *("twin/base", "twin/fabric", "twin/worker", "twin/rig", "twin/view", "twin/sandbox"),
    *("devkit/hosting", "devkit/bridges"),
    *("viewer/live", "viewer/intervening", "viewer/recording"),
    "hpc",
)
"""Packages whose processes talk with others."""

FREE = {
    "schemas/axes.py:parameters_of": "a stack's parameters are its author's",
    "schemas/sections/autonomy.py:driver": "arguments of a case, which has the types",
    "schemas/points.py:_grid": "values of axes, each of its section's type",
    "twin/base/gpu/cuda.py:__cuda_array_interface__": "a protocol of CUDA libraries",
    "schemas/sections/perception.py:what_is_loaded": "a variant's keys are its author's",
    "twin/fabric/zenoh_bus.py:_tls": "the configuration of Zenoh",
    "twin/fabric/keys/rights.py:access_control": "the configuration of Zenoh",
    "conductor/run/source.py:_in_weathers": "a campaign's file before it is checked",
    "conductor/run/changes.py:_with": "a campaign's file before it is checked",
    "schemas/files/proposals.py:beside": "a campaign's file, of the types of its sections",
    "hpc/doctor.py:as_json": "printed for scripts, with the facts of a machine",
}
"""Functions that return what has no type of ours, and why."""


def bare(path: Path) -> list[str]:
    """Functions of a module that return ``dict[str, Any]``, alone or within something."""
    name = path.relative_to(ROOT).as_posix()
    return [
        f"{name}:{node.name}"
        for node in statements(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
        if node.returns is not None and "dict[str, Any]" in ast.unparse(node.returns)
    ]


def test_no_function_of_a_talking_process_returns_a_bare_dict():
    paths = sorted(path for package in TALKING for path in (ROOT / package).rglob("*.py"))
    assert len(paths) > 300
    assert {found for path in paths for found in bare(path)} == set(FREE)
