"""Parts of ``tests/device/bytes_check.py``."""
