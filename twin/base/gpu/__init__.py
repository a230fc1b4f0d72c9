"""GPUs as processes see them before Warp is loaded."""
