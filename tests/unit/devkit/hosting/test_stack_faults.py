"""What a stack raises is its own, unless the machine is to blame."""

import errno

import pytest

from devkit.hosting.faults import is_machines, refusal, told
from devkit.hosting.host import Inline
from schemas.messages import Episode
from schemas.sections.stack_identity import StackSource
from twin.base.errors import InfrastructureError, StackFaultError, UsageError


class OutOfMemoryError(RuntimeError):
    """As torch and CuPy call it."""


@pytest.mark.parametrize(
    ("error", "machines"),
    [
        (RuntimeError("lens cap on"), False),
        (SystemExit(7), False),
        (FileNotFoundError(errno.ENOENT, "no such file"), False),
        (StackFaultError("script: nonsense"), False),
        (OSError(errno.ENOSPC, "full"), True),
        (MemoryError(), True),
        (OutOfMemoryError("CUDA out of memory"), True),
        (InfrastructureError("nobody listens"), True),
    ],
)
def test_who_is_to_blame(error, machines):
    assert is_machines(error) is machines
    assert refusal(3, error).infrastructure is machines


def test_a_traceback_is_told_with_its_frames_and_a_line_for_people_alone(capsys):
    try:
        raise KeyError("x")
    except KeyError as error:
        told(error)
    told(UsageError("one line"))
    told(None)
    said = capsys.readouterr().err
    assert said.startswith("Traceback (most recent call last):\n")
    assert "test_stack_faults.py" in said
    assert said.endswith("KeyError: 'x'\none line\n")


MODULE = """
from devkit.stack import Stack


class Broken(Stack):
    def __init__(self, slots, *, where="init"):
        super().__init__(slots)
        if where == "memory":
            raise MemoryError
        if where == "init":
            raise RuntimeError("no lens")

    def reset(self, slot, episode: "{episode}"):
        raise SystemExit(7)

    def step(self, observation):
        return []
"""


def test_a_stack_that_cannot_be_loaded_says_whose_doing_that_is(tmp_path, monkeypatch, capsys):
    (tmp_path / "broken_stack.py").write_text(MODULE.format(episode=Episode.__name__))
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(StackFaultError, match="stack: broken_stack:Broken: RuntimeError: no lens"):
        Inline("broken_stack:Broken", 1, {}, StackSource())
    assert "line 11, in __init__" in capsys.readouterr().err
    with pytest.raises(StackFaultError, match="unknown parameter"):
        Inline("broken_stack:Broken", 1, {"speed": 3}, StackSource())
    for entry, parameters in (("broken_stack:Broken", {"where": "memory"}), ("nowhere:Stack", {})):
        with pytest.raises(InfrastructureError) as caught:
            Inline(entry, 1, parameters, StackSource())
        assert not isinstance(caught.value, StackFaultError)
