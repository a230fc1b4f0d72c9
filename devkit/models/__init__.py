"""Shipped networks: ``NAME.onnx``, and ``NAME.md``, its model card."""
