"""Compiler of OpenSCENARIO files: effective scenarios become storyboard programs."""
