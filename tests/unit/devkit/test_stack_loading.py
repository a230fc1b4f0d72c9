"""devkit.stack: the interface and the one-line errors of load_stack."""

from __future__ import annotations

import importlib.util
import sys
import textwrap

import numpy as np
import pytest

import devkit.stack
from devkit.aeb import AebStack
from devkit.stack import Observation, Stack, StackError, StackMissingError, load_stack
from schemas.messages import Command, Episode
from schemas.sections.autonomy import Autonomy
from schemas.sections.perception import GroundTruthPerception


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes a module of the given source that load_stack can import."""
    monkeypatch.syspath_prepend(str(tmp_path))
    written = []

    def write(name: str, source: str) -> None:
        (tmp_path / f"{name}.py").write_text(textwrap.dedent(source), encoding="utf-8")
        written.append(name)

    yield write
    for name in written:
        sys.modules.pop(name, None)


BASE = """
    from devkit.stack import Stack
    class Base(Stack):
        def reset(self, slot, episode): ...
        def step(self, observation): return []
"""


def test_the_campaigns_default_stack_loads():
    stack = load_stack(Autonomy().stack, 2, {"cruise_speed_mps": 5, "frames_min": 3})
    assert isinstance(stack, AebStack)
    assert isinstance(stack, Stack)
    assert stack.planner.cruise_speed_mps == 5.0
    assert stack.planner.frames_min == 3
    stack.close()


def error_of(entry_point: str, parameters=None, slots: int = 1) -> str:
    with pytest.raises(StackError) as caught:
        load_stack(entry_point, slots, parameters or {})
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("entry_point", ["devkit.aeb", "devkit.aeb:", ":AebStack", ""])
def test_malformed_entry_point(entry_point):
    assert "expected module:Class" in error_of(entry_point)


@pytest.mark.parametrize("entry_point", ["nosuchmodule:X", "devkit.nosuchmodule:X"])
def test_module_not_found(entry_point):
    assert "no module named" in error_of(entry_point)


def test_module_that_fails_to_import_names_the_real_reason(module):
    module("st_needs", "import nosuchdependency")
    assert "st_needs: import failed: No module named 'nosuchdependency'" in error_of("st_needs:X")
    module("st_broken", "raise OSError('first\\nsecond')")
    assert error_of("st_broken:X") == "st_broken: import failed: OSError: first"


def test_class_missing_suggests_the_near_one():
    message = error_of("devkit.aeb:AebStak")
    assert "no class 'AebStak'" in message
    assert "did you mean 'AebStack'?" in message


def test_something_that_is_not_a_class_or_not_a_stack(module):
    module("st_other", "VALUE = 3\nclass Thing: ...\n")
    assert "no class 'VALUE'" in error_of("st_other:VALUE")
    assert "not a stack, without reset, step, close" in error_of("st_other:Thing")


def test_unknown_parameter_says_which_are_allowed():
    message = error_of("devkit.aeb:AebStack", {"cruise_speed": 8.0})
    assert "unknown parameter 'cruise_speed'; did you mean 'cruise_speed_mps'?" in message
    assert "clear_below_per_m" in message
    assert "slots" not in message
    assert "unknown parameter 'slots'" in error_of("devkit.aeb:AebStack", {"slots": 3})


def test_parameters_of_a_stack_that_takes_none_or_any(module):
    module("st_none", BASE + "        def __init__(self, slots): ...\n")
    assert "unknown parameter 'a'; it takes none" in error_of("st_none:Base", {"a": 1})
    module("st_any", BASE + "        def __init__(self, slots, **p): self.p = p\n")
    assert load_stack("st_any:Base", 1, {"a": 1}).p == {"a": 1}


def test_missing_parameter(module):
    module("st_must", BASE + "        def __init__(self, slots, *, model): ...\n")
    assert error_of("st_must:Base") == "st_must:Base: parameter 'model' is missing"


def test_constructor_that_fails(module):
    module("st_fails", BASE + "        def __init__(self, slots): raise RuntimeError('a\\nb')\n")
    assert error_of("st_fails:Base") == "st_fails:Base: RuntimeError: a"
    module("st_silent", BASE + "        def __init__(self, slots): raise ValueError\n")
    assert error_of("st_silent:Base") == "st_silent:Base: ValueError"
    module("st_abstract", "from devkit.stack import Stack\nclass S(Stack): ...\n")
    assert "abstract" in error_of("st_abstract:S")


def test_no_slots():
    assert "given 0 slots, at least 1 needed" in error_of("devkit.aeb:AebStack", slots=0)


def test_the_example_in_the_documentation_works(module):
    block = devkit.stack.__doc__.split("complete::", 1)[1].split("Name it", 1)[0]
    module("st_example", block)
    stack = load_stack("st_example:GapStack", 2, {"gap_m": 10.0})
    for slot in range(2):
        stack.reset(
            slot,
            Episode(
                v=1,
                seq=0,
                slot=slot,
                token=slot + 7,
                case="c",
                seed=0,
                model="default",
                perception=GroundTruthPerception(),
                camera="front",
                width=64,
                height=36,
                hfov_deg=70.0,
                control_period_ns=50_000_000,
            ),
        )
    boxes = np.zeros((2, 4, 7), np.float32)
    boxes[0, 0, 6] = 9.0  # near enough
    boxes[1, 0, 6] = 11.0  # not near enough; the rows after it are padding at distance 0
    observation = Observation(
        seq=0,
        active=np.array([True, True]),
        token=np.array([7, 8]),
        tick=np.array([0, 3], np.int32),
        sim_time_ns=np.array([0, 150_000_000]),
        sensors={"boxes": boxes},
        counts={"boxes": np.array([1, 1])},
    )
    commands = stack.step(observation)
    assert commands == [
        Command(slot=0, token=7, tick=0, throttle=0.0, brake=1.0, steering_rad=0.0, aeb=True),
        Command(slot=1, token=8, tick=3, throttle=0.3, brake=0.0, steering_rad=0.0),
    ]


def test_observation_of_a_tick_without_camera_and_with_empty_slots():
    observation = Observation(
        seq=1,
        active=np.array([False, True, True]),
        token=np.zeros(3, np.int64),
        tick=np.zeros(3, np.int32),
        sim_time_ns=np.zeros(3, np.int64),
        sensors={},
        counts={},
    )
    assert observation.active_slots() == [1, 2]
    assert observation.boxes(1) is None


def test_a_stack_of_cv2_is_missing_where_opencv_is(module, monkeypatch):
    """A worker without the extra `networks` is to blame, and the case is not."""
    module("st_sees", "import cv2")
    monkeypatch.setitem(sys.modules, "cv2", None)  # so that importing it fails
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: (name != "cv2" and found(name, *rest)) or None,
    )
    with pytest.raises(StackMissingError, match=r"OpenCV is not installed here; pip install"):
        load_stack("st_sees:X", 1, {})


def test_a_stack_cannot_say_so_where_opencv_is(module):
    module("st_blames", "raise ModuleNotFoundError('no cv2', name='cv2')")
    with pytest.raises(StackError) as refused:
        load_stack("st_blames:X", 1, {})
    assert not isinstance(refused.value, StackMissingError)
