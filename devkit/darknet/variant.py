"""The four published architectures, and narrower ones for other classes derived from them.

The cfg files beside this one hold what J. Redmon and A. Farhadi published (YOLO9000, 2016; YOLOv3,
2018; github.com/pjreddie/darknet), the keys that matter for inference.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from devkit.darknet.build import build_network
from devkit.darknet.network import DarknetNetwork
from devkit.darknet.sections import CfgSection, DarknetError, Option, read_sections
from schemas.validation import suggest

ARCHITECTURES = ("yolov2", "yolov2-tiny", "yolov3", "yolov3-tiny")
"""Names of the shipped cfg files, 80 classes at 416x416."""

_FOLDER = Path(__file__).parent / "cfg"


def architecture(
    name: str,
    *,
    width_multiple: float = 1.0,
    classes: int | None = None,
    width: int | None = None,
    height: int | None = None,
    anchors: Sequence[float] | None = None,
) -> list[CfgSection]:
    """Sections of a published architecture, or of a variant of it, see :func:`vary`.

    Args:
        name: one of :data:`ARCHITECTURES`, with ``-wNN`` behind it for NN % of its width.

    Raises:
        DarknetError: no such architecture, or a value out of range.
    """
    match = re.fullmatch(r"(.+)-w([1-9][0-9]?)", name)
    if match:
        name, width_multiple = match[1], width_multiple * int(match[2]) / 100
    if name not in ARCHITECTURES:
        raise DarknetError(f"architecture '{name}': {suggest(name, list(ARCHITECTURES))}")
    sections = read_sections(published_cfg(name))
    return vary(sections, width_multiple, classes, width, height, anchors)


def architecture_network(name: str, **how: object) -> DarknetNetwork:
    """The :class:`~devkit.darknet.network.DarknetNetwork` of :func:`architecture`."""
    return build_network(architecture(name, **how), name)  # type: ignore[arg-type]


def published_cfg(name: str) -> Path:
    """The cfg of one of :data:`ARCHITECTURES`."""
    return _FOLDER / f"{name}.cfg"


def coco_names() -> list[str]:
    """The 80 labels of the published weights, in their order."""
    return (_FOLDER / "coco.names").read_text().split("\n")[:80]


def vary(
    sections: Sequence[CfgSection],
    width_multiple: float = 1.0,
    classes: int | None = None,
    width: int | None = None,
    height: int | None = None,
    anchors: Sequence[float] | None = None,
) -> list[CfgSection]:
    """A variant of a network: narrower, other classes, input or anchors; None keeps what is there.

    Args:
        sections: a cfg.
        width_multiple: of the channels of every convolution but those before a head, above 0 to 1;
            rounded to the nearest whole number, at least 1.
        classes: 1 or more.
        width: of the input [px].
        height: of the input [px].
        anchors: width, height, width, height, ... as many as the cfg has, in its unit (cells for
            a region, pixels for yolo).

    Raises:
        DarknetError: a value out of range.
    """
    if not 0.0 < width_multiple <= 1.0:
        raise DarknetError(f"width multiple: given {width_multiple:g}, allowed: above 0 to 1")
    if classes is not None and classes < 1:
        raise DarknetError(f"classes: given {classes}, allowed: 1 or more")
    varied = []
    for index, section in enumerate(sections):
        changes: dict[str, object] = {}
        following = sections[index + 1] if index + 1 < len(sections) else None
        if section.name in ("net", "network"):
            changes = {"width": width, "height": height}
        elif _is_head(section):
            changes = {"classes": classes, "anchors": _joined(section, anchors)}
        elif section.name in ("convolutional", "conv") and "filters" in section.options:
            if following is not None and _is_head(following):
                changes = {"filters": _head_channels(following, classes)}
            else:
                filters = int(section.options["filters"].text)
                changes = {"filters": max(1, round(filters * width_multiple))}
        varied.append(_changed(section, changes))
    return varied


def _is_head(section: CfgSection) -> bool:
    return section.name in ("region", "yolo")


def _head_channels(head: CfgSection, classes: int | None) -> int:
    count = int(head.options["classes"].text) if classes is None else classes
    mask = head.options.get("mask")
    anchors = len(mask.text.split(",")) if mask else int(head.options["num"].text)
    return anchors * (5 + count)


def _joined(head: CfgSection, anchors: Sequence[float] | None) -> str | None:
    if anchors is None:
        return None
    needed = 2 * int(head.options["num"].text)
    if len(anchors) != needed:
        raise DarknetError(f"anchors: given {len(anchors)} numbers, {needed} needed")
    return ",".join(f"{value:g}" for value in anchors)


def _changed(section: CfgSection, changes: dict[str, object]) -> CfgSection:
    options = dict(section.options)
    for key, value in changes.items():
        if value is not None:
            line = options[key].line if key in options else section.line
            options[key] = Option(str(value), line)
    return replace(section, options=options)
