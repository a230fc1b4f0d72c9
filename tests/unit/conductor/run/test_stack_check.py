"""A stack is checked by its source, and nothing of it is run."""

from __future__ import annotations

import sys

import pytest

import conductor.run.stack_check
from conductor.run.source import check, load, shipped
from schemas.device_class import is_portable
from schemas.sections.autonomy import Autonomy
from twin.stack_identity.stack_class import class_mistakes, says_portable

STACK = """
from devkit.stack import Stack

class Plain(Stack):
    pass

class Tuned(Stack):
    def __init__(self, slots, *, speed_mps=8.0, ttc_s: float = 2.0):
        super().__init__(slots)

class Finer(Tuned):
    def step(self, observation): ...

class Part(Struct, frozen=True):
    gain: float = 1.0

class Listed(Stack):
    PARAMETERS = (Part,)
    def __init__(self, slots, **parameters): ...

class Open(Stack):
    def __init__(self, slots, **more): ...

class _Private(Stack): ...

if True:
    class Conditional(Stack): ...

Made = type("Made", (Stack,), {})
from devkit.aeb import AebStack as Renamed
from .beside import Beside
from unknown_library import Foreign
class Derived(Foreign): ...
"""
EXIT = "raise SystemExit(0)\n"
"""A module that ends whoever imports it, as if all were well."""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """The package ``own_stacks`` with a subpackage; importing any of it ends the process."""
    folder = tmp_path / "own_stacks" / "sub"
    folder.mkdir(parents=True)
    (tmp_path / "own_stacks" / "__init__.py").write_text(EXIT)
    (folder / "__init__.py").write_text(EXIT)
    (folder / "stack.py").write_text(EXIT + STACK)
    (folder / "beside.py").write_text(EXIT + "class Beside:\n    def __init__(self, slots, a): 0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "own_stacks.sub.stack"
    assert not any(name.startswith("own_stacks") for name in sys.modules)


def lines(stack, **parameters):
    """What is wrong with a campaign of this stack."""
    autonomy = {"stack": stack, "parameters": parameters}
    _, mistakes = check({"campaign": "c", "autonomy": autonomy, "matrix": {"repeat": [0]}})
    return [mistake.line("c.yaml") for mistake in mistakes]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("Plain", {}),
        ("Tuned", {"speed_mps": 3, "ttc_s": 1}),
        ("Finer", {"ttc_s": 1}),
        ("Listed", {"gain": 2.0}),
        ("Open", {"anything": 1}),
        ("Conditional", {}),
        ("Made", {"anything": 1}),
        ("Renamed", {"cruise_speed_mps": 5.0}),
        ("Beside", {"a": 1}),
        ("Foreign", {"anything": 1}),
        ("Derived", {"anything": 1}),
    ],
)
def test_a_stack_that_may_be_built_passes_without_being_imported(package, name, parameters):
    assert lines(f"{package}:{name}", **parameters) == []


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("Tund", {}, ["autonomy.stack: given", "no class 'Tund'", "did you mean 'Tuned'?"]),
        ("Tuned", {"speed": 3}, ["autonomy.parameters.speed: unknown", "'speed_mps'", "ttc_s"]),
        ("Finer", {"speed": 3}, ["unknown parameter of", ":Finer", "speed_mps"]),
        ("Listed", {"gian": 2.0}, ["unknown parameter of", "did you mean 'gain'?"]),
        ("Plain", {"speed": 3}, ["unknown parameter of", "it takes none"]),
        ("Renamed", {"cruise_mps": 5}, ["did you mean 'cruise_speed_mps'?"]),
        ("Beside", {"b": 1}, ["unknown parameter of", "allowed: a"]),
    ],
)
def test_a_missing_class_or_an_unknown_parameter_is_one_line(package, name, parameters, words):
    (line,) = lines(f"{package}:{name}", **parameters)
    assert all(word in line for word in words), line
    assert "_Private" not in line


def test_parameters_that_are_an_axis_are_checked_too(package):
    data = {
        "campaign": "c",
        "autonomy": {"stack": f"{package}:Tuned"},
        "matrix": {"autonomy.parameters.sped_mps": [1.0, 2.0]},
    }
    _, (mistake,) = check(data)
    assert mistake.path == "autonomy.parameters.sped_mps"


@pytest.mark.parametrize("module", ["own_stacks.sub.none", "own_stacks.sub.stack.none", "nowhere"])
def test_a_missing_module_is_one_line(package, module):
    (line,) = lines(f"{module}:Stack")
    assert f"no module '{module}'" in line


def test_the_shipped_stacks_pass():
    assert lines(Autonomy().stack, cruise_speed_mps=5) == []
    for name in shipped():
        assert load(name).campaign.campaign == name


def test_a_missing_package_of_a_bridge_is_one_line(monkeypatch):
    real = conductor.run.stack_check.locate
    monkeypatch.setattr(
        conductor.run.stack_check,
        "locate",
        lambda name: None if name == "websockets" else real(name),
    )
    autonomy = {"command": ["python", "script.py"], "bridge": "autodrive"}
    sensors = {name: {} for name in ("encoders", "imu", "pose")}
    data = {"autonomy": autonomy, "sensors": sensors, "cameras": [{"name": "front_left"}]}
    _, mistakes = check({"campaign": "c", **data, "matrix": {"repeat": [0]}})
    (line,) = [mistake.line("c.yaml") for mistake in mistakes]
    assert "autonomy.bridge: 'autodrive' needs the package websockets" in line
    assert "pip install 'drivetwin[autodrive]'" in line


