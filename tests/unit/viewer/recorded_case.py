"""A small recording with everything in it, written by the recorder's own code."""

import numpy as np
from view_messages import camera, controls, detection, end, start, state

from schemas.wire.view import ImageBox
from twin.view.samples import jpeg
from viewer.recording import naming
from viewer.recording.recording import RecordingFile

PICTURES = [jpeg(np.full((36, 64, 3), shade, np.uint8)) for shade in (10, 120, 230)]


def write(folder, ended=True, brakes=True, told=None, **changes):
    """Six ticks of 50 ms: pictures at 0, 2, 4; braking from 3 on; closest at 4.

    One near and one far detection in all but the last, for which the stack was not asked. ``told``:
    the tick in which the stack says that the near one is what it brakes for.
    """
    recording = RecordingFile(start(folder, **changes))
    seq = 1
    for tick in range(6):
        boxes = [ImageBox("car", 10.0, 12.0, 20.0, 8.0, 21.0)] if tick % 2 == 0 else None
        if tick % 2 == 0:
            recording.camera(camera(seq, tick), PICTURES[tick // 2])
            seq += 1
        found = [detection(20.0), detection(2.0)]
        trigger = 0 if tick == told else None
        asked = controls(brakes and tick >= 3, found, trigger) if tick < 5 else None
        dtc_m = 20.0 - 2.0 * tick if tick < 5 else 13.0
        recording.state(
            state(seq, tick, controls=asked, boxes=boxes, dtc_m=dtc_m, ttc_s=None if tick else 2.0)
        )
        seq += 1
    recording.close(end(seq, tick=5) if ended else None)
    return folder / naming.RECORDING_FILE
