"""``devkit host``: the process that runs a stack on the bus."""
