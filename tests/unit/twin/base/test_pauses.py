"""Loading is not searched for garbage; what comes after is, and nothing stays switched off."""

import subprocess
import sys

CODE = """
import gc, weakref
from twin.base.pauses import YOUNG_MAX, loading, settle

class Node:
    pass

def cycle():
    node = Node()
    node.itself = node
    return weakref.ref(node)

gc.set_threshold(10, 2, 2)
searched = []
try:
    with loading():
        assert not gc.isenabled()
        gc.callbacks.append(lambda phase, info: searched.append(phase))
        made = [[k] for k in range(1000)]
        early = cycle()
        assert not searched, searched
        raise ImportError("no such module")
except ImportError:
    pass
assert gc.isenabled()
frozen = gc.get_freeze_count()
assert frozen >= 1000, frozen
late = cycle()
settle()
assert early() is not None, "a search among what was loaded"
assert late() is None, "no search among what came later"
assert gc.isenabled() and gc.get_threshold()[0] == YOUNG_MAX
assert gc.get_freeze_count() >= frozen
print("well")
"""


def test_what_is_loaded_is_left_alone_and_the_rest_is_not():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True)
    assert done.stdout == "well\n", done.stderr
