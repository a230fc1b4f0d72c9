"""The script that measures the house sees what is beyond a limit."""

from pathlib import Path

import shape


def house_of(tmp_path: Path, **files: str) -> dict[str, bool]:
    (tmp_path / "twin").mkdir()
    for name, text in files.items():
        (tmp_path / "twin" / f"{name}.py").write_text(text)
    return {what: kept for what, _, _, kept in shape.lines(shape.look(tmp_path))}


def test_what_keeps_every_limit(tmp_path):
    found = house_of(
        tmp_path, a="class A:\n    def f(self):\n        pass\n\n@wp.func\ndef g():\n    pass\n"
    )
    assert all(found.values()), found


def test_what_is_too_long_or_twice_is_told(tmp_path):
    body = "    pass\n" * 70
    twenty = {f"m{n}": "x = 1\n" for n in range(20)}
    found = house_of(
        tmp_path,
        a=f"class A:\n    pass\n\n\ndef f():\n{body}\n@wp.kernel\ndef g():\n{body}{body}",
        b="class A:\n    pass\n" + "# line\n" * 600,
        **twenty,
    )
    missed = {what for what, kept in found.items() if not kept}
    assert missed == {
        "file lines, longest",
        "function lines, 90 % below",
        "function lines, longest",
        "kernel lines, longest",
        "modules in a folder, most",
        "public class names that occur twice",
    }
