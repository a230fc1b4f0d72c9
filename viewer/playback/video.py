"""A recorded case as a film, boxes drawn in: all of it as MP4, its end as an animated WebP."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image

from twin.base.errors import UsageError
from twin.base.progress import steps
from viewer.playback.drawing import drawn
from viewer.playback.folder import find_recording
from viewer.playback.frames import PlayedTick, RecordedCase, read_case
from viewer.playback.outputs import needed, write_whole

QUALITY = "22"
"""Constant rate factor of x264; 18 cannot be told from the original."""
CLIP_S, CLIP_HZ, CLIP_WIDTH_PX, CLIP_QUALITY = 5, 8, 400, 45
"""Length [s], rate [Hz], width [px] and quality (0 to 100) of the end of a film."""


@dataclass(frozen=True, slots=True)
class WrittenFilm:
    """What was written."""

    frames: int
    rate_hz: Fraction
    held: int
    """Frames that repeat their predecessor's pixels, because the recording lacks theirs."""


def write_film(case: RecordedCase, out: Path) -> WrittenFilm:
    """Write ``case`` as H.264 in MP4; frame ``i`` shows sim time ``first + i / rate``.

    The same recording gives the same pictures on every machine: one encoder thread, no clock.

    Raises:
        UsageError: no pictures, the library is not installed, or ``out`` cannot be written.
    """
    av = needed("av", "--mp4")
    times_ns, period_ns = schedule(case)
    rate = Fraction(10**9, period_ns)
    frames = {frame.sim_time_ns: frame for frame in case.frames}
    held = 0
    data = io.BytesIO()
    with av.open(data, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.pix_fmt = "yuv420p"  # what browsers play
        stream.options = {"crf": QUALITY, "preset": "veryfast", "threads": "1"}
        stream.time_base = 1 / rate
        for index, time_ns in enumerate(steps("frames", times_ns)):
            shown = case.picture_at(time_ns)
            held += shown.sim_time_ns != time_ns
            picture = drawn(frames.get(time_ns, PlayedTick(time_ns)), shown)
            if index == 0:
                stream.height, stream.width = picture.shape[:2]
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="bgr24")
            frame.pts, frame.time_base = index, 1 / rate
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    write_whole(out, data.getvalue())
    return WrittenFilm(len(times_ns), rate, held)


def write_clip(case: RecordedCase, out: Path) -> None:
    """Write the last :data:`CLIP_S` of ``case`` as an animated WebP, small enough for a page that
    is kept with the sources, which no player but a browser is needed for.

    Raises:
        UsageError: no pictures, or ``out`` cannot be written.
    """
    times_ns, period_ns = schedule(case)
    step = max(1, round(10**9 / CLIP_HZ / period_ns))
    last_ns = [time_ns for time_ns in times_ns if time_ns > times_ns[-1] - CLIP_S * 10**9]
    frames = {frame.sim_time_ns: frame for frame in case.frames}
    pictures = []
    for time_ns in last_ns[::-step][::-1]:
        picture = drawn(frames.get(time_ns, PlayedTick(time_ns)), case.picture_at(time_ns))
        image = Image.fromarray(np.ascontiguousarray(picture[..., ::-1]))
        image.thumbnail((CLIP_WIDTH_PX, CLIP_WIDTH_PX))
        pictures.append(image)
    data = io.BytesIO()
    pictures[0].save(
        data,
        "WEBP",
        save_all=True,
        append_images=pictures[1:],
        duration=round(step * period_ns / 1e6),
        loop=0,
        quality=CLIP_QUALITY,
    )
    write_whole(out, data.getvalue())


def schedule(case: RecordedCase) -> tuple[list[int], int]:
    """Times of the film's frames and their period [ns]: the camera's, also across gaps.

    Raises:
        UsageError: the recording holds no picture.
    """
    times = [frame.sim_time_ns for frame in case.pictures]
    if not times:
        raise UsageError(f"{case.path}: the recording holds no camera picture")
    if len(times) == 1:
        return times, 10**9
    period_ns = int(np.diff(times).min())
    return list(range(times[0], times[-1] + 1, period_ns)), period_ns


def answer_films(folder: Path, asked: Iterable[str]) -> Iterator[str]:
    """A line of JSON per line of JSON, see ``viewer films``: what reads recordings and encodes is
    loaded once for all of them."""
    for line in asked:
        request = json.loads(line)
        error = ""
        try:
            case, out = (
                read_case(find_recording(folder, request["case"]).path),
                Path(request["out"]),
            )
            if out.suffix == ".webp":
                write_clip(case, out)
            else:
                write_film(case, out)
        except UsageError as refused:
            error = str(refused)
        yield json.dumps({"case": request["case"], "error": error})
