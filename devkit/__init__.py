"""What an autonomy engineer touches: the stack interface and the reference stack.

Start at :mod:`devkit.stack`. Nothing here needs the simulator, so a stack also runs on recorded
data.
"""
