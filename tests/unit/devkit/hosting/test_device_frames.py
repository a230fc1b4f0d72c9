"""Which stacks get their frames in a GPU's memory."""

from devkit.aeb import AebStack
from devkit.hosting.host import takes_device_frames


class Derived(AebStack):
    """It may index the camera's array as NumPy's."""


class Knowing(AebStack):
    """It says that it does not."""

    takes_device_frames = True


def test_only_a_class_that_says_so_itself():
    found = [takes_device_frames(kind(1)) for kind in (AebStack, Derived, Knowing)]
    assert found == [True, False, True]
