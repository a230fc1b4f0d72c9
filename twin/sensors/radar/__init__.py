"""A frequency-modulated radar."""
