"""The vehicles of all slots: constant Model, changing State, one launch per control period."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
import warp as wp

from twin.vehicle import kernel, nearest
from twin.vehicle.carry_kernel import carry_kernel
from twin.vehicle.ground import FlatGround, GroundMesh
from twin.vehicle.guard import FAULTS
from twin.vehicle.lanes import LANES
from twin.vehicle.masses import NO_LOAD, Load
from twin.vehicle.model import (
    GRAVITY_MPS2,
    VehicleModel,
    WheelModel,
    vehicle_model,
    wheel_models,
)
from twin.vehicle.nearest import NEAREST
from twin.vehicle.powertrain import COMMANDS
from twin.vehicle.state import COLUMN, TELEMETRY, VehicleState, columns
from twin.vehicle.vehicle_file import Vehicle
from twin.vehicle.wall_grid import wall_grid
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror
from twin.world.relaunch import Relaunch

_BLOCK = 8
"""Fewest threads of a block: the smaller the blocks, the more of a GPU's processors a few hundred
slots reach. 256 slots took 4.2 ms a tick on an H200, with blocks of 64 5.5."""
_WARP = 32
_SCHEDULERS = 4
"""Of a GPU's multiprocessor; each is to have one block at most."""
_NO_COLLIDERS = np.zeros((0, 5))


