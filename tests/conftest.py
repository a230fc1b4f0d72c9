"""Being here puts ``tests/`` on the import path, for the modules that tests share."""
