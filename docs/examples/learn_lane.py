"""Learns to keep the lane from pictures, then drives a campaign as a stack.

    python docs/examples/learn_lane.py --out runs/learned            # minutes on a GPU
    python docs/examples/learn_lane.py --out runs/learned --quick    # a short form for a CPU
    PYTHONPATH=docs/examples conductor run runs/learned/learned-lane.yaml

The teacher is the lane keeping of the reference stack, which looks for markings in the same
pictures. The pupil, a small network, drives more and more of the way itself while the teacher says
what it would have done (Ross, Gordon and Bagnell, A Reduction of Imitation Learning and Structured
Prediction to No-Regret Online Learning, AISTATS 2011). It needs the extras ``gym`` and ``train``.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from learned_lane import COLUMNS, ROWS, SPEED, STEERING_MAX_RAD, pedals

from devkit.lane.lateral import LateralParameters, Wheel, steer
from devkit.lane.track import CarMotion, LaneTrack
from devkit.lane.view import LaneView
from schemas.files.yaml_file import dump_yaml
from schemas.messages import VEHICLE_COLUMNS

YAW_RATE = VEHICLE_COLUMNS.index("yaw_rate_radps")


class LaneNet(torch.nn.Module):
    """Pictures [N, 3, 36, 64], -0.5 to 0.5, to road-wheel angles [N] [rad]."""

    def __init__(self) -> None:
        super().__init__()
        sizes, layers = (3, 16, 24, 32), []
        for channels, more in itertools.pairwise(sizes):
            layers += [torch.nn.Conv2d(channels, more, 3, stride=2, padding=1), torch.nn.ReLU()]
        layers += [torch.nn.Flatten(), torch.nn.Linear(32 * 5 * 8, 64), torch.nn.ReLU()]
        self.layers = torch.nn.Sequential(*layers, torch.nn.Linear(64, 1))

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """See the class."""
        return STEERING_MAX_RAD * torch.tanh(self.layers(pictures)[:, 0])


def shrunk(pictures: torch.Tensor) -> torch.Tensor:
    """Camera pictures, uint8 [N, H, W, 3], as the network takes them: means of squares."""
    planes = pictures.permute(0, 3, 1, 2).float() / 255.0 - 0.5
    return torch.nn.functional.adaptive_avg_pool2d(planes, (ROWS, COLUMNS))


@dataclass
class Teacher:
    """Lane keeping of the reference stack, in one environment."""

    view: LaneView
    period_s: float
    parameters: LateralParameters = field(
        default_factory=lambda: LateralParameters(steering="visual")
    )

    def __post_init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """A case begins: forget the lane."""
        self.track = LaneTrack(self.view, self.parameters.lines_m, self.parameters.chassis)
        self.wheel = Wheel()

    def angle_rad(self, picture: np.ndarray, vehicle: np.ndarray) -> float:
        """What it would steer."""
        motion = CarMotion(float(vehicle[SPEED]), float(vehicle[YAW_RATE]))
        curve = self.track.update(motion, picture, self.period_s)
        bend, speed_mps = self.track.bend, motion.speed_mps
        self.wheel = steer(self.wheel, curve, bend, speed_mps, self.period_s, self.parameters)
        return self.wheel.angle_rad


class Drive:
    """All environments on their way, from round to round: so the whole road is seen."""

    def __init__(self, envs: Any) -> None:
        self.seen, _ = envs.reset()
        view = LaneView.of_site(envs.camera_sites[0])
        period_s = 1.0 / envs.metadata["render_fps"]
        self.teachers = [Teacher(view, period_s) for _ in range(envs.num_envs)]


def collected(
    envs: Any, drive: Drive, net: LaneNet | None, share: float, steps: int, device: str
) -> Any:
    """Pictures that were seen and the teacher's angles, while the pupil drives a share of the
    environments; and how far it came in those episodes that it has ended."""
    pupils = np.arange(envs.num_envs) < round(share * envs.num_envs)
    pictures, angles, ways_m = [], [], []
    seen, teachers = drive.seen, drive.teachers
    for _ in range(steps):
        camera = torch.from_dlpack(seen["camera"])
        on_host = camera.cpu().numpy()
        vehicle = torch.from_dlpack(seen["vehicle"]).cpu().numpy()
        taught = np.array(
            [t.angle_rad(on_host[i], vehicle[i]) for i, t in enumerate(teachers)], np.float32
        )
        small = shrunk(camera.to(device))
        pictures.append(small)
        angles.append(torch.from_numpy(taught))
        steered = taught.astype(float)
        if net is not None:
            with torch.no_grad():
                steered[pupils] = net(small).cpu().numpy()[pupils]
        held = np.array([pedals(float(speed)) for speed in vehicle[:, SPEED]])
        seen, _, ended, cut, infos = envs.step(np.column_stack([steered, held]))
        for env in np.flatnonzero(infos.get("_episode", [])).tolist():
            teachers[env].begin()
        for env in np.flatnonzero(ended | cut).tolist():
            if pupils[env]:
                ways_m.append(float(infos["kpis"]["distance_m"][env]))
    drive.seen = seen
    return torch.cat(pictures), torch.cat(angles).to(device), ways_m


def learn(net: LaneNet, pictures: torch.Tensor, angles: torch.Tensor, epochs: int) -> float:
    """Fit the network; the root mean square of what is left [rad]."""
    optimiser = torch.optim.Adam(net.parameters(), 1e-3)
    order = torch.Generator().manual_seed(len(angles))
    for _ in range(epochs):
        for batch in torch.randperm(len(angles), generator=order).to(angles.device).split(64):
            loss = torch.nn.functional.mse_loss(net(pictures[batch]), angles[batch])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    with torch.no_grad():
        return float((net(pictures) - angles).square().mean().sqrt())


def save(net: LaneNet, path: Path) -> None:
    """Write weights and biases, layer by layer, for the stack."""
    with_weights = [layer for layer in net.cpu().layers if hasattr(layer, "weight")]
    arrays = {}
    for number, layer in enumerate(with_weights):
        arrays[f"weight{number}"] = layer.weight.detach().numpy()
        arrays[f"bias{number}"] = layer.bias.detach().numpy()
    np.savez(path, **arrays)


def campaign(out: Path, camera: dict[str, Any]) -> Path:
    """Write the campaign that the learned stack drives."""
    path = out / "learned-lane.yaml"
    model = str((out / "lane.npz").absolute())
    autonomy = {"stack": "learned_lane:LearnedLane", "parameters": {"model": model}}
    data = {"extends": "lane-loop", "campaign": "learned-lane", "autonomy": autonomy}
    path.write_text(dump_yaml(data | ({"camera": camera} if camera else {})))
    return path


def main() -> None:
    """Collect, learn, repeat; then write the model and the campaign."""
    from twin.gym import make_vec

    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--device", default="cuda:0" if torch.cuda.is_available() else "cpu")
    options.add_argument("--envs", type=int, default=0, help="0: 64, with --quick 4")
    options.add_argument("--steps", type=int, default=0, help="per round; 0: 400, with --quick 120")
    options.add_argument("--rounds", type=int, default=0, help="0: 6, with --quick 3")
    options.add_argument("--quick", action="store_true", help="small pictures, few of them")
    given = options.parse_args()
    usual = (4, 120, 3) if given.quick else (64, 400, 6)
    asked = (given.envs, given.steps, given.rounds)
    envs_count, steps, rounds = (a or u for a, u in zip(asked, usual, strict=True))
    camera = {"name": "front_right", "width": 192, "height": 108, "hz": 10, "hfov_deg": 70}
    camera = camera if given.quick else {}
    given.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(1)
    net = LaneNet().to(given.device)
    envs = make_vec(
        "lane-loop",
        envs_count,
        sensors=["camera", "vehicle"],
        device=given.device,
        array="dlpack",
        settings={"camera": camera} if camera else None,
    )
    drive, pictures, angles = Drive(envs), [], []
    for number in range(rounds):
        share = number / max(1, rounds - 1)
        seen, taught, ways_m = collected(
            envs, drive, net if number else None, share, steps, given.device
        )
        pictures.append(seen)
        angles.append(taught)
        left_rad = learn(net, torch.cat(pictures), torch.cat(angles), epochs=12)
        drove = f", its episodes ended after {np.round(ways_m).astype(int).tolist()} m"
        print(
            f"round {number + 1}: the pupil drove {100 * share:.0f} %"
            f"{drove if ways_m else ''}; {sum(map(len, angles))} pictures, "
            f"{left_rad:.4f} rad beside the teacher",
            flush=True,
        )
    envs.close()
    save(net, given.out / "lane.npz")
    path = campaign(given.out, camera)
    print(f"PYTHONPATH=docs/examples conductor run {path}")


if __name__ == "__main__":
    main()
