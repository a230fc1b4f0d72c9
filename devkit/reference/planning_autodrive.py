"""The rule of the published AutoDRIVE AEB script, as it stands there.

Of the boxes that survive suppression the last one counts, in the order in which the network lists
them; brake if it is a car, at 50 % or more, of 1000 px^2 or more in an image of 640x360. Every
frame decides anew: nothing is latched.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from schemas.messages import Detection

LABEL = "car"
CONFIDENCE_MIN = 0.5
"""Least confidence of a threat, inclusive [-]."""
AREA_MIN_PX2 = 1000
"""Least area of a threat, inclusive, in the script's image [px^2]."""
WIDTH_PX, HEIGHT_PX = 640, 360
"""Size of the script's image [px]."""


def trigger(detections: Sequence[Detection], width_px: int, height_px: int) -> int | None:
    """Place of the detection for which one camera frame asks for the brake; None: it does not.

    Args:
        detections: those of the frame; the last confident one counts, so whoever wants the
            script's choice hands them over in the network's order
            (:meth:`devkit.detector.decode.DetectionBatch.of` with ``by_place``).
        width_px: of the image that the boxes are in [px].
        height_px: of that image [px].
    """
    confident = [i for i, d in enumerate(detections) if d.confidence >= CONFIDENCE_MIN]
    if not confident:
        return None
    last = detections[confident[-1]]
    # The script cuts width and height to whole pixels before it multiplies them.
    width = math.floor(last.width_px * WIDTH_PX / width_px)
    height = math.floor(last.height_px * HEIGHT_PX / height_px)
    asks = last.label == LABEL and width * height >= AREA_MIN_PX2
    return confident[-1] if asks else None
