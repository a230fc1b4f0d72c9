"""``python -m twin``."""

import sys

if sys.argv[1:] == ["sim"]:
    # Started by a worker, which tells it everything: no command line is to be read.
    import twin.fabric.start  # noqa: F401
    from twin.fabric.process import bind_to_parent

    bind_to_parent()  # before all that takes long to load

    from twin.worker.sim_process import main as simulate

    sys.exit(simulate())

from twin.cli import main

main()
