"""Sections of a cfg -> :class:`~devkit.darknet.network.DarknetNetwork`, shapes inferred.

Keys, defaults and shapes follow Darknet's own parser (J. Redmon, github.com/pjreddie/darknet, and
the fork github.com/AlexeyAB/darknet).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast, get_args

from devkit.darknet.network import (
    IMAGE,
    Activation,
    Convolutional,
    DarknetLayer,
    DarknetNetwork,
    Head,
    MapShape,
    MaxPool,
    Reorg,
    Route,
    Shortcut,
    Upsample,
)
from devkit.darknet.sections import CfgSection, DarknetError, Reader, read_sections
from schemas.validation import suggest

# Keys that matter in training only, by kind of section; they are passed over.
_NET_TRAINING = frozenset(
    {
        "angle", "aspect", "batch", "blur", "burn_in", "cutmix", "decay", "ema_alpha", "exposure",
        "flip", "gamma", "gaussian_noise", "hue", "learning_rate", "max_batches",
        "max_chart_loss", "max_crop", "min_crop", "mixup", "momentum", "mosaic", "policy",
        "power", "random", "resize_step", "saturation", "scale", "scales", "seed", "step",
        "steps", "subdivisions", "track",
    }
)  # fmt: skip
_LAYER_TRAINING = frozenset(
    {
        "learning_rate", "stopbackward", "train_only_bn",
    }
)  # fmt: skip
_HEAD_TRAINING = frozenset(
    {
        "absolute", "beta_nms", "bias_match", "class_scale", "cls_normalizer", "coord_scale",
        "counters_per_class", "delta_normalizer", "focal_loss", "ignore_thresh", "iou_loss",
        "iou_normalizer", "iou_thresh", "iou_thresh_kind", "jitter", "label_smooth_eps",
        "mask_scale", "max", "max_delta", "noobject_scale", "obj_normalizer", "object_scale",
        "objectness_smooth", "random", "rescore", "resize", "thresh", "truth_thresh",
    }
)  # fmt: skip


LAYERS_MAX = 1000
"""Longest network that is read; the longest published detector has 400 layers."""

SIZE_MAX_PX = 8192
"""Largest width and height of the input [px]."""

ACTIVATIONS = get_args(Activation)


@dataclass(slots=True)
class _Build:
    """The network so far."""

    name: str
    input: MapShape
    layers: list[DarknetLayer] = field(default_factory=list)

    def shape_of(self, index: int) -> MapShape:
        return self.input if index == IMAGE else self.layers[index].shape

    def previous(self, reader: Reader) -> tuple[int, MapShape]:
        index = len(self.layers) - 1
        self.check_readable(reader, index)
        return index, self.shape_of(index)

    def check_readable(self, reader: Reader, index: int) -> None:
        if index != IMAGE and isinstance(self.layers[index], Head):
            raise reader.error(f"reads {self.layers[index].label}, whose output is boxes")

    def earlier(self, reader: Reader, key: str, number: int) -> int:
        """Absolute index of a layer named absolutely or (negative) relative to this one."""
        here = len(self.layers)
        index = number if number >= 0 else here + number
        if not 0 <= index < here:
            raise reader.error(f"given {number}, which is no layer before this one ({here})", key)
        self.check_readable(reader, index)
        return index


def read_network(path: Path, width: int | None = None, height: int | None = None) -> DarknetNetwork:
    """The network of a cfg file, at another input size if one is given [px].

    Raises:
        DarknetError: one line naming file and line.
    """
    return build_network(read_sections(path), str(path), width, height)


def build_network(
    sections: Sequence[CfgSection], name: str, width: int | None = None, height: int | None = None
) -> DarknetNetwork:
    """The network of a cfg's ``sections``; ``name`` is the file in error messages.

    Raises:
        DarknetError: one line naming file and line.
    """
    first, *rest = sections
    if first.name not in ("net", "network"):
        raise DarknetError(f"{name}:{first.line}: given [{first.name}], expected [net] first")
    if len(rest) > LAYERS_MAX:
        raise DarknetError(f"{name}: {len(rest)} layers, allowed: {LAYERS_MAX}")
    build = _Build(name, _read_net(Reader(first, name), width, height))
    for section in rest:
        reader = Reader(section, name)
        builder = _BUILDERS.get(section.name)
        if builder is None:
            raise reader.error(f"unknown section; {suggest(section.name, sorted(_BUILDERS))}")
        layer = builder(build, reader, section)
        if min(layer.shape) < 1:
            raise reader.error(f"nothing is left of its input: output {layer.shape}")
        build.layers.append(layer)
    network = DarknetNetwork(name, build.input, tuple(build.layers))
    if not network.heads():
        raise DarknetError(f"{name}: no [region] or [yolo] section, so it detects nothing")
    return network


def _read_net(reader: Reader, width: int | None, height: int | None) -> MapShape:
    needed_width = reader.integer("width", width, 1, SIZE_MAX_PX)
    needed_height = reader.integer("height", height, 1, SIZE_MAX_PX)
    channels = reader.integer("channels", 3, 1)
    reader.finish(_NET_TRAINING, {"letter_box": 0, "time_steps": 1})
    return MapShape(channels, height or needed_height, width or needed_width)


def _place(build: _Build, section: CfgSection) -> dict[str, Any]:
    return {"index": len(build.layers), "kind": section.name, "line": section.line}


def _convolutional(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    before, shape = build.previous(reader)
    filters = reader.integer("filters", 1, 1)
    size = reader.integer("size", 1, 1, 99)
    stride = reader.integer("stride", 1, 1, 99)
    groups = reader.integer("groups", 1, 1)
    padding = reader.integer("padding", 0, 0, 99)
    if reader.flag("pad", False):
        padding = size // 2
    normalize = reader.flag("batch_normalize", False)
    activation = _activation(reader, "logistic")
    reader.finish(
        _LAYER_TRAINING,
        {
            "dilation": 1, "stride_x": stride, "stride_y": stride, "antialiasing": 0, "xnor": 0,
            "binary": 0, "flipped": 0, "share_index": -1, "assisted_excitation": 0, "cbn": 0,
            "coordconv": 0, "sway": 0, "rotate": 0, "stretch": 0, "deform": 0, "grad_centr": 0,
            "dontloadscales": 0,
        },
    )  # fmt: skip
    if shape.channels % groups or filters % groups:
        raise reader.error(f"given {groups}, a divisor of {shape.channels} and {filters}", "groups")
    height, width = (
        (extent + 2 * padding - size) // stride + 1 for extent in (shape.height, shape.width)
    )
    return Convolutional(
        **_place(build, section),
        inputs=(before,),
        shape=MapShape(filters, height, width),
        size=size,
        stride=stride,
        padding=padding,
        groups=groups,
        channels=shape.channels,
        batch_normalize=normalize,
        activation=activation,
    )


def _maxpool(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    before, shape = build.previous(reader)
    stride = reader.integer("stride", 1, 1, 99)
    size = reader.integer("size", stride, 1, 99)
    padding = reader.integer("padding", size - 1, 0, 2 * (size - 1))
    reader.finish(
        _LAYER_TRAINING,
        {"stride_x": stride, "stride_y": stride, "antialiasing": 0, "maxpool_depth": 0},
    )
    height, width = (
        (extent + padding - size) // stride + 1 for extent in (shape.height, shape.width)
    )
    return MaxPool(
        **_place(build, section),
        inputs=(before,),
        shape=MapShape(shape.channels, height, width),
        size=size,
        stride=stride,
        padding=padding,
    )


def _route(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    inputs = [build.earlier(reader, "layers", i) for i in reader.integers("layers", None)]
    groups = reader.integer("groups", 1, 1)
    group_id = reader.integer("group_id", 0, 0, groups - 1)
    reader.finish(_LAYER_TRAINING)
    shapes = [build.shape_of(index) for index in inputs]
    for index, shape in zip(inputs, shapes, strict=True):
        if shape[1:] != shapes[0][1:]:
            raise reader.error(
                f"{build.layers[inputs[0]].label} is {shapes[0]} but {build.layers[index].label} is"
                f" {shape}; is the input {_size(build)} a multiple of the stride?",
                "layers",
            )
        if shape.channels % groups:
            raise reader.error(f"given {groups}, a divisor of {shape.channels} needed", "groups")
    channels = sum(shape.channels for shape in shapes) // groups
    return Route(
        **_place(build, section),
        inputs=tuple(inputs),
        shape=MapShape(channels, *shapes[0][1:]),
        groups=groups,
        group_id=group_id,
    )


def _shortcut(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    before, shape = build.previous(reader)
    other = build.earlier(reader, "from", reader.integer("from", None, -LAYERS_MAX, LAYERS_MAX))
    activation = _activation(reader, "linear")
    reader.finish(_LAYER_TRAINING, {"alpha": 1, "beta": 1})
    if build.shape_of(other) != shape:
        raise reader.error(
            f"{build.layers[other].label} is {build.shape_of(other)}, its other input {shape};"
            " only equal shapes are supported",
            "from",
        )
    return Shortcut(
        **_place(build, section), inputs=(before, other), shape=shape, activation=activation
    )


def _upsample(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    before, shape = build.previous(reader)
    stride = reader.integer("stride", 2, 1, 99)
    scale = reader.number("scale", 1.0)
    reader.finish(_LAYER_TRAINING)
    return Upsample(
        **_place(build, section),
        inputs=(before,),
        shape=MapShape(shape.channels, shape.height * stride, shape.width * stride),
        stride=stride,
        scale=scale,
    )


def _reorg(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    before, shape = build.previous(reader)
    stride = reader.integer("stride", 1, 1, 99)
    reader.finish(_LAYER_TRAINING, {"reverse": 0, "flatten": 0, "extra": 0})
    for extent, needed in zip(shape, (stride * stride, stride, stride), strict=True):
        if extent % needed:
            raise reader.error(f"input {shape} cannot be split with stride {stride}", "stride")
    return Reorg(
        **_place(build, section),
        inputs=(before,),
        shape=MapShape(
            shape.channels * stride * stride, shape.height // stride, shape.width // stride
        ),
        stride=stride,
    )


def _region(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    classes = reader.integer("classes", 20, 1)
    number = reader.integer("num", 1, 1, 1000)
    anchors = reader.numbers("anchors", None)
    softmax = reader.flag("softmax", False)
    reader.finish(_HEAD_TRAINING | _LAYER_TRAINING, {"coords": 4, "log": 0, "sqrt": 0})
    pairs = _pairs(reader, anchors, number)
    _, grid = build.previous(reader)
    # Anchors of a region are in cells.
    stride_x, stride_y = build.input.width / grid.width, build.input.height / grid.height
    return _head(
        build,
        reader,
        section,
        [(width * stride_x, height * stride_y) for width, height in pairs],
        classes,
        scores="softmax" if softmax else "logistic",
    )


def _yolo(build: _Build, reader: Reader, section: CfgSection) -> DarknetLayer:
    classes = reader.integer("classes", 20, 1)
    number = reader.integer("num", 1, 1, 1000)
    anchors = reader.numbers("anchors", None)
    mask = reader.integers("mask", list(range(number)))
    scale_xy = reader.number("scale_x_y", 1.0)
    reader.word("nms_kind", "default", ("default", "greedynms"))
    reader.finish(_HEAD_TRAINING | _LAYER_TRAINING, {"new_coords": 0})
    pairs = _pairs(reader, anchors, number)
    if not all(0 <= index < number for index in mask):
        raise reader.error(f"given {mask}, allowed: 0 to {number - 1}", "mask")
    chosen = [pairs[index] for index in mask]
    return _head(build, reader, section, chosen, classes, scores="logistic", scale_xy=scale_xy)


def _head(
    build: _Build,
    reader: Reader,
    section: CfgSection,
    anchors_px: list[tuple[float, float]],
    classes: int,
    **how: Any,
) -> Head:
    before, shape = build.previous(reader)
    needed = len(anchors_px) * (5 + classes)
    if shape.channels != needed:
        raise reader.error(
            f"its input has {shape.channels} channels; {len(anchors_px)} anchors and {classes}"
            f" classes need filters={needed} in the layer before"
        )
    return Head(
        **_place(build, section),
        inputs=(before,),
        shape=shape,
        anchors_px=tuple(anchors_px),
        classes=classes,
        **{"scale_xy": 1.0, **how},
    )


def _pairs(reader: Reader, anchors: list[float], number: int) -> list[tuple[float, float]]:
    if len(anchors) != 2 * number or min(anchors) <= 0:
        raise reader.error(
            f"given {len(anchors)} numbers, {2 * number} above 0 needed (num={number})", "anchors"
        )
    return list(zip(anchors[::2], anchors[1::2], strict=True))


def _activation(reader: Reader, default: Activation) -> Activation:
    return cast(Activation, reader.word("activation", default, ACTIVATIONS))


def _size(build: _Build) -> str:
    return f"{build.input.width}x{build.input.height}"


_BUILDERS: dict[str, Callable[[_Build, Reader, CfgSection], DarknetLayer]] = {
    "convolutional": _convolutional,
    "conv": _convolutional,
    "maxpool": _maxpool,
    "max": _maxpool,
    "route": _route,
    "shortcut": _shortcut,
    "upsample": _upsample,
    "reorg": _reorg,
    "region": _region,
    "yolo": _yolo,
}
