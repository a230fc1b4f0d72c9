"""``viewer live``: running cases."""
