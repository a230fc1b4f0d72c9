"""Tables of kinds: what is shipped, and what other distributions bring."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from foreign_distributions import install
from msgspec.structs import fields

import schemas.kinds.batch_system
import schemas.kinds.bridge
import schemas.kinds.kpi
import schemas.kinds.perception
import schemas.kinds.scenario
import schemas.kinds.sensor
from schemas.kinds.kpi import kpi_kinds, scalars_by_name, shipped
from schemas.kinds.registry import implementation
from schemas.kinds.scenario import kind_of, scenario_kinds
from schemas.sections.scenario import Scenario

ROOT = Path(__file__).parents[4]
TABLES = (
    schemas.kinds.scenario,
    schemas.kinds.kpi,
    schemas.kinds.perception,
    schemas.kinds.batch_system,
    schemas.kinds.bridge,
    schemas.kinds.sensor,
)

SCENARIO = '''
from msgspec import Struct
from dataclasses import replace
from schemas.kinds.kpi import KpiKind
from schemas.kinds.scenario import scenario_kinds
from schemas.kinds.scenarios.lane_keeping import KIND as OURS

class Config(Struct):
    gap_m: float
    """Least gap [m]."""
    side: str = "left"
    """Where it comes from."""

KPI = KpiKind(name="gap_min_m", place="scalar", type="float64", unit="m", nullable=True)
KIND = replace(
    OURS, name="cut_in", doc="a car cuts in", config=Config, implementation="nowhere:CutIn",
    kpis=("gap_min_m",),
)
'''

KPI_POINT = "[drivetwin.kpis]\ngaps = other_kinds:KPI"
WHOLE = SCENARIO.replace('"scalar", type="float64"', '"column", type="int32"')
COLUMN = SCENARIO.replace('"scalar"', '"column"')
UNDRAWN = COLUMN + (
    "KIND = replace(KIND, report=replace(OURS.report, curves=('gap_min_m',), overview=()))"
)
TWICE = SCENARIO.replace('("gap_min_m",)', '("speed_mps",)')


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.GROUP)
def test_the_shipped_kinds_are_entry_points_like_those_of_anybody(table):
    points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    assert points[table.GROUP] == table.OURS


@pytest.mark.parametrize("reference", [r for table in TABLES for r in table.OURS.values()])
def test_a_declaration_imports_schemas_and_the_standard_library_only(reference):
    module = reference.partition(":")[0]
    blocked = ("warp", "zenoh", "twin", "conductor", "devkit", "viewer", "hpc", "pyarrow", "numpy")
    code = (
        "import sys\n"
        f"sys.modules.update(dict.fromkeys({blocked!r}))\n"
        f"import importlib; importlib.import_module({module!r})\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE)
    assert done.returncode == 0, done.stderr.decode()


def test_names_are_unique_and_scenarios_have_the_scalars_that_they_show():
    names = [(kind.place, kind.name) for kind in kpi_kinds().declared]
    assert len(names) == len(set(names))
    assert not kpi_kinds().broken
    assert not scenario_kinds().broken
    for kind in scenario_kinds().declared:
        report = kind.report
        columns = {column.name: column for column in (*shipped("column"), *kind.columns)}
        shown = {*report.table, report.lead.scalar, report.extreme.scalar}
        assert shown | {name for _, name in report.beside} <= set(scalars_by_name())
        assert all(scalars_by_name()[name].label for name in report.table)
        assert set(report.overview) <= set(report.curves)
        assert all(columns[name].curve for name in report.curves)
        needed = {key.name: "x" for key in fields(kind.config) if key.required}
        config = kind.config_of(Scenario(type=kind.name, **needed))
        for text in (report.rule, report.rule_in_results, *(t.some for t in report.counted)):
            text.format(**{name: getattr(config, name) for name in config.__struct_fields__})


def test_the_keys_of_a_family():
    scenario = Scenario(type="lane_keeping", lateral_limit_m=0.5)
    config = kind_of(scenario).config_of(scenario)
    assert (config.distance_m, config.lateral_limit_m) == (1000.0, 0.5)


def _with_distribution(folder: Path, points: str, module: str, code: str) -> list[str]:
    """Lines that ``code`` prints beside a distribution ``other 1.5`` with a module."""
    (folder / "other_kinds.py").write_text(module)
    install(folder, "other", "1.5", points)
    prelude = f"import sys; sys.path.insert(0, {str(folder)!r})\n"
    done = subprocess.run(
        [sys.executable, "-c", prelude + code], check=True, cwd=ROOT, stdout=subprocess.PIPE
    )
    return done.stdout.decode().splitlines()


CHECK = """
from schemas.plan import parse_campaign
def check(scenario):
    campaign, mistakes = parse_campaign(
        {"campaign": "c", "scenario": scenario, "matrix": {"weather": ["clear"]}}
    )
    print(*(f"{m.path}: {m.message}" for m in mistakes) if mistakes else ["good"])
    return campaign
