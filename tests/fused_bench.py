"""What a tick costs the fusion stack, and whether it decides as before: recorded drives, replayed.

``PYTHONPATH=tests python tests/fused_bench.py RECORD ... [--slots 1,8,32] [--ticks 40]``. A record
is that of an attempt of ``conductor run CAMPAIGN --record-drive``, its folder, or a campaign's.
First each drive is shown to one slot from its beginning to its end, and the digest of all commands
and tracks is printed: it is the same before and after a change that only makes the stack faster.
Then the drives take turns in so many slots, each at another place of them, and the time of the
process per slot and tick is printed. Boxes are those that were recorded: no network runs, and
pictures are left out, so the stack has to drive straight on.
"""

from __future__ import annotations

import argparse
import hashlib
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from devkit.fusion import FusionStack
from devkit.reference.eyes import Eyes
from devkit.replaying.replay import find_records
from devkit.stack import Observation
from schemas.messages import Detection, Episode
from twin.records.drive_record import RecordReader, decoded

PICTURES = "camera"
FIRST_TICK = 40
"""The cars have begun to drive."""


@dataclass(frozen=True)
class SeenTick:
    """One tick of a drive, pictures left out."""

    tick: int
    sim_time_ns: int
    sensors: dict[str, tuple[np.ndarray, int]]
    boxes: list[Detection] | None
    """None: no picture was due."""


@dataclass(frozen=True)
class Drive:
    """One attempt."""

    name: str
    parameters: dict[str, Any]
    episode: Episode
    ticks: list[SeenTick]

    @classmethod
    def read(cls, path: Path) -> Drive:
        """The drive of a record."""
        reader = RecordReader(path)
        ticks, episode = [], None
        for recorded in reader.ticks():
            seen, answer = recorded.seen, recorded.answer
            episode = seen.episode or episode
            if answer is None:
                continue
            sensors = {
                name: (decoded(array), array.count)
                for name, array in seen.sensors.items()
                if name != PICTURES
            }
            boxes = answer.command.detections if PICTURES in seen.sensors else None
            ticks.append(SeenTick(seen.tick, seen.sim_time_ns, sensors, boxes))
        assert episode is not None, f"{path}: no tick"
        return cls(reader.head.case.id, reader.head.case.rig.parameters, episode, ticks)


class RecordedEyes(Eyes):
    """Boxes that were recorded, instead of a network."""

    boxes: dict[int, list[Detection]]

    def reset(self, slot: int, episode: Episode) -> None:
        """Nothing is loaded."""

    def look(self, slots: Sequence[int], observation: Observation) -> dict[int, list[Detection]]:
        """The boxes of this tick."""
        return self.boxes


class RecordedFusion(FusionStack):
    """The fusion stack with recorded boxes."""

    def __init__(self, slots: int, **parameters: Any) -> None:
        super().__init__(slots, **parameters)
        self._eyes = self.eyes = RecordedEyes(slots)

    def show(self, rows: Sequence[SeenTick], seq: int) -> Observation:
        """What all slots see, each its own tick; their boxes are told."""
        self.eyes.boxes = {
            slot: row.boxes for slot, row in enumerate(rows) if row.boxes is not None
        }
        arrays = {name: array for row in rows for name, (array, _) in row.sensors.items()}
        sensors = {
            name: np.zeros((len(rows), *one.shape), one.dtype) for name, one in arrays.items()
        }
        counts = {name: np.zeros(len(rows), np.int64) for name in arrays}
        for slot, row in enumerate(rows):
            for name, (array, count) in row.sensors.items():
                sensors[name][slot], counts[name][slot] = array, count
        return Observation(
            seq=seq,
            active=np.ones(len(rows), bool),
            token=np.arange(1, len(rows) + 1),
            tick=np.array([row.tick for row in rows], np.int32),
            sim_time_ns=np.array([row.sim_time_ns for row in rows]),
            sensors=sensors,
            counts=counts,
        )


def begun(drives: Sequence[Drive]) -> RecordedFusion:
    """A stack with a drive per slot."""
    stack = RecordedFusion(len(drives), **drives[0].parameters)
    for slot, drive in enumerate(drives):
        stack.reset(slot, msgspec.structs.replace(drive.episode, slot=slot, token=slot + 1))
    return stack


def digest(drive: Drive) -> str:
    """Digest of all that the stack decides in a drive, and of where it has its tracks."""
    stack, sha = begun([drive]), hashlib.sha256()
    for seq, row in enumerate(drive.ticks):
        sha.update(msgspec.msgpack.encode(stack.step(stack.show([row], seq))))
        for name in ("x_m", "y_m", "vx_mps", "vy_mps", "p_xx", "p_vv", "q_vv", "probability"):
            sha.update(np.where(stack.tracks.live, getattr(stack.tracks, name), 0.0).tobytes())
    return sha.hexdigest()[:16]


def cost_ms(drives: Sequence[Drive], slots: int, ticks: int) -> float:
    """Time of the process per slot and tick, of ``ticks`` ticks [ms]."""
    shown = [drives[slot % len(drives)] for slot in range(slots)]
    firsts = [FIRST_TICK + 4 * (slot // len(drives)) for slot in range(slots)]
    stack, took_s = begun(shown), 0.0
    for seq in range(ticks):
        rows = [
            drive.ticks[(first + seq) % len(drive.ticks)]
            for drive, first in zip(shown, firsts, strict=True)
        ]
        observation = stack.show(rows, seq)
        begun_s = time.process_time()
        stack.step(observation)
        took_s += time.process_time() - begun_s
    return 1e3 * took_s / (slots * ticks)


def main() -> None:
    """Print digests and times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("records", nargs="+", type=Path)
    parser.add_argument("--slots", default="1,8,32")
    parser.add_argument("--ticks", type=int, default=40)
    asked = parser.parse_args()
    paths = [path for record in asked.records for path in find_records(record, [], None)]
    drives = [Drive.read(path) for path in paths]
    with redirect_stdout(StringIO()):  # what limits sensors, as for the log of an attempt
        digests = [digest(drive) for drive in drives]
    for drive, text in zip(drives, digests, strict=True):
        print(f"{drive.name}: {len(drive.ticks)} ticks, {text}", flush=True)
    for slots in map(int, asked.slots.split(",")):
        with redirect_stdout(StringIO()):
            each_ms = cost_ms(drives, slots, asked.ticks)
        print(f"{slots} slots: {each_ms:.3f} ms per slot and tick", flush=True)


if __name__ == "__main__":
    main()