class Fleet:
    """V vehicles in each of S slots.

    Host arrays, written before :meth:`advance`: ``friction`` [S], ``wind`` [S, 2]
    (world x and y [m/s], 0 after :meth:`place`), ``commands`` [S, V, 2, 5] with
    the columns :data:`twin.vehicle.powertrain.COMMANDS`, ``switch_step`` [S], ``first_step`` [S],
    ``active`` [S], ``targets`` [S] (collider to which distances are measured; -1: none),
    ``movers`` [S, M, 8]; see :func:`twin.vehicle.kernel.drive_kernel`. ``state``
    [S, V, T] is valid after each call.
    """

    def __init__(
        self,
        vehicles: Sequence[Vehicle],
        slots: int,
        device: wp.Device,
        *,
        colliders: np.ndarray = _NO_COLLIDERS,
        ground: FlatGround | GroundMesh | None = None,
        movers: int = 0,
        stop_at_impact: bool = False,
    ) -> None:
        """Every slot has the same ``vehicles``.

        Args:
            colliders: static hulls [K, 5]: x, y, yaw, half length, half width.
            ground: the plane z = 0 by default.
            movers: scripted objects M of every slot; their hulls stand in ``movers``.
            stop_at_impact: a vehicle's first collision freezes it.
        """
        self.vehicles = tuple(vehicles)
        self.slots = slots
        self._device = device
        self._launch = Relaunch(device)
        self._lanes = 1 if device.is_cpu else LANES
        self._block = threads_of_a_block(slots * self._lanes, device.sm_count)
        self._build_models()
        self._ground = ground or FlatGround(device)
        self._scene = self._build_scene(colliders, stop_at_impact)
        count = len(self.vehicles)
        self._state = Mirror((slots, count, len(TELEMETRY)), wp.float64, device)
        self._rows = wp.array(
            ptr=self._state.device.ptr,
            dtype=VehicleState,
            shape=(slots, count),
            device=device,
            copy=False,
        )
        self._events = Mirror((slots, kernel.EVENTS_MAX, len(kernel.EVENT)), wp.float64, device)
        self._event_count = Mirror((slots,), wp.int32, device)
        self._friction = Mirror((slots,), wp.float64, device)
        self._wind = Mirror((slots,), wp.vec2d, device)
        self._commands = Mirror((slots, count, 2, len(COMMANDS)), wp.float64, device)
        self._switch_step = Mirror((slots,), wp.int32, device)
        self._first_step = Mirror((slots,), wp.int32, device)
        self._active = Mirror((slots,), wp.int32, device)
        self._targets = Mirror((slots,), wp.int32, device)
        self._movers = Mirror((slots, movers, len(kernel.MOVER_COLUMNS)), wp.float64, device)
        self._scene_movers = Mirror((slots, movers, len(kernel.MOVER_COLUMNS)), wp.float64, device)
        self._nearest = Mirror((slots, len(NEAREST)), wp.float64, device)
        self._carried = Mirror((slots,), wp.int32, device)
        self._carried_com = Mirror((slots,), wp.vec3d, device)
        self._carried_turn = Mirror((slots,), wp.quatd, device)
        self._unseen = False  # whether events on the device are newer than those on the host
        self._placed: list[int] = []
        self.state = self._state.host
        self.friction = self._friction.host
        self.wind = self._wind.host
        self.commands = self._commands.host
        self.switch_step = self._switch_step.host
        self.first_step = self._first_step.host
        self.active = self._active.host
        self.targets = self._targets.host
        self.targets[...] = -1
        self.movers = self._movers.host
        load_kernels(device, [(kernel, self._block), (nearest, self._block)])

    def _build_models(self) -> None:
        """Constants of vehicles and wheels.

        Behind those of the vehicles there is room for that of each slot's loaded vehicle 0. An
        index, since a GPU reads what all slots share once.
        """
        device, count = self._device, len(self.vehicles)
        self._host_models = [vehicle_model(vehicle) for vehicle in self.vehicles]
        rooms = [*self._host_models, *([self._host_models[0]] * self.slots)]
        self._models = wp.array(rooms, dtype=VehicleModel, device=device)
        rows = np.stack([wheel_models(model) for model in self._host_models])
        rows = np.concatenate([rows, np.repeat(rows[:1], self.slots, axis=0)])
        self.wheel_models = wp.array(rows, dtype=WheelModel, device=device, ndim=2)
        self._model_of = Mirror((self.slots, count), wp.int32, device)
        self._model_of.host[...] = np.arange(count)
        self._model_of.push()
        self._loaded: dict[int, VehicleModel] = {}
        self._references = deque[tuple[VehicleModel, tuple[float, float, float]]](maxlen=8)

    def _build_scene(self, colliders: np.ndarray, stop_at_impact: bool) -> kernel.VehicleScene:
        """Everything that vehicles can stand on or hit."""
        device, scene = self._device, kernel.VehicleScene()
        scene.colliders = wp.array(colliders, dtype=wp.float64, device=device, ndim=2)
        scene.grid = wall_grid(colliders, max(map(_extent_m, self.vehicles)), device)
        scene.ground = self._ground.kernel
        scene.stop_at_impact = int(stop_at_impact)
        return scene

    @property
    def events(self) -> np.ndarray:
        """Collisions so far [S, E, 8], the first ``event_count``; a view, for those who look."""
        self._see()
        return self._events.host

    @property
    def event_count(self) -> np.ndarray:
        """How many collisions there were [S], also those beyond E; a view."""
        self._see()
        return self._event_count.host

    def first_hit(self, slot: int) -> int:
        """What vehicle 0 of a slot hit first, counted as :meth:`nearest` counts; -1: nothing, or
        another vehicle."""
        first = {kernel.WALL: 0, kernel.MOVER: self._scene.colliders.shape[0]}
        count = min(int(self.event_count[slot]), kernel.EVENTS_MAX)
        for _, vehicle, kind, partner, *_ in self.events[slot, :count].tolist():
            if vehicle == 0.0 and kind in first:
                return first[int(kind)] + int(partner)
        return -1

    def survey(self, movers: np.ndarray) -> None:
        """Begin to measure what vehicles 0 are nearest to; :meth:`nearest` waits for it.

        Args:
            movers: hulls of the scripted objects at the same times as the state [S, M, 8].
        """
        self._scene_movers.host[...] = movers
        self._scene_movers.push()
        self._active.push()
        self._launch(
            nearest.nearest_kernel,
            self.slots,
            [
                self._models,
                self._model_of.device,
                self._scene.colliders,
                self._active.device,
                self._rows,
                self._scene_movers.device,
            ],
            [self._nearest.device],
            self._block,
        )

    def nearest(self) -> np.ndarray:
        """What vehicles 0 were nearest to at the last :meth:`survey` [S, 4], columns
        :data:`twin.vehicle.nearest.NEAREST`; a view. Inactive slots: nothing."""
        return self._nearest.pull()

    def _see(self) -> None:
        """Bring the events over: hardly anybody looks at them, and not at every step."""
        if self._unseen:
            self._events.pull()
            self._event_count.pull()
            self._unseen = False

    @property
    def rows_device(self) -> wp.array:
        """State on the device, VehicleState [S, V]."""
        return self._rows

    @property
    def ego_device(self) -> wp.array:
        """State of every slot's vehicle 0 on the device, float64 [S, T]; x, y, yaw come first."""
        return self._state.device[:, 0]

    def load(self, slot: int, load: Load) -> None:
        """Give vehicle 0 of a slot another load. Call :meth:`place` after.

        Raises:
            ValueError: the load would lift a wheel; one line.
        """
        if load == NO_LOAD:
            self._loaded.pop(slot, None)
            index = 0
        else:
            index = len(self.vehicles) + slot
            model = self._loaded[slot] = vehicle_model(self.vehicles[0], load)
            room = wp.array([model], dtype=VehicleModel, device=self._device)
            wp.copy(self._models, room, dest_offset=index, count=1)
            wheels = wp.array(wheel_models(model), dtype=WheelModel, device=self._device)
            wp.copy(self.wheel_models, wheels, dest_offset=4 * index, count=4)
        if self._model_of.host[slot, 0] != index:
            self._model_of.host[slot, 0] = index
            self._model_of.push()

    def _model(self, slot: int, vehicle: int = 0) -> VehicleModel:
        model = self._loaded.get(slot) if vehicle == 0 else None
        return model or self._host_models[vehicle]

    def place(
        self,
        slot: int,
        x_m: float,
        speed_mps: float,
        friction: float,
        *,
        vehicle: int = 0,
        y_m: float = 0.0,
        z_m: float = 0.0,
        yaw_rad: float = 0.0,
        refresh: bool = True,
    ) -> None:
        """Put a vehicle's reference point at a place, level and settled on its springs.

        The slot's friction is set for all its vehicles; its collisions are forgotten. Without
        ``refresh``, call :meth:`refresh` once after placing many.
        """
        model = self._model(slot, vehicle)
        row = self.state[slot, vehicle]
        row[:] = initial_state(model, x_m, y_m, z_m, yaw_rad, speed_mps)
        self.friction[slot] = friction
        self.wind[slot] = 0.0
        self.commands[slot, vehicle] = 0.0
        self.commands[slot, vehicle, :, COMMANDS.index("selector")] = 1.0
        self._placed.append(slot)
        if refresh:
            self.refresh()

    def roll(self, slot: int, speed_mps: float, steering_rad: float) -> None:
        """Give vehicle 0 of a slot, where it is, this speed forwards on rolling wheels, in the gear
        for it; what it drifts sideways stays. Call :meth:`refresh` once after."""
        row, model = self.state[slot, 0], self._model(slot)
        x, y, z, w = row[columns("orientation")]
        forward = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
        left = np.array([2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)])
        velocity = row[columns("velocity")]
        aside = float(velocity[0] * left[0] + velocity[1] * left[1] + velocity[2] * left[2])
        row[columns("velocity")] = speed_mps * forward + aside * left
        row[columns("wheel_speed")] = speed_mps / float(model.radius)
        row[COLUMN["steering_rad"]] = steering_rad
        row[COLUMN["gear"]], row[COLUMN["rpm"]] = gear_at(model, speed_mps)

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """Vehicles of a slot and what they hit, copied; the load is the case's."""
        self._see()
        return {name: mirror.host[slot].copy() for name, mirror in self._remembered().items()}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Put saved vehicles into a slot whose case has been placed and measured."""
        self._see()
        assert slot not in self._placed, "vehicles are measured before they are restored"
        mirrors = self._remembered()
        for name, mirror in mirrors.items():
            mirror.host[slot] = saved[name]
            mirror.push()

    def _remembered(self) -> dict[str, Mirror]:
        """What a slot takes from one period into the next."""
        return {
            "state": self._state,
            "events": self._events,
            "event_count": self._event_count,
            "friction": self._friction,
            "wind": self._wind,
            "commands": self._commands,
            "switch_step": self._switch_step,
            "first_step": self._first_step,
        }

    def refresh(self) -> None:
        """Derived columns anew, after ``state`` was written on the host."""
        self._see()
        self._events.host[self._placed] = 0.0
        self._event_count.host[self._placed] = 0
        self._placed.clear()
        for mirror in (self._state, self._events, self._event_count, self._targets):
            mirror.push()
        wp.launch(
            kernel.measure_kernel,
            (self.slots, len(self.vehicles)),
            inputs=[self._models, self._model_of.device, self._scene, self._targets.device],
            outputs=[self._rows],
            device=self._device,
            block_dim=self._block,
        )
        self._state.pull()

    def advance(self, steps: int) -> None:
        """Advance all active slots by ``steps`` physics steps."""
        self.push()
        self.launch(steps)
        self._unseen = True
        self._state.pull()

    def push(self) -> None:
        """Host inputs -> device."""
        for mirror in (
            self._friction,
            self._wind,
            self._commands,
            self._switch_step,
            self._first_step,
            self._active,
            self._targets,
            self._movers,
        ):
            mirror.push()

    def launch(self, steps: int) -> None:
        """Only the kernel: nothing is moved between host and device."""
        self._launch(
            kernel.drive_kernel,
            self.slots * self._lanes,
            [
                self._models,
                self.wheel_models,
                self._model_of.device,
                self._scene,
                self._lanes,
                steps,
                self._friction.device,
                self._wind.device,
                self._commands.device,
                self._switch_step.device,
                self._first_step.device,
                self._active.device,
                self._targets.device,
                self._movers.device,
            ],
            [
                self._rows,
                self._events.device,
                self._event_count.device,
            ],
            self._block,
        )

    def carry(self, steps: int, carried: np.ndarray, com: np.ndarray, turn: np.ndarray) -> None:
        """Move vehicles 0 of some slots evenly to a place, and see what they hit on the way; the
        others stay as they are. After :meth:`advance`, in which these slots were not active.

        Args:
            steps: physics steps that it takes.
            carried: int32 [S], see :mod:`twin.vehicle.carry_kernel`.
            com: centre of mass at the end, float64 [S, 3].
            turn: orientation at the end, float64 [S, 4].
        """
        for mirror, values in (
            (self._carried, carried),
            (self._carried_com, com),
            (self._carried_turn, turn),
        ):
            mirror.host[...] = values
            mirror.push()
        self._launch(
            carry_kernel,
            self.slots,
            [
                self._models,
                self._model_of.device,
                self._scene,
                steps,
                self._first_step.device,
                self._carried.device,
                self._carried_com.device,
                self._carried_turn.device,
                self._targets.device,
                self._movers.device,
            ],
            [
                self._rows,
                self._events.device,
                self._event_count.device,
            ],
            self._block,
        )
        self._state.pull()

    def body_at(
        self, slot: int, x_m: float, y_m: float, z_m: float, turn: np.ndarray
    ) -> np.ndarray:
        """Centre of mass [3] of a slot's vehicle 0 with its reference point there; ``turn``:
        xyzw."""
        ahead, aside, height = self._reference(self._model(slot))
        x, y, z, w = turn.tolist()
        forward_x, forward_y = 1 - 2 * (y * y + z * z), 2 * (x * y + z * w)
        forward_z = 2 * (x * z - y * w)
        left_z, up_z = 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
        yaw = math.atan2(forward_y, forward_x)
        cosine, sine = math.cos(yaw), math.sin(yaw)
        # As twin.vehicle.chassis.observe finds the reference point, the other way round.
        return np.array(
            [
                x_m - cosine * ahead + sine * aside,
                y_m - sine * ahead - cosine * aside,
                z_m - ahead * forward_z - aside * left_z + height * up_z,
            ]
        )

    def _reference(self, model: VehicleModel) -> tuple[float, float, float]:
        """Place of the reference point in a model, forwards and to the left, and the height of the
        centre of mass: looked up once, since a struct of Warp takes its time to say them."""
        for known, place in self._references:
            if known is model:
                return place
        place = float(model.reference_x), float(model.reference_y), float(model.com_height)
        self._references.append((model, place))
        return place

    def faulty(self) -> np.ndarray:
        """Which slots cannot go on, bool [S]; :meth:`fault` says why."""
        fine = np.isfinite(self.state).all(axis=2) & (self.state[..., COLUMN["fault"]] == 0.0)
        found: np.ndarray = ~fine.all(axis=1)
        return found

    def fault(self, slot: int) -> str:
        """Why a slot cannot go on, or nothing."""
        rows = self.state[slot]
        for code in rows[:, COLUMN["fault"]]:
            if code != 0.0:
                return FAULTS.get(int(code), FAULTS[1]) if math.isfinite(code) else FAULTS[1]
        return "" if np.isfinite(rows).all() else FAULTS[1]


def threads_of_a_block(slots: int, processors: int) -> int:
    """Threads of a block of the vehicles' kernels; ``processors``: of the GPU, 0: it is a CPU.

    A block of fewer threads than a warp has takes a warp's place all the same, and only eight find
    room on a multiprocessor, because a thread uses all 255 registers. Blocks therefore grow
    with the slots, up to a whole warp: 16,384 vehicles in blocks of 8 do not run at once.
    """
    block = _BLOCK
    while processors and block < _WARP and slots > block * _SCHEDULERS * processors:
        block *= 2
    return block


def _extent_m(vehicle: Vehicle) -> float:
    """No corner of the hull is farther from the centre of mass than this, whatever the load."""
    middle_m = vehicle.centre_offset_m
    shift_m = max(abs(middle_m), abs(middle_m - vehicle.wheelbase_m))
    return vehicle.length_m / 2 + vehicle.width_m / 2 + shift_m


def initial_state(
    model: VehicleModel, x_m: float, y_m: float, z_m: float, yaw_rad: float, speed_mps: float
) -> np.ndarray:
    """A level vehicle [T] at rest on its springs, rolling at a speed, in the gear for it."""
    row = np.zeros(len(TELEMETRY))
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    ahead, aside = float(model.reference_x), float(model.reference_y)
    height, radius = float(model.com_height), float(model.radius)
    row[columns("com")] = (
        x_m - cosine * ahead + sine * aside,
        y_m - sine * ahead - cosine * aside,
        z_m + height,
    )
    row[columns("orientation")] = (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))
    row[columns("velocity")] = (speed_mps * cosine, speed_mps * sine, 0.0)
    row[columns("specific_force")] = (0.0, 0.0, GRAVITY_MPS2)
    row[columns("wheel_speed")] = speed_mps / radius
    # The suspension's mount is where the wheel hangs without load.
    row[columns("suspension")] = radius - height - np.array(model.mount_z)
    row[columns("load")] = float(model.tyre_stiffness) * (np.array(model.free_radius) - radius)
    row[columns("pressure")] = row[COLUMN["traction"]] = 1.0
    row[COLUMN["impact_step"]] = row[COLUMN["rest_step"]] = -1.0
    row[COLUMN["moved"]] = float(speed_mps != 0.0)
    row[COLUMN["gear"]], row[COLUMN["rpm"]] = gear_at(model, speed_mps)
    return row


def gear_at(model: VehicleModel, speed_mps: float) -> tuple[int, float]:
    """Gear, -1: reverse, and engine speed [rpm] of a vehicle that rolls at a speed."""
    turning = abs(speed_mps) / float(model.radius) * 30 / math.pi
    ratios = [float(ratio) for ratio in model.ratios][: model.gear_count]
    gear = 1 if speed_mps >= 0.0 else -1
    while 0 < gear < len(ratios) and turning * ratios[gear - 1] > float(model.shift_up[0]):
        gear += 1
    ratio = ratios[gear - 1] if gear > 0 else float(model.reverse_ratio)
    return gear, max(float(model.idle_rpm), turning * ratio)