"""


def test_a_distribution_brings_a_scenario_and_a_kpi(tmp_path):
    points = (
        "[drivetwin.scenarios]\ncut_in = other_kinds:KIND\n"
        "[drivetwin.kpis]\ngaps = other_kinds:KPI\n"
    )
    lines = _with_distribution(
        tmp_path,
        points,
        SCENARIO,
        CHECK + "import msgspec\n"
        "from schemas.kinds.scenario import kind_of\n"
        "campaign = check({'type': 'cut_in', 'gap_m': 3})\n"
        "one = campaign.scenario\n"
        "print(kind_of(one).config_of(one))\n"
        "check({'type': 'cut_in'})\n"
        "check({'type': 'cut_in', 'gap_m': 'much'})\n"
        "check({'type': 'cut_in', 'gap_m': 1, 'false_braking_m': 2})\n"
        "check({'gap_m': 1})\n"
        "print(b'gap_m' in msgspec.json.encode(check({}).scenario))\n",
    )
    assert lines[:2] == ["good", "Config(gap_m=3.0, side='left')"]
    assert lines[2] == "scenario: Object missing required field `gap_m`"
    assert lines[3].startswith("scenario.gap_m: given 'much', allowed: a number")
    assert "false_braking_m is set, but it belongs to type jump_scare" in lines[4]
    assert "gap_m is set, but it belongs to type cut_in and this is jump_scare" in lines[5]
    assert lines[6:] == ["good", "False"], "who does not use it has nothing of it in a digest"


@pytest.mark.parametrize(
    ("points", "module", "said"),
    [
        ("cut_in = other_kinds:KIND", "import nothing_like_it", "No module named"),
        ("cut_in = other_kinds:KIND", "KIND = 3", "is a int, not a ScenarioKind"),
        ("cut_in = other_kinds:KIND", "1 / 0", "ZeroDivisionError"),
        ("cut_in = other_kinds:KIND", "import sys; sys.exit(3)", "SystemExit: 3"),
    ],
)
def test_what_fails_is_one_line_that_names_its_distribution(tmp_path, points, module, said):
    """And it is told to those alone who ask for it."""
    lines = _with_distribution(
        tmp_path,
        f"[drivetwin.scenarios]\n{points}\n",
        module,
        CHECK + "check({'type': 'cut_in'})\ncheck({})\n",
    )
    assert lines[0].startswith("scenario: ")
    assert said in lines[0]
    assert "cut_in" in lines[0]
    assert "other 1.5: entry point 'cut_in' of drivetwin.scenarios" in lines[0]
    assert lines[1:] == ["good"]


@pytest.mark.parametrize("module", ["import sys; sys.exit(0)", "1 / 0"])
def test_validate_refuses_what_cannot_be_imported_in_one_line(tmp_path, module):
    """An exit at import neither ends the command as a success nor hides the reason."""
    (tmp_path / "other_kinds.py").write_text(module)
    install(tmp_path, "other", "1.5", "[drivetwin.scenarios]\ncut_in = other_kinds:KIND\n")
    campaign = tmp_path / "c.yaml"
    campaign.write_text("campaign: c\nscenario: {type: cut_in}\nmatrix: {weather: [clear]}\n")
    done = subprocess.run(
        [sys.executable, "-m", "conductor", "validate", str(campaign)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))},
        capture_output=True,
        text=True,
    )
    said = done.stdout + done.stderr
    assert done.returncode == 2, said
    told = [line for line in said.splitlines() if "other 1.5: entry point 'cut_in'" in line]
    assert len(told) == 1, said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("module", "said"),
    [
        ("import sys; sys.exit(3)", "SystemExit: 3"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("import nothing_like_it", "No module named 'nothing_like_it'"),
        ("", "has no attribute 'KIND'"),
    ],
)
def test_an_implementation_that_cannot_be_imported_is_one_line(tmp_path, monkeypatch, module, said):
    name = f"implementation_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match=f"'{name}:KIND' cannot be imported: .*{said}"):
        implementation(f"{name}:KIND")


def test_an_implementation_that_ends_its_process_names_its_distribution(tmp_path):
    points = "[drivetwin.scenarios]\ncut_in = other_kinds:KIND"
    code = (
        "from schemas.kinds.registry import implementation\n"
        "try:\n    implementation('other_kinds:CutIn')\n"
        "except ValueError as error:\n    print(error)\n"
    )
    lines = _with_distribution(tmp_path, points, "import sys; sys.exit(3)", code)
    assert lines == ["other 1.5: 'other_kinds:CutIn' cannot be imported: SystemExit: 3"]


@pytest.mark.parametrize(
    ("module", "said"),
    [
        (SCENARIO.replace("KPI =", "OTHER ="), "no distribution declares its KPI 'gap_min_m'"),
        (WHOLE, "its KPI column 'gap_min_m' must be of type float64 and nullable"),
        (UNDRAWN, "its report draws 'gap_min_m', which is no column of its cases with a curve"),
        (TWICE, "its KPI 'speed_mps' is one of every case"),
    ],
)
def test_a_family_whose_kpis_do_not_fit_is_refused_in_one_line(tmp_path, module, said):
    kpis = "" if "OTHER =" in module else KPI_POINT
    lines = _with_distribution(
        tmp_path,
        f"[drivetwin.scenarios]\ncut_in = other_kinds:KIND\n{kpis}\n",
        module,
        CHECK + "check({'type': 'cut_in'})\ncheck({})\n",
    )
    assert lines == [f"scenario: scenario 'cut_in': {said}", "good"]


def test_a_name_is_taken_once(tmp_path):
    lines = _with_distribution(
        tmp_path,
        "[drivetwin.scenarios]\nmine = other_kinds:KIND\n",
        SCENARIO.replace('name="cut_in"', 'name="jump_scare"'),
        CHECK + "check({})\ncheck({'type': 'mine'})\n",
    )
    assert lines[0] == "good"
    assert "other 1.5: entry point 'mine' of drivetwin.scenarios: the name 'jump_scare'" in lines[1]


BRIDGE = """
from schemas.kinds.bridge import BridgeKind

