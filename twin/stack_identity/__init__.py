"""Which files a stack under test consists of, found without importing it, and their digest."""
