"""The ego is to stop between two things that stand at its lane."""
