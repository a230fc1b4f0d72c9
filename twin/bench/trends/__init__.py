"""All benches at once, held against earlier runs."""
