"""Detectors in whole numbers: the same bits on every CPU and GPU.

Weights and activations have eight bits, sums 32, as in Jacob et al., "Quantization and Training of
Neural Networks for Efficient Integer-Arithmetic-Only Inference" (CVPR 2018)::

    real value = scale * (level - zero)

with a scale and a zero per tensor of activations, and a scale per output channel of the weights,
whose zero is 0. Sums of integers are exact, so they depend neither on their order nor on the batch
nor on the instruction set; everything from the pixels to the last convolution is such sums.
"""
