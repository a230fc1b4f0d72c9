"""The worker: leases cases and runs them in rigs (a simulator and a stack process)."""
