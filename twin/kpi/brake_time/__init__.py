"""How long the stack asked for braking."""
