"""Import this first: Ctrl-C while modules are still loading ends the process, without a traceback.

:func:`twin.fabric.cli.run` takes the signal over when everything is there.
"""

import signal

signal.signal(signal.SIGINT, signal.SIG_DFL)
