"""Kernels use no function whose last bits depend on the device.

Libraries' sines and powers differ between a CPU and a GPU, and so do the hits of Warp's own
hierarchies, textures and sums of floats in the order in which threads arrive. Kernels use
``twin.base.portable_math``, the rays of ``twin.render.trace`` and fixed orders instead.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

FOREIGN = re.compile(
    "a?(sin|cos|tan)h?|atan2|exp|exp2|expm1|log|log2|log10|log1p|pow|cbrt|erfc?|erfc?inv"
    "|quat_(from_axis_angle|to_axis_angle|from_euler|to_euler|rpy|slerp|from_matrix)"
    "|(sample|rand|tile|texture|hash_grid|bvh|mesh_query|mesh_eval)\\w*|p?noise|curlnoise|poisson"
    "|nan|NAN|svd\\w*|qr\\w*|eig\\w*|smoothstep|transform_from_matrix|matrix_from_\\w*|fast_\\w*"
)
"""Functions of Warp that end in other bits on another device, or may."""

INTEGERS = {"twin/dataset/images/silhouette.py", "twin/sensors/lidar/returns.py"}
"""Files whose atomic operations are on integers."""

ELSEWHERE = {
    # Baked once, on the CPU, and rounded to 1/255.
    "twin/world/street/ambient.py": {"mesh_query_ray_anyhit"},
    # A bench of other people's hierarchies.
    "twin/bench/lambert.py": {"mesh_query_ray", "mesh_query_ray_anyhit"},
}
"""Foreign functions that reach no result."""

NATIVE = re.compile(
    r"\b(a?(sin|cos|tan)h?|atan2|exp2?|log(2|10)?|pow|cbrt|erfc?|hypot)f?\s*\("
    r"|__(sin|cos|tan|exp|log|pow)\w*\s*\(|__fdividef|rsqrt|__frsqrt"
)
"""The same in native code."""

NATIVE_ELSEWHERE = {
    # Quick divisions that only bounds of hierarchies follow from.
    "twin/render/trace/traverse.py": {"__fdividef"},
    # A first guess of a root, which is mended to the nearest float.
    "twin/base/portable/quick.py": {"rsqrt"},
}
"""Foreign functions of native code that reach no result as they are."""


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    """Kernels and the functions that they call."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            for decorator in node.decorator_list:
                call = decorator.func if isinstance(decorator, ast.Call) else decorator
                if ast.unparse(call) in ("wp.kernel", "wp.func"):
                    yield node


def foreign(function: ast.FunctionDef) -> set[str]:
    """What a kernel calls that is not portable; ``**`` for a power."""
    nodes = list(ast.walk(function))
    powers = [n for n in nodes if isinstance(n, ast.BinOp | ast.AugAssign)]
    found = {"**" for n in powers if isinstance(n.op, ast.Pow)}
    of_warp = [n.attr for n in nodes if isinstance(n, ast.Attribute) and named(n.value) == "wp"]
    return found | {f for f in of_warp if FOREIGN.fullmatch(f) or f.startswith("atomic_")}


def named(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else ""


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def kernel_files() -> list[Path]:
    return [p for p in sorted((ROOT / "twin").rglob("*.py")) if "warp" in p.read_text("utf-8")]


def native_strings(tree: ast.Module) -> Iterator[str]:
    """Strings of a file that say native code, without comments."""
    strings = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    for text in strings:
        if isinstance(text, str) and re.search(r"\w;$", text, re.MULTILINE):
            yield re.sub("//[^\n]*", "", text)


@pytest.mark.parametrize("path", kernel_files(), ids=lambda p: p.relative_to(ROOT).as_posix())
def test_kernels_call_no_foreign_function(path):
    name = path.relative_to(ROOT).as_posix()
    found: set[str] = set().union(*(foreign(f) for f in functions(parsed(path))))
    if name in INTEGERS:
        found = {f for f in found if not f.startswith("atomic_")}
    assert found - ELSEWHERE.get(name, set()) == set(), "see twin.base.portable_math"


def test_native_code_calls_no_foreign_function():
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "twin").rglob("*.py")):
        for text in native_strings(parsed(path)):
            words = {match[0].strip("( ") for match in NATIVE.finditer(text)}
            found.setdefault(path.relative_to(ROOT).as_posix(), set()).update(words)
    assert {"twin/render/trace/eight.py", "twin/render/trace/four.py"} < found.keys()
    foreign_words = {name: w - NATIVE_ELSEWHERE.get(name, set()) for name, w in found.items()}
    assert {name: words for name, words in foreign_words.items() if words} == {}


def test_a_planted_function_is_found():
    tree = ast.parse(
        "import warp as wp\n"
        "@wp.func\ndef bad(x: float): return wp.sin(x) + x ** 2.0\n"
        "@wp.kernel(module='unique')\ndef worse(): wp.atomic_add(a, 0, wp.randf(s))\n"
        "@wp.func\ndef good(x: float): return wp.sqrt(x) + wp.sign(x) + wp.float32(1)\n"
        "def host(x): return x ** 2.0 + wp.sin(x)\n"
    )
    assert [foreign(f) for f in functions(tree)] == [
        {"sin", "**"},
        {"atomic_add", "randf"},
        set(),
    ]
    assert [
        m[0] for m in NATIVE.finditer("x = expf(y) + __expf (y) + sqrtf(y) + atan2(y, x);")
    ] == [
        "expf(",
        "__expf (",
        "atan2(",
    ]
