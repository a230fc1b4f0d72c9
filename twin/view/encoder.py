"""Items of the view's queue -> messages, each with its topic. No session, thread or clock."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from schemas import SCHEMA_VERSION
from schemas.kinds.sensor import pictured_kinds
from schemas.wire import topics
from schemas.wire.codec import encode
from schemas.wire.control import Lease
from schemas.wire.topics import Topic
from schemas.wire.view import (
    UNNUMBERED,
    CameraSample,
    CaseEnd,
    CaseStart,
    PointsSample,
    RecorderSample,
    SceneMesh,
    Stage,
    StateSample,
    Thumbnail,
)
from twin.vehicle.state import COLUMN
from twin.view.items import Began, Scenery, ShownEnd, SlotRun, SlotSeen, Ticked
from twin.view.quality import Quality
from twin.view.samples import (
    THUMBNAIL_WIDTH_PX,
    grid_picture,
    jpeg,
    last_of,
    last_row_of,
    points_of,
    stage_of,
    start_of,
    state_of,
)
from twin.view.scene import pack_scene
from twin.world.street.build import World


class ViewMessage(NamedTuple):
    """A message of a case that viewers are sent."""

    topic: Topic
    payload: bytes
    attachment: bytes = b""
    sensor: str = ""
    """Part of the key, where the topic has several."""


class Encoder:
    """Items of the view's queue -> messages; remembers what an attempt has shown."""

    def __init__(self, rig: str) -> None:
        self._rig = rig
        self._stages: dict[tuple[str, str, int | None], Stage] = {}
        self._scene: SceneMesh | None = None
        self._shown: dict[int, _Shown] = {}
        """Cases shown on the wall by token."""

    def scene(self, world: World) -> bytes:
        """The standing world, encoded; of a rig there is one."""
        return encode(self._packed(world))

    def messages(
        self, item: Began | Scenery | Ticked | ShownEnd
    ) -> tuple[list[RecorderSample], list[ViewMessage]]:
        """What the recorder gets of one item, in the order of its running numbers, and viewers."""
        match item:
            case Began():
                stage = self._stage(item.run, item.colliders, item.cars)
                return [RecorderSample(start=start_of(item.run.lease, stage, item.seq))], []
            case Scenery():
                return [], [ViewMessage(topics.VIEW_LIVE_START, encode(self._live_start(item)))]
            case Ticked():
                return self._tick(item)
            case ShownEnd():
                return self._end(item)

    def _packed(self, world: World) -> SceneMesh:
        if self._scene is None:
            self._scene = pack_scene(world)
        return self._scene

    def _stage(self, run: SlotRun, colliders: np.ndarray, cars: int) -> Stage:
        scenario = run.lease.case.variation.scenario
        key = (scenario.scene, scenario.vehicle, run.target)
        if key not in self._stages:
            self._stages[key] = stage_of(run.lease, colliders, cars, run.target)
        return self._stages[key]

    def _live_start(self, item: Scenery) -> CaseStart:
        lease, world = item.run.lease, item.world
        stage = self._stage(item.run, world.colliders, world.cars)
        return msgspec.structs.replace(
            start_of(lease, stage, UNNUMBERED),
            cameras=item.cameras,
            lidars=item.lidars,
            grids=[kind.name for kind in pictured_kinds(lease.case.rig.sensor_hz)],
            rig=item.rig,
            scene_sha256=self._packed(world).sha256,
        )

    def _tick(self, item: Ticked) -> tuple[list[RecorderSample], list[ViewMessage]]:
        snapshot, token, seq, due = item.snapshot, item.run.lease.token, item.seq, item.due
        recorded: list[RecorderSample] = []
        # Once for all who look: compressing is what costs.
        whole = snapshot.image is not None and (seq >= 0 or "camera" in due)
        picture = b""
        if whole and snapshot.image is not None:
            picture = _compressed(item.run, "camera", snapshot.image)
        if seq >= 0:
            # The picture first: who has the state of a tick has all of it.
            if picture:
                sample = _camera_sample(snapshot, token, seq)
                recorded.append(RecorderSample(camera=sample, jpeg=picture))
                seq += 1
            recorded.append(RecorderSample(state=state_of(snapshot, token, seq)))
        messages = _live(snapshot, item.run, due, picture)
        if "thumbnail" in due:
            before = self._shown.get(token)
            small = b"" if snapshot.image is None else jpeg(snapshot.image, THUMBNAIL_WIDTH_PX)
            shown = self._shown[token] = _Shown(small, snapshot, before.count + 1 if before else 1)
            messages.append(_thumbnail(self._rig, item.run.lease, shown, None))
        return recorded, messages

    def _end(self, item: ShownEnd) -> tuple[list[RecorderSample], list[ViewMessage]]:
        token = item.run.lease.token
        recorded: list[RecorderSample] = []
        messages: list[ViewMessage] = []
        if item.seq >= 0:
            last, end = _ending(item, item.seq)
            recorded += [RecorderSample(state=last)] if last is not None else []
            recorded.append(RecorderSample(end=end))
        if item.live:
            last, end = _ending(item, UNNUMBERED)
            if last is not None:
                messages.append(ViewMessage(topics.VIEW_LIVE_STATE, encode(last)))
            messages.append(ViewMessage(topics.VIEW_LIVE_END, encode(end)))
        shown = self._shown.pop(token, None)
        if item.thumbnail and shown is not None:
            messages.append(_thumbnail(self._rig, item.run.lease, shown, item))
        return recorded, messages


