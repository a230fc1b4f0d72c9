"""Commands of ``conductor``, and what they print."""
