"""Many commands of one tool, each in a process of its own that was forked after the imports."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

_FORKS = """
import importlib, json, os, sys, tempfile
tool, imports, commands = json.load(sys.stdin)
main = importlib.import_module(tool + ".cli").main
for name in imports:
    importlib.import_module(name)
done = []
for words in commands:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if not child:
            code = 70
            try:
                os.dup2(out.fileno(), 1), os.dup2(err.fileno(), 2)
                sys.argv = [tool, *words]
                main()
                code = 0
            except SystemExit as stop:
                code = stop.code or 0
            finally:
                sys.stdout.flush(), sys.stderr.flush()
                os._exit(code)
        _, status = os.waitpid(child, 0)
        said = [os.pread(file.fileno(), 1 << 20, 0).decode() for file in (out, err)]
        done.append([os.waitstatus_to_exitcode(status), *said])
json.dump(done, sys.stdout)
"""


def run_many(
    tool: str, commands: Sequence[Sequence[str]], imports: Sequence[str] = ()
) -> list[subprocess.CompletedProcess[str]]:
    """Run ``TOOL WORDS...`` for each of ``commands``; ``imports`` are imported before, once."""
    asked = json.dumps([tool, list(imports), [list(words) for words in commands]])
    told = subprocess.run(
        [sys.executable, "-c", _FORKS],
        input=asked,
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    return [
        subprocess.CompletedProcess(list(words), code, out, err)
        for words, (code, out, err) in zip(commands, json.loads(told.stdout), strict=True)
    ]
