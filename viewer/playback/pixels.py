"""What a camera of a case saw at a moment, as an array of pixels."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from schemas.files.drive_record import DRIVE_FILE
from schemas.validation import suggest
from twin.base.errors import UsageError
from twin.records.campaign_file import read_plan
from twin.records.drive_record import RecordReader, decoded
from viewer.playback.folder import FoundRecording, attempts_of, find_moment, find_recording
from viewer.playback.frames import RecordedCase, read_pictures
from viewer.recording import naming

MAIN = "camera"
"""Name of the main camera's messages; those of another one end in its name."""


def pixels_at(
    folder: Path, case: str, at: str, camera: str = "", known: RecordedCase | None = None
) -> tuple[NDArray[np.uint8], int, RecordedCase | None]:
    """The picture that stood at a moment: the latest until then, or else the first.

    Where the attempt has a drive record these are the pixels that the stack saw, to the last bit;
    otherwise those of the recording, which went through JPEG.

    Args:
        folder: the campaign's.
        case: name of the case.
        at: ``aeb``, ``closest`` or seconds, see :func:`viewer.playback.folder.find_moment`.
        camera: name of a camera in the vehicle file; empty: the main one.
        known: recording that an earlier call has read.

    Returns:
        RGB, [height, width, 3], row 0 at the top; its time [ns]; the recording, if it was read.

    Raises:
        UsageError: no such case, moment or camera, or nothing of it was recorded.
    """
    message = _message(folder, case, camera) if camera else MAIN
    for attempt in attempts_of(folder, case):
        if (attempt / DRIVE_FILE).is_file():
            drive = FoundRecording(case, attempt / DRIVE_FILE, attempt / naming.KPI_FILE, True)
            moment_ns = find_moment(drive, at).sim_time_ns
            return *_of_drive(attempt / DRIVE_FILE, message, moment_ns), None
    found = find_recording(folder, case)
    if message != MAIN:
        raise UsageError(
            f"{folder}: case '{case}': camera '{camera}' was not recorded; recordings have the "
            "main camera alone, all of them are in the record of a run with --record-drive"
        )
    moment_ns = find_moment(found, at).sim_time_ns
    if known is None or known.path != found.path:
        known = read_pictures(found.path)
    frame = known.picture_at(moment_ns)
    data = np.frombuffer(frame.jpeg or b"none", np.uint8)  # of no bytes OpenCV makes a traceback
    pixels = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)
    if pixels is None:
        raise UsageError(f"{found.path}: damaged: a picture that is none")
    return np.asarray(pixels, np.uint8), frame.sim_time_ns, known


def _message(folder: Path, case: str, camera: str) -> str:
    """Name of the messages of a camera of a case.

    Raises:
        UsageError: the case has no such camera.
    """
    plan = read_plan(folder / "campaign.yaml")
    rig = (plan.only(case) or plan).cases[0].rig
    if camera == rig.camera.name:
        return MAIN
    names = [rig.camera.name, *(other.name for other in rig.cameras)]
    if camera not in names:
        raise UsageError(f"{folder}: no camera '{camera}'; {suggest(camera, names)}")
    return f"{MAIN}.{camera}"


def _of_drive(path: Path, message: str, moment_ns: int) -> tuple[NDArray[np.uint8], int]:
    chosen = None
    for tick in RecordReader(path).ticks():
        if chosen is not None and tick.seen.sim_time_ns > moment_ns:
            break
        if message in tick.seen.sensors:
            chosen = tick.seen
    if chosen is None:
        raise UsageError(f"{path}: holds no picture of '{message}'")
    try:
        return np.asarray(decoded(chosen.sensors[message]), np.uint8), chosen.sim_time_ns
    except ValueError as error:
        raise UsageError(f"{path}: damaged: {error}") from None
