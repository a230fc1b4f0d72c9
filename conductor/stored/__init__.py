"""A conductor's journal in a result store: who owns it, its replica, and what a successor finds."""
