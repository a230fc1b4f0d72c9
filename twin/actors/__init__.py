"""What moves besides the ego: bodies, and scripts that move them."""
