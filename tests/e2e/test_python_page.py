"""docs/python.md and the notebooks do what they say, from their first block to their last."""

from __future__ import annotations

import json
import re
from pathlib import Path

import nbformat
import pytest
from processes import outcomes
from python_tasks import LONG, LONG_CASES, task, written

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))

EXECUTE = """
    import os
    for name in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "MPLCONFIGDIR"):
        os.environ[name] = os.path.abspath("own")
    import nbformat
    from nbclient import NotebookClient

    book = nbformat.read({path!r}, as_version=4)
    NotebookClient(book, timeout=600, kernel_name="python3", allow_errors=True).execute()
    nbformat.write(book, "done.ipynb")
"""

INTERRUPT = """
    import signal, sys, threading
    sys.path.append({tests!r})
    from pathlib import Path

    def interrupt():
        wait_for(Path("begun").exists, "a case that has ended")
        os.kill(int(Path("kernel").read_text()), signal.SIGINT)

    from waiting import wait_for
    threading.Thread(target=interrupt, daemon=True).start()
"""
"""Jupyter's *Interrupt* is this signal."""
LONG_CELLS = [
    "import drivetwin, os, threading\nfrom pathlib import Path\n"
    "Path('kernel').write_text(str(os.getpid()))",
    "started = drivetwin.start('long.yaml', workers=1, slots=1)\n"
    "def tell():\n"
    "    for event in started.events():\n"
    "        if isinstance(event, drivetwin.RunProgress) and event.ended:\n"
    "            return Path('begun').touch()\n"
    "threading.Thread(target=tell).start()\n"
    "started.wait()",
    "print('complete', drivetwin.open('runs/long').outcomes().complete)",
    "drivetwin.run('long.yaml', workers=1, slots=64, progress=False)",
]


def test_every_block_of_the_page(marked, tmp_path):
    blocks = BLOCK.findall((DOCS / "python.md").read_text())
    assert len(blocks) >= 8
    code = "\n".join(f"print('block', {n})\n{block}" for n, block in enumerate(blocks))
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    said = re.split(r"^block \d+\n", done.stdout, flags=re.MULTILINE)[1:]
    assert len(said) == len(blocks)
    assert all(said), "each of them prints something"
    assert "of 1 passed" in said[0]
    assert "b'm'" in said[1]
    assert "did you mean 'clear'?" in "".join(said)
    assert "(180, 320, 3) uint8" in "".join(said)


def test_there_are_three_notebooks_without_outputs():
    assert len(NOTEBOOKS) == 3
    for path in NOTEBOOKS:
        cells = json.loads(path.read_text())["cells"]
        assert all(not cell.get("outputs") and not cell.get("execution_count") for cell in cells)
        assert path.stat().st_size < 20_000
        assert f"notebooks/{path.name}" in (DOCS / "python.md").read_text()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_its_first_cell_to_its_last(marked, tmp_path, path):
    done = marked.run(task(tmp_path, EXECUTE.format(path=str(path))), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    cells = json.loads((tmp_path / "done.ipynb").read_text())["cells"]
    shown = json.dumps([cell.get("outputs") for cell in cells])
    assert '"output_type": "error"' not in shown
    ended = [run for run in (tmp_path / "runs").iterdir() if outcomes(run)]
    assert ended
    if path.stem == "first-campaign":
        assert shown.count("image/png") == 2
        assert "report.html</a>" in shown
    elif path.stem == "your-own-stack":
        assert "did you mean 'clear'?" in shown
        assert "('clear', 'pass', 'collision')" in shown, "the stack that brakes late collides"
        assert "2 cases have become worse" in shown
    else:
        assert "proposed cases failed" in shown
        assert "collision" in shown


def test_a_notebook_without_widgets_shows_lines(marked, tmp_path):
    (tmp_path / "small.yaml").write_text(
        "campaign: small\nsimulator: noop\nmatrix: {repeat: [0, 1, 2]}\n"
    )
    book = nbformat.v4.new_notebook()
    book.cells = [
        nbformat.v4.new_code_cell('import sys\nsys.modules["ipywidgets"] = None'),
        nbformat.v4.new_code_cell("import drivetwin\ndrivetwin.run('small.yaml', workers=1)"),
    ]
    nbformat.write(book, tmp_path / "small.ipynb")
    done = marked.run(task(tmp_path, EXECUTE.format(path="small.ipynb")), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    outputs = json.loads((tmp_path / "done.ipynb").read_text())["cells"][1]["outputs"]
    said = "".join("".join(output.get("text", [])) for output in outputs)
    assert "small: 3 of 3 cases done" in said
    assert "ipywidgets" not in said


def test_an_interrupted_cell_goes_on_when_it_runs_again(marked, tmp_path):
    written(tmp_path, LONG)
    book = nbformat.v4.new_notebook()
    book.cells = [nbformat.v4.new_code_cell(cell) for cell in LONG_CELLS]
    nbformat.write(book, tmp_path / "long.ipynb")
    here, execute = str(Path(__file__).parents[1]), EXECUTE.format(path="long.ipynb")
    before, after = execute.split("    import nbformat\n")
    code = before + INTERRUPT.format(tests=here) + "    import nbformat\n" + after
    done = marked.run(task(tmp_path, code), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    _, cut, state, again = json.loads((tmp_path / "done.ipynb").read_text())["cells"]
    assert [o["ename"] for o in cut["outputs"] if o["output_type"] == "error"] == [
        "KeyboardInterrupt"
    ]
    assert "interrupted; the same call goes on" in json.dumps(cut["outputs"])
    assert "complete False" in json.dumps(state["outputs"])
    assert f"{LONG_CASES} of {LONG_CASES} passed" in json.dumps(again["outputs"])
