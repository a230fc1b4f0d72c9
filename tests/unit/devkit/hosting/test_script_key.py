"""The key that a foreign stack is told of: where it lies, and that nothing of it is left."""

import stat
from pathlib import Path

import msgspec
import pytest

from devkit.hosting.host import _key_of_script
from schemas.sections.foreign import Foreign
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.rig_keys import RigKeys
from twin.fabric.keys.roles import Role


def foreign(**more):
    return msgspec.convert({"command": ["x"], **more}, Foreign)


@pytest.fixture
def key():
    rig = RigKeys("rig")
    yield load_key(rig.stack, Role.stack)
    rig.close()


def test_a_stack_in_a_container_gets_a_copy_where_it_can_see_it(key):
    path, forget = _key_of_script(key, foreign(image={"path": "/images/stack.sif"}))
    copy = Path(path)
    assert copy.parts[:2] == ("/", "tmp")
    assert [stat.S_IMODE(found.stat().st_mode) for found in (copy, copy.parent)] == [0o600, 0o700]
    again = load_key(copy, Role.viewer)
    assert (again.role, again.private) == (Role.stack, key.private)
    forget()
    forget()
    assert not copy.parent.exists()


def test_others_are_told_where_it_is(key):
    assert _key_of_script(key, foreign())[0] == str(key.path)
    assert _key_of_script(None, foreign(image={"path": "/images/stack.sif"}))[0] == ""
