"""The bridge to scripts of the AutoDRIVE devkit."""

from devkit.bridges.autodrive.bridge import AutodriveBridge

__all__ = ["AutodriveBridge"]