@pytest.mark.parametrize("stack", ["devkit.aeb:AebStack", "devkit.fusion:FusionStack"])
def test_a_stack_that_drives_by_a_camera_is_refused(stack):
    data = {
        "schema": 1,
        "campaign": "c",
        "render": False,
        "matrix": {"weather": ["clear"]},
        "autonomy": {"stack": stack},
    }
    _, mistakes = check(data)
    assert [m.line("c.yaml") for m in mistakes] == [
        f"c.yaml: render: stack {stack} drives by a camera, and none sees; name another"
    ]
    assert check(data | {"render": True})[0] is not None


def test_a_stack_of_ones_own_says_whether_it_drives_by_a_camera(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "seeing_stack.py").write_text(
        "from devkit.stack import Stack\n"
        "class Seeing(Stack):\n    drives_by_camera = True\n"
        "class Its(Seeing):\n    pass\n"
        "class Blind(Seeing):\n    drives_by_camera = False\n"
    )
    refused = {
        name: bool(class_mistakes(f"seeing_stack:{name}", [], blind=True))
        for name in ("Seeing", "Its", "Blind")
    }
    assert refused == {"Seeing": True, "Its": True, "Blind": False}
    assert not class_mistakes("seeing_stack:Seeing", [])


def test_a_class_is_portable_only_if_it_says_so_itself(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "portable_stack.py").write_text(
        "from typing import ClassVar\n"
        "from devkit.aeb import AebStack\n"
        "from devkit.idle import IdleStack as Renamed\n"
        "class Its(AebStack):\n    pass\n"
        "class Says(AebStack):\n    portable: ClassVar[bool] = True\n"
        "class Denies(AebStack):\n    portable = False\n"
        "class Changes(AebStack):\n    portable = True\n    portable = bool(0)\n"
        "class Guesses(AebStack):\n    portable = 1\n"
    )
    said = ("Its", "Says", "Denies", "Changes", "Guesses", "AebStack", "Renamed", "Missing")
    found = [name for name in said if says_portable(f"portable_stack:{name}")]
    assert found == ["Says", "AebStack", "Renamed"]
    for nothing in ("no_such_module:Stack", "math:Stack", "devkit.aeb", ""):
        assert not says_portable(nothing)


def test_what_a_campaign_file_claims_of_its_stack_does_not_count(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "silent_stack.py").write_text(
        "from devkit.stack import Stack\nclass Silent(Stack):\n    pass\n"
    )
    path = tmp_path / "claims.yaml"
    path.write_text(
        "campaign: claims\nmatrix: {repeat: [0]}\nstack_identity: {portable: true}\n"
        "autonomy: {stack: 'silent_stack:Silent', perception: {truth: {type: ground_truth}}}\n"
    )
    assert not is_portable(load(str(path)).campaign)


@pytest.mark.parametrize(
    ("name", "portable"),
    [
        ("lane-loop", True),
        ("aeb-demo-int8", True),
        ("aeb-256", False),  # float networks
        ("aeb-fusion", False),
    ],
)
def test_shipped_campaigns_say_whether_devices_may_mix(name, portable):
    assert is_portable(load(name).campaign) is portable


@pytest.mark.parametrize(
    ("bridge", "parameters", "words"),
    [
        ("autodrive", {"port": 70_000}, ["parameters.port: given 70000, allowed: a whole number"]),
        ("autodrive", {"prot": 4000}, ["parameters.prot: unknown parameter"]),
        ("autodrive", {"port": 4000, "start_s": 1.5}, []),
        ("ros2", {"answer": "stmp"}, ["parameters.answer: given 'stmp', allowed: newest, stamp"]),
        ("ros2", {"domian": 3}, ["parameters.domian: unknown parameter"]),
        (
            "ros2",
            {"domain": 999, "throttle_gain": "x"},
            ["parameters.domain: given 999", "parameters.throttle_gain: given 'x'"],
        ),
    ],
)
def test_parameters_of_a_bridge_are_looked_at_before_a_rig_is_built(bridge, parameters, words):
    data = {
        "campaign": "bridged",
        "autonomy": {"command": ["python", "x.py"], "bridge": bridge, "parameters": parameters},
        "matrix": {"weather": ["clear"]},
    }
    _, mistakes = check(data, None)
    lines = [m.line("f") for m in mistakes if m.path.startswith("autonomy.parameters")]
    assert len(lines) == len(words), lines
    assert all(word in line for word, line in zip(words, sorted(lines), strict=True)), lines


def test_a_bridge_that_prints_while_it_is_imported_is_asked_all_the_same(tmp_path, monkeypatch):
    (tmp_path / "sitecustomize.py").write_text("print('loaded {}')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    autonomy = Autonomy(bridge="autodrive", command=["x"], parameters={"port": 70_000})
    (mistake,) = conductor.run.stack_check.bridge_mistakes(autonomy)
    assert mistake.path == "autonomy.parameters.port"


def test_a_devkit_that_does_not_answer_is_no_mistake(monkeypatch):
    monkeypatch.setattr(conductor.run.stack_check.sys, "executable", "/bin/false")
    autonomy = Autonomy(bridge="autodrive", command=["x"], parameters={"port": 70_000})
    assert conductor.run.stack_check.bridge_mistakes(autonomy) == []
