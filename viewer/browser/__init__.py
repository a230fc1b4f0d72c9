"""The viewer in a browser: one loopback port, nothing from outside."""