KIND = BridgeKind(
    name="tugboat", doc="the command speaks Tugboat", implementation="other_kinds:Tugboat",
    packages=("json", "no_such_package"), installed_by="other[tug]", port=99, slots_max=3,
    sensors=("imu",), cameras=("mast",),
)
"""


def test_a_distribution_brings_a_bridge(tmp_path):
    lines = _with_distribution(
        tmp_path,
        "[drivetwin.bridges]\ntugboat = other_kinds:KIND\nwreck = other_kinds:WRECK\n",
        BRIDGE,
        """
from schemas.plan import expand, parse_campaign
from schemas.kinds.bridge import lacking_bridges
from twin.worker.rig_process import port_of

def check(**changed):
    autonomy = {"bridge": "tugboat", "command": ["tug"], "slots": 3} | changed
    campaign, mistakes = parse_campaign({
        "campaign": "c", "autonomy": autonomy, "matrix": {"weather": ["clear"]},
        "cameras": [{"name": "mast"}], "sensors": {"imu": {}},
    })
    print(*(f"{m.path}: {m.message}" for m in mistakes) if mistakes else ["good"])
    return campaign

case = expand(check())[0]
rig = case.rig
print(rig.stack, rig.foreign.bridge, rig.slots, port_of(case))
print(lacking_bridges()["tugboat"])
check(slots=4)
check(bridge="wreck")
check(bridge="raft")
""",
    )
    assert lines[:2] == ["good", "other_kinds:Tugboat tugboat 3 99"]
    assert lines[2] == "no package no_such_package: pip install 'other[tug]'"
    assert lines[3] == "autonomy.slots: given 4, a bridge drives 3"
    assert lines[4].startswith("autonomy.bridge: other 1.5: entry point 'wreck' of")
    allowed = "autodrive, none, ros2, tugboat"
    assert lines[5].startswith(f"autonomy.bridge: given 'raft', allowed: {allowed}")