class _Shown(NamedTuple):
    """A case as the wall shows it."""

    picture: bytes
    """The latest thumbnail, JPEG."""
    snapshot: SlotSeen
    count: int
    """Thumbnails so far, this one included."""


def _ending(item: ShownEnd, seq: int) -> tuple[StateSample | None, CaseEnd]:
    """The last row, if it has not been sent, and the end; ``seq`` of the first."""
    finished, token = item.finished, item.run.lease.token
    numbered = seq != UNNUMBERED
    last = None
    if item.last_row and finished is not None:
        last = last_row_of(finished.table, token, seq)
        seq += numbered
    end = CaseEnd(
        v=SCHEMA_VERSION,
        seq=seq,
        token=token,
        sim_time_ns=item.sim_time_ns,
        outcome=finished.outcome if finished else "",
        verdict=finished.verdict if finished else "",
        reasons=finished.reasons if finished else [],
        scalars=finished.scalars if finished else {},
        samples=seq + 1 if numbered else 0,
    )
    return last, end


def _compressed(run: SlotRun, name: str, image: np.ndarray) -> bytes:
    """A camera's picture, as well as its budget allows."""
    quality = run.qualities.setdefault(name, Quality())
    data = jpeg(image, quality=quality.value)
    quality.took(len(data), image.shape[0] * image.shape[1])
    return data


def _live(
    snapshot: SlotSeen, run: SlotRun, due: frozenset[str], picture: bytes
) -> list[ViewMessage]:
    """What viewers of this case alone are due; ``picture`` is the main camera's."""
    token = run.lease.token
    messages: list[ViewMessage] = []
    attachment = encode(_camera_sample(snapshot, token, UNNUMBERED))
    pictures = {"camera": picture} if picture and "camera" in due else {}
    pictures.update((n, _compressed(run, n, image)) for n, image in snapshot.pictures.items())
    for kind in pictured_kinds(snapshot.grids):
        assert kind.picture is not None
        image = grid_picture(kind.picture, snapshot.grids[kind.name])
        pictures[kind.name] = _compressed(run, kind.name, image)
    for name, data in sorted(pictures.items()):
        messages.append(ViewMessage(topics.VIEW_LIVE_CAMERA, data, attachment, name))
    for name, cloud in sorted(snapshot.clouds.items()):
        sample = PointsSample(
            v=SCHEMA_VERSION,
            token=token,
            tick=snapshot.tick,
            sim_time_ns=snapshot.sim_time_ns,
            stride=cloud.stride,
        )
        messages.append(
            ViewMessage(topics.VIEW_LIVE_LIDAR, points_of(cloud).tobytes(), encode(sample), name)
        )
    if "state" in due:
        state = state_of(snapshot, token, UNNUMBERED)
        messages.append(ViewMessage(topics.VIEW_LIVE_STATE, encode(state)))
    return messages


def _camera_sample(snapshot: SlotSeen, token: int, seq: int) -> CameraSample:
    return CameraSample(
        v=SCHEMA_VERSION, seq=seq, token=token, tick=snapshot.tick, sim_time_ns=snapshot.sim_time_ns
    )


def _thumbnail(rig: str, lease: Lease, shown: _Shown, end: ShownEnd | None) -> ViewMessage:
    case, snapshot, finished = lease.case, shown.snapshot, end.finished if end else None
    speed_mps = float(snapshot.state[COLUMN["speed_mps"]])
    dtc_m = float(snapshot.state[COLUMN["dtc_m"]]) if snapshot.target else None
    time_ns = snapshot.sim_time_ns
    if finished is not None:
        columns = finished.table.columns
        speed_mps = float(columns["speed_mps"].values[-1])
        dtc_m = last_of(finished.table, "dtc_m")
        time_ns = int(columns["sim_time_ns"].values[-1])
    thumbnail = Thumbnail(
        v=SCHEMA_VERSION,
        # The verdict comes with the latest picture once more.
        seq=shown.count - (finished is None),
        token=lease.token,
        campaign=case.variation.campaign,
        case=case.id,
        attempt=lease.attempt,
        model=case.variation.model,
        weather=case.variation.weather,
        time_of_day_min=case.variation.time_of_day_min,
        sim_time_ns=time_ns,
        speed_mps=speed_mps,
        dtc_m=dtc_m,
        aeb=bool(snapshot.command and snapshot.command.aeb),
        hand=snapshot.label,
        outcome=finished.outcome if finished else "",
        verdict=finished.verdict if finished else "",
        rig=rig,
        at_s=end.at_s if end else snapshot.at_s,
    )
    return ViewMessage(topics.VIEW_THUMBNAIL, shown.picture, encode(thumbnail))
