"""Certificates of finished runs, and audits that run a random sample of their cases again."""
