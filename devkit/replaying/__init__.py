"""``devkit replay`` and ``devkit parity``: recorded drives for a stack."""
