"""``devkit train``: a Darknet network from scratch on a dataset of the twin, written as ONNX.

:mod:`~devkit.training.parameters` is all that decides a result, :mod:`~devkit.training.network` the
layers in torch, :mod:`~devkit.training.examples` the images and boxes on the device,
:mod:`~devkit.training.augment` their variations, :mod:`~devkit.training.loss` what is minimised,
:mod:`~devkit.training.loop` the training, :mod:`~devkit.training.command` everything together.
Torch is the optional group ``train``; nothing outside this package imports it.
"""
