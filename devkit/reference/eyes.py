"""What the slots of a rig see: slots with equal perception variants look together, once a frame."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import msgspec
import numpy as np

from devkit.images import Images
from devkit.perception import Perception, Setting, build_perception
from devkit.stack import Observation
from schemas.messages import Detection, Episode, PerceptionCost
from schemas.wire.expected import Expected
from twin.base.errors import UsageError

TOGETHER_MAX = 8
"""Most networks of a GPU that run at the same time."""


class Eyes:
    """The perceptions of a rig's slots.

    A variant is built once and kept: the cases that come later find their network loaded.
    """

    def __init__(self, slots: int) -> None:
        self._built: dict[bytes, Perception] = {}
        self._of_slot: list[Perception | None] = [None] * slots
        self._costs: dict[int, PerceptionCost] = {}
        self._pool = ThreadPoolExecutor(TOGETHER_MAX, "eyes")

    def expect(self, expected: Sequence[Expected]) -> None:
        """Build what cases will look with; see :meth:`devkit.stack.Stack.expect`."""
        for expectation in expected:
            with suppress(UsageError, ValueError):  # told when a case needs it
                self._perception(expectation)

    def reset(self, slot: int, episode: Episode) -> None:
        """Give ``slot`` the perception of a new case.

        Raises:
            UsageError: its network cannot be loaded; one line naming the file.
        """
        self._of_slot[slot] = self._perception(episode)

    def _perception(self, of: Episode | Expected) -> Perception:
        setting = Setting(of.device, (of.width, of.height), of.files)
        key = msgspec.msgpack.encode(
            (of.perception, setting.device, setting.size_px, sorted(setting.files.items()))
        )
        if key not in self._built:
            self._built[key] = build_perception(of.perception, setting)
        return self._built[key]

    def look(self, slots: Sequence[int], observation: Observation) -> dict[int, list[Detection]]:
        """Detections of the new camera frames of ``slots``; none of a slot where no frame is
        due."""
        self._costs = {}
        camera = observation.sensors.get("camera")
        if camera is None or "boxes" not in observation.sensors:
            return {}
        groups: dict[int, list[int]] = {}
        for slot in slots:
            groups.setdefault(id(self._of_slot[slot]), []).append(slot)
        detections: dict[int, list[Detection]] = {}
        for group, lists, cost in self._looked(list(groups.values()), camera, observation):
            detections.update(zip(group, lists, strict=True))
            self._costs.update(dict.fromkeys(group, cost))
        return detections

    def _looked(
        self, groups: list[list[int]], camera: Any, observation: Observation
    ) -> Iterable[tuple[list[int], list[list[Detection]], PerceptionCost]]:
        """Detections of each group of slots with one perception, and what they took per slot."""

        def look(group: list[int]) -> tuple[list[int], list[list[Detection]], PerceptionCost]:
            perception = self._of_slot[group[0]]
            assert perception is not None, f"slot {group[0]} was not reset"
            boxes = [rows for slot in group if (rows := observation.boxes(slot)) is not None]
            started_s = time.perf_counter()
            lists = perception.detect(Images(camera, group), boxes)
            each_s = (time.perf_counter() - started_s) / len(group)
            return group, lists, PerceptionCost(perception.runtime, 1, each_s)

        # While a GPU works on one network, this process prepares another and decodes a third.
        # On the CPU there is one core for all of it.
        if len(groups) > 1 and not isinstance(camera, np.ndarray):
            return self._pool.map(look, groups)
        return map(look, groups)

    def costs(self, slots: Sequence[int]) -> list[PerceptionCost | None]:
        """Wall time that the last look took, per slot."""
        return [self._costs.get(slot) for slot in slots]
