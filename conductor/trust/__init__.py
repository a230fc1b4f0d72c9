"""Signatures of finished runs, and how verdicts are checked again."""
