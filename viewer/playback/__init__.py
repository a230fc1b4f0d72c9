"""Recordings read back: pictures, films, tables."""
