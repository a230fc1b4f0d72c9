"""Darknet models (``.cfg`` and ``.weights``) read without Darknet, and written as ONNX.

:mod:`~devkit.darknet.sections` reads the text, :mod:`~devkit.darknet.build` makes it a
:class:`~devkit.darknet.network.DarknetNetwork` with all shapes, :mod:`~devkit.darknet.weights`
reads the numbers, :mod:`~devkit.darknet.onnx_writer` writes both. The four published architectures
lie in ``cfg/``; :mod:`~devkit.darknet.variant` derives narrower ones from them.
"""
