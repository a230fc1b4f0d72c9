"""Kernels that few programs need, compiled when one of those is played."""
