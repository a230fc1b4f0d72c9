"""One case in full: its live messages -> a recording of its own in the hub."""

from __future__ import annotations

from collections.abc import Callable

import rerun as rr

from schemas.wire.codec import ATTACHMENT_BYTES_MAX, decode
from schemas.wire.view import CameraSample, CaseEnd, CaseStart, PointsSample, SceneMesh, StateSample
from twin.fabric.bus import Sample
from viewer.live.hub import leave
from viewer.recording import naming
from viewer.recording.blueprint import case_blueprint
from viewer.recording.convert import CaseConverter
from viewer.recording.rows import EntityRows, rows_at, send
from viewer.recording.scenery import Logged, outline, points, unpacked

SCENES_MAX = 4
"""Worlds that are kept, by digest."""


class Scenes:
    """Worlds that have come, by digest: of a hundred cases in one street it comes once."""

    def __init__(self, ask: Callable[[str, str], None]) -> None:
        """``ask(rig, sha256)`` sends for a world, which comes by :meth:`came` at some time."""
        self._ask = ask
        self._meshes: dict[str, rr.Mesh3D | None] = {}
        """Meshes of worlds by digest; None: cannot be shown."""
        self._asked: set[str] = set()

    def want(self, rig: str, sha256: str) -> None:
        """Send for a world unless it is here or on its way."""
        if sha256 and sha256 not in self._meshes and sha256 not in self._asked:
            self._asked.add(sha256)
            self._ask(rig, sha256)

    def came(self, sha256: str, scene: SceneMesh | None) -> str:
        """A world, or None: nobody has handed it out; why it cannot be shown, or nothing."""
        self._asked.discard(sha256)
        if scene is None:
            return ""  # the next start asks again
        while len(self._meshes) >= SCENES_MAX:
            del self._meshes[next(iter(self._meshes))]
        self._meshes[sha256] = None
        try:
            if scene.sha256 != sha256:
                raise ValueError("the world has changed meanwhile")
            self._meshes[sha256] = unpacked(scene)
        except ValueError as error:
            return str(error)
        return ""

    def known(self, sha256: str) -> bool:
        """Whether the world has come, usable or not."""
        return sha256 in self._meshes

    def mesh(self, sha256: str) -> rr.Mesh3D | None:
        """The world, if it came and can be shown."""
        return self._meshes.get(sha256)


class FocusedCase:
    """A case of a campaign that is shown in full; a new attempt is a new recording."""

    def __init__(
        self, open_stream: Callable[[CaseStart], rr.RecordingStream], scenes: Scenes
    ) -> None:
        self.starts = 0
        """Attempts shown."""
        self.logged = 0
        self._open_stream = open_stream
        self._scenes = scenes
        self._token = 0
        """Attempts before this one are not shown."""
        self._start: CaseStart | None = None
        self._stream: rr.RecordingStream | None = None
        self._converter: CaseConverter | None = None
        self._standing = False
        """The world is logged."""
        self._hand = ""
        """What the case's text says that somebody does to it."""

    def take(self, sample: Sample) -> None:
        """One message of the case.

        Raises:
            WireError: of another version, or damaged.
        """
        stream = sample.key.rsplit("/", 1)[1]
        kind = stream.partition(".")[0]
        match kind:
            case "start":
                self._begin(decode(sample.payload, CaseStart))
            case "state":
                state: StateSample = decode(sample.payload, StateSample)
                self._send(state.token, lambda c: c.states([state]))
                self._touched()
            case _ if kind == "camera" or self._is_grid(stream):
                picture: CameraSample = decode(
                    sample.attachment, CameraSample, ATTACHMENT_BYTES_MAX
                )
                self._send(picture.token, lambda c: c.pictures([(picture, sample.payload)], stream))
            case "lidar":
                cloud: PointsSample = decode(sample.attachment, PointsSample, ATTACHMENT_BYTES_MAX)
                columns = points(sample.payload)
                self._send(
                    cloud.token, lambda _: [rows_at(naming.sensor(stream), [cloud], columns)]
                )
            case "end":
                end: CaseEnd = decode(sample.payload, CaseEnd)
                self._end(end)

    def _is_grid(self, stream: str) -> bool:
        return self._start is not None and stream in self._start.grids

    def stand(self) -> None:
        """Log the standing world once it has come."""
        if self._start is None or self._stream is None or self._standing:
            return
        if not self._scenes.known(self._start.scene_sha256):
            return
        self._standing = True
        mesh = self._scenes.mesh(self._start.scene_sha256)
        shown = outline(self._start.stage) if mesh is None else [(naming.SCENE, mesh)]
        self._put(shown)

    def close(self) -> None:
        """End the recording; it stays in the hub. Does not wait for stuck viewers."""
        if self._stream is not None:
            leave(self._stream)
            self._stream = None

    def forget(self) -> None:
        """The campaign was begun anew: its tokens start again."""
        self._token = 0

    def _begin(self, start: CaseStart) -> None:
        if start.token < self._token:
            return  # of two attempts at once the later one is shown
        self._token = start.token
        self._scenes.want(start.rig, start.scene_sha256)
        if self._start is not None and self._start.token == start.token:
            return  # once more, for those who came later
        self.close()
        self.starts += 1
        self._start, self._converter, self._hand = start, CaseConverter(start), ""
        self._stream = self._open_stream(start)
        self._standing = False
        self._put(self._converter.start())
        self.stand()

    def _touched(self) -> None:
        """The case's text says what somebody does to it."""
        if self._converter is not None and self._hand != self._converter.hand:
            self._hand = self._converter.hand
            self._put(self._converter.touched())

    def _end(self, end: CaseEnd) -> None:
        self._send(end.token, lambda c: c.end(end))
        if self._converter is None or self._start is None or self._start.token != end.token:
            return
        self._put(self._converter.summary(end, 0))

    def _send(self, token: int, convert: Callable[[CaseConverter], list[EntityRows]]) -> None:
        """Send what ``convert`` makes of a message, unless it is of an attempt not shown."""
        if self._stream is None or self._start is None or self._converter is None:
            return
        if token != self._start.token:
            return
        self.logged += 1
        for rows in convert(self._converter):
            send(self._stream, rows)

    def _put(self, logged: list[Logged]) -> None:
        """Log what holds at all times."""
        if self._stream is None:
            return
        self.logged += 1
        for path, archetype in logged:
            self._stream.log(path, archetype, static=True)


def open_stream(hub_url: str, start: CaseStart) -> rr.RecordingStream:
    """A recording for the attempt of ``start`` that goes to the hub at ``hub_url``."""
    stream = rr.RecordingStream(
        naming.CASE_APP,
        recording_id=naming.recording_id(start.campaign, start.case, start.attempt),
    )
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    stream.set_sinks(
        rr.GrpcSink(hub_url),
        default_blueprint=case_blueprint(
            start.stage,
            start.cameras,
            start.lidars,
            start.sensors,
            grids=start.grids,
            rows=tuple(start.rows),
            live=True,
        ),
    )
    stream.send_recording_name(f"{start.case} ({start.campaign})")
    return stream
