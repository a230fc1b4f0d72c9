"""The wheel encoders."""
