"""Detectors: ONNX files, what runs them, and what they are worth."""
