"""Parts of the reference stack."""
