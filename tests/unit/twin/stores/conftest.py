"""Stores for the tests of this folder."""

from store_fixtures import s3_port, store, wire

__all__ = ["s3_port", "store", "wire"]
