"""Generated roads and traffic for free driving, in parts whose seeds a commit decides."""
