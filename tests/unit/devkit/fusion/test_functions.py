"""Functions of the fusion stack, and that it uses no others of a C library or NumPy."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from mpmath import mp

import devkit.fusion
from devkit.fusion.functions import powers_of_ten, rounded, rounded_sine_cosine

FOLDER = Path(devkit.fusion.__file__).parent
TOOLS = {"ablation.py", "frozen.py"}
"""Modules that no stack imports."""
FOREIGN = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "arcsin", "arccos", "arctan"),
    *("arctan2", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow", "power", "cbrt"),
    *("hypot", "dist", "tanh", "sinh", "cosh", "erf", "gamma", "fsum", "sumprod", "dot", "inner"),
    *("matmul", "einsum", "linalg", "interp", "unwrap", "std", "var", "norm", "polyfit"),
}


def foreign(source: str) -> list[str]:
    """What of a module differs between machines or versions: functions, powers, Python's sum."""
    found = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Attribute(attr=name) if name in FOREIGN:
                found.append(name)
            case ast.BinOp(op=ast.Pow()) | ast.BinOp(op=ast.MatMult()):
                found.append(ast.unparse(node))
            case ast.Call(func=ast.Name(id="sum" | "pow" as name)):
                found.append(name)
    return found


@pytest.mark.parametrize(
    "source", ["math.sin(x)", "x ** 2", "a @ b", "sum(weights)", "np.hypot(x, y)", "pow(x, 2)"]
)
def test_what_is_foreign_is_found(source):
    assert foreign(source)


def test_no_module_of_the_stack_has_any():
    modules = [path for path in sorted(FOLDER.glob("*.py")) if path.name not in TOOLS]
    assert len(modules) > 10
    assert {path.name: found for path in modules if (found := foreign(path.read_text()))} == {}


def test_powers_of_ten_are_near_the_true_ones():
    mp.dps = 40
    exponents = np.random.default_rng(5).uniform(-20, 20, 3000).tolist()
    exponents += [0.0, -0.0, 1.0, 6.0, -7.5]
    powers = powers_of_ten(np.array(exponents)).tolist()
    for exponent, power in zip(exponents, powers, strict=True):
        true = mp.power(10, mp.mpf(exponent))
        assert abs(power / true - 1) < 1e-14
    assert powers_of_ten(np.zeros(1)) == 1.0


def test_sines_and_cosines_are_those_of_the_library_as_far_as_they_are_rounded():
    angles = np.random.default_rng(6).uniform(-7, 7, 20_000)
    sines, cosines = rounded_sine_cosine(angles)
    assert sines.tolist() == [round(math.sin(angle), 9) for angle in angles.tolist()]
    assert cosines.tolist() == [round(math.cos(angle), 9) for angle in angles.tolist()]
    assert np.isnan(rounded_sine_cosine(np.array([np.nan, 0.0]))[0]).tolist() == [True, False]


def test_numbers_are_rounded_as_python_rounds_them():
    random = np.random.default_rng(7)
    halves = (random.integers(-(10**12), 10**12, 20_000) + 0.5) / 1e9
    beside = halves * (1.0 + random.integers(-4, 5, len(halves)) * 2.2e-16)
    scales = np.repeat(np.array([1e-12, 1e-9, 1e-3, 1.0, 1e3, 4e6, 1e9, 1e300]), 500)
    others = random.uniform(-1, 1, len(scales)) * scales
    values = np.concatenate([halves, beside, others, [0.0, -0.0, -1e-10, 2.5e-9, np.inf, np.nan]])
    python = np.array([round(value, 9) for value in values.tolist()])
    assert rounded(values).tobytes() == python.tobytes()
