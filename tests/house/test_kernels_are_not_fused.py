"""Kernels have the same bytes on CPU and GPU: they never fuse a product and a sum.

``wp.set_module_options`` is for the kernels of its own file. A kernel with ``module="unique"`` has
a module of its own, which ignores it: its decorator has to say ``module_options``.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from twin.render.build import KernelOptions

ROOT = Path(__file__).parents[2]

BUILD = "build.arguments()"
"""Arguments of a kernel that come from :class:`twin.render.build.KernelOptions`."""


def files(folder: str = "twin") -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def kernels(tree: ast.AST) -> Iterator[tuple[str, dict[str, ast.expr]]]:
    """Names of kernels and the keywords of their decorators."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            for decorator in node.decorator_list:
                call = decorator.func if isinstance(decorator, ast.Call) else decorator
                if ast.unparse(call) == "wp.kernel":
                    given = decorator.keywords if isinstance(decorator, ast.Call) else []
                    yield node.name, {k.arg or ast.unparse(k.value): k.value for k in given}


def unfused(options: ast.expr | None) -> bool:
    """Whether a literal of options switches fusing off."""
    if not isinstance(options, ast.Dict):
        return False
    pairs = zip(options.keys, options.values, strict=True)
    return any(k and (ast.unparse(k), ast.unparse(v)) == ("'fuse_fp'", "False") for k, v in pairs)


def says_unfused(tree: ast.Module) -> bool:
    """Whether a file's own module does not fuse."""
    for node in tree.body:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            call = node.value
            if ast.unparse(call.func) == "wp.set_module_options" and unfused(call.args[0]):
                return True
    return False


def own_module(keywords: dict[str, ast.expr]) -> bool:
    module = keywords.get("module")
    return isinstance(module, ast.Constant) and module.value == "unique"


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def fused_kernels(tree: ast.Module) -> list[str]:
    """Kernels of a file that may fuse."""
    usual = says_unfused(tree)
    return [
        name
        for name, keywords in kernels(tree)
        if not unfused(keywords.get("module_options"))
        and (own_module(keywords) or not usual)
        and BUILD not in keywords
    ]


def test_no_kernel_fuses():
    found = {p.relative_to(ROOT).as_posix(): fused_kernels(parsed(p)) for p in files()}
    assert len([p for p in files() if list(kernels(parsed(p)))]) > 40
    assert {path: names for path, names in found.items() if names} == {}


def test_no_kernel_of_a_picture_fuses():
    """Their decorators take all arguments from the options of the build."""
    assert KernelOptions(blocks=4).arguments()["module_options"] == {"fuse_fp": False}


def test_a_planted_kernel_is_found():
    planted = ast.parse(
        "import warp as wp\n"
        "wp.set_module_options({'fuse_fp': False})\n"
        "@wp.kernel\ndef good(): ...\n"
        "@wp.kernel(module='unique')\ndef bad(): ...\n"
        "@wp.kernel(module='unique', module_options={'fuse_fp': False})\ndef fine(): ...\n"
        "@wp.kernel(module='unique', module_options={'fuse_fp': True})\ndef worse(): ...\n"
        "@wp.kernel(**build.arguments())\ndef built(): ...\n"
        "@wp.kernel(**other.arguments())\ndef other(): ...\n"
    )
    assert fused_kernels(planted) == ["bad", "worse"]
    unsaid = ast.parse("@wp.kernel(**other.arguments())\ndef plain(): ...\n")
    assert fused_kernels(unsaid) == ["plain"]
    assert fused_kernels(ast.parse("@wp.kernel\ndef plain(): ...\n")) == ["plain"]
