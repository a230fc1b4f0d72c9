"""Transcendental functions with the same bits on CPU and CUDA; see ``twin.base.portable_math``."""
