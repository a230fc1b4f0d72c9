"""A conductor reads declarations alone: no simulator, and nobody's implementation, is in it."""

import json
import subprocess
import sys

import pytest
from plugin_site import beside

CAMPAIGN = """\
campaign: stop-line
control_hz: 20
camera: {width: 64, height: 36, hz: 10}
render: false
scenario: {type: stop_line, duration_s: 0.5, ego_speed_mps: 5, standstill_s: 0.2}
sensors: {thermometer: {hz: 10}, sonar: {hz: 10}}
autonomy: {stack: "devkit.idle:IdleStack", perception: {none: {type: ground_truth}}}
matrix: {scenario.line_m: [4]}
"""

RUN = """
import json, sys
from conductor.cli import app
try:
    app(sys.argv[1:])
except SystemExit as exit:
    code = exit.code
from schemas.kinds.batch_system import batch_systems
from schemas.kinds.bridge import bridges
from schemas.kinds.kpi import kpi_kinds
from schemas.kinds.scenario import scenario_kinds
from schemas.kinds.sensor import sensor_kinds
tables = (batch_systems(), bridges(), kpi_kinds(), scenario_kinds(), sensor_kinds())
named = {kind.implementation.partition(":")[0] for table in tables for kind in table.declared}
assert {"plugin_example.stop_line", "plugin_example.jerk", "plugin_example.sonar"} <= named
found = [name for name in sys.modules if name in named or name.split(".")[0] == "warp"]
print(json.dumps([code, sorted(found)]))
"""


@pytest.mark.parametrize(
    "words", [("validate", "{file}"), ("run", "{file}", "--workers", "1", "--out", "{out}")]
)
def test_a_conductor_imports_no_implementation(tmp_path, words):
    """``run`` leases to a real worker, and writes its report."""
    env = beside(tmp_path / "site", "1.0")
    file = tmp_path / "stop-line.yaml"
    file.write_text(CAMPAIGN)
    given = [word.format(file=file, out=tmp_path / "out") for word in words]
    done = subprocess.run(
        [sys.executable, "-c", RUN, *given], env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    code, found = json.loads(done.stdout.splitlines()[-1])
    assert code in (0, 1), done.stdout + done.stderr
    assert found == []
