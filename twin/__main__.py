"""``python -m twin``, as which our own processes start each other."""

import sys

import twin.base.start  # noqa: F401
from twin.base.process import bind_to_parent

bind_to_parent()  # before all that takes long to load

if len(sys.argv) == 3 and sys.argv[1] == "sim" and not sys.argv[2].startswith("-"):
    # Its worker tells it everything else: no command line is to be read.
    from twin.base.gpu.first_use import begin

    begin(sys.argv[2])  # before what takes long to load
    from twin.rig.sim_process import main as simulate

    sys.exit(simulate(sys.argv[2]))
elif len(sys.argv) == 4 and tuple(sys.argv[1:3]) == ("worker", "-"):
    # `conductor run` tells it everything, in the same way.
    from twin.worker.preload import main as work

    work(sys.argv[3])
else:
    from twin.cli import main

    sys.exit(main())
