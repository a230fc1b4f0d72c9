"""Small campaigns for stacks in processes of their own, and such stacks."""

import json
import sys
from pathlib import Path

CLIENT = Path(__file__).parents[2] / "docs/examples/drive_client.py"
"""The stack of sixty lines."""

CLASS = '''
from devkit.stack import Stack
from schemas.messages import BOX_COLUMNS, Command

DISTANCE = BOX_COLUMNS.index("distance_m")


class GapStack(Stack):
    """The policy of drive_client.py."""

    def __init__(self, slots, *, gap_m=15.0):
        self.gap_m = gap_m
        self.braking = [False] * slots

    def reset(self, slot, episode):
        self.braking[slot] = False

    def step(self, observation):
        return [self.drive(slot, observation) for slot in observation.active_slots()]

    def drive(self, slot, observation):
        boxes = observation.boxes(slot)
        if boxes is not None:
            self.braking[slot] |= bool((boxes[:, DISTANCE] < self.gap_m).any())
        braking = self.braking[slot]
        token, tick = int(observation.token[slot]), int(observation.tick[slot])
        return Command(slot, token, tick, 0.0 if braking else 0.3, float(braking), 0.0, braking)
'''

FAULTS = {
    "exit": "sys.exit(7)",
    "crash": "os.kill(os.getpid(), 11)",
    "hang": "threading.Event().wait()",
    "tick": "answer['commands'][0]['tick'] += 1",
    "nan": "answer['commands'][0]['throttle'] = float('nan')",
    "range": "answer['commands'][0]['brake'] = 1.5",
    "garbage": "session.put(f'drive/{RIG}/command', b'hello')",
    "silent": "answer['commands'] = []",
    "major": "answer['v'] = 0",
    "token": "answer['commands'][0]['token'] += 1",
    "twice": "answer['commands'] *= 2",
    "slot": "answer['commands'].append({**answer['commands'][0], 'slot': 1})",
    "seq": "answer['seq'] += 1",
}
"""What a stack may do at tick 3; the case's number in this order says which."""


HOSTILE = {
    "none": "pass",
    "flood": "for _ in range(10**6): say('command', answer)",
    "giant": "session.put(f'drive/{RIG}/command', bytes(4 * 10**8), congestion_control=BLOCK)",
    "forks": "[subprocess.Popen(['sleep', '600']) for _ in range(300)]; threading.Event().wait()",
    "orphans": "subprocess.run(['sh', '-c', 'setsid sleep 600 &']); sys.exit(9)",
    "none again": "pass",
}
"""What a hostile one may do."""


def faulty(folder: Path, faults: dict[str, str]) -> Path:
    """The client, with one of ``faults`` in every case."""
    source = CLIENT.read_text()
    lines = [
        "            case = now and next(iter(names.values()))",
        "            if head['tick'][0] == 3:",
        "                fault = list(FAULTS)[int(case.rsplit('_', 1)[1])]",
        "                print('now comes', fault, flush=True)",
        "                exec(FAULTS[fault])",
    ]
    source = source.replace(
        '    elif topic == "episode":\n',
        '    elif topic == "episode":\n        names = {0: head["case"]}\n',
    )
    answered = '            say("command", answer)\n            arrays'
    assert answered in source
    source = source.replace(answered, "\n".join(lines) + "\n" + answered)
    path = folder / "faulty.py"
    path.write_text(f"import subprocess, sys, threading\nFAULTS = {faults!r}\n{source}")
    return path


def campaign(folder: Path, name: str, autonomy: dict, **sections: object) -> Path:
    """A campaign file with cases of two seconds: the client stops before the obstacle."""
    content = {
        "campaign": name,
        "seed": 3,
        "scenario": {
            "ego_start_m": 24,
            "ego_speed_mps": 7,
            "duration_s": 3,
            "standstill_s": 0.5,
        },
        "camera": {"width": 64, "height": 36, "hz": 10},
        # These stacks do by name what they do to a case.
        "autonomy": {"tell": ["case"], **autonomy},
        "matrix": {"weather": ["clear"]},
        **sections,
    }
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(content))  # JSON is YAML
    return path


def python(script: Path, *words: str) -> list[str]:
    """The command line of a Python script."""
    return [sys.executable, str(script), *words]
