"""The contract: message types, topics, wire codec and file types shared by every package."""

SCHEMA_VERSION = 1
"""Wire and file schema version; a peer that speaks another one is refused."""

DRIVE_MINOR = 5
"""Minor version of the drive plane: it rises when messages gain keys that may be left out. Unknown
keys are ignored, so both ends of another minor version understand each other.

0: the first one. 1: ``Ready.minor``, ``Command.handbrake``, the sensor ``pose``, frames in GPU
memory. 2: ``Command.pose``, ``Episode.cosim``. 3: ``Ready.refused``, ``Commands.refused``,
``Command.trigger``, ``Command.reverse``, ``Commands.infrastructure``, ``Episode.ticks_per_rev``.
"""
