"""``devkit check`` finds what it is for, in stacks that break one rule each."""

import json

from foreign_campaigns import CLIENT, FAULTS, python

STACKS = '''
import random
import time

from devkit.stack import Stack
from schemas.messages import Command


class Rules(Stack):
    """Breaks one rule; ``none``: keeps them all."""

    def __init__(self, slots, *, broken="none"):
        self.broken = broken
        self.steps = [0] * slots
        self.all = 0
        self.tokens = {}

    def reset(self, slot, episode):
        if self.broken != "memory":
            self.steps[slot] = 0

    def step(self, observation):
        self.all += 1
        commands = [self.drive(slot, observation) for slot in observation.active_slots()]
        if self.broken == "twice":
            commands += commands[:1]
        if self.broken == "idle":
            commands.append(Command(1, 0, 0, 0.0, 0.0, 0.0))
        return commands

    def drive(self, slot, observation):
        self.steps[slot] += 1
        throttle = 0.001 * self.steps[slot]
        if self.broken == "clock":
            throttle = time.monotonic() % 1.0
        if self.broken == "slot":
            throttle += 0.1 * slot
        if self.broken == "range" and self.steps[slot] == 4:
            throttle = 1.5
        if self.broken == "raise" and self.steps[slot] == 4:
            raise ValueError("no idea what to do")
        tick = int(observation.tick[slot]) + (self.broken == "tick")
        if self.steps[slot] == 1 and slot not in self.tokens:
            self.tokens[slot] = int(observation.token[slot])
        token = self.tokens[slot] if self.broken == "token" else int(observation.token[slot])
        return Command(slot, token, tick, throttle, 0.0, 0.0)
'''


def run(marked, *words):
    done = marked.run("devkit", "check", *words, "--ticks", "15", "--output", "json")
    return done, json.loads(done.stdout) if done.stdout else None


def failed(found):
    return {c["check"]: c["detail"] for c in found["checks"] if not c["passed"]}


def test_a_broken_rule_is_named(marked, tmp_path, monkeypatch):
    (tmp_path / "rules.py").write_text(STACKS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    said = {}
    wrong = ("clock", "memory", "slot", "range", "tick", "token", "raise", "twice", "idle")
    for broken in ("none", *wrong):
        given = json.dumps({"broken": broken})
        done, found = run(marked, "rules:Rules", "--parameters", given)
        assert done.returncode == (0 if broken == "none" else 1), done.stderr
        said[broken] = failed(found)
    assert said["none"] == {}
    assert set(said["clock"]) == {"forgets at reset", "lost frames", "deterministic"}
    assert set(said["memory"]) == {"forgets at reset", "lost frames"}
    assert "tick 0: throttle is" in said["memory"]["forgets at reset"]
    assert set(said["slot"]) == {"deterministic"}
    assert said["range"] == {"units and ranges": "tick 3: command throttle is 1.5, allowed: 0 to 1"}
    assert "tick 0: the command is for tick 1" in said["tick"]["commands"]
    assert set(said["token"]) == {"forgets at reset"}
    assert "; echo the tick's" in said["token"]["forgets at reset"]
    assert "ValueError: no idea what to do" in said["raise"]["answers"]
    assert said["twice"]["commands"] == "tick 0: commands for slots [0, 0], only 0 is active"
    assert "tick 0: commands for slots [0, 1], only 0 is active" in said["idle"]["commands"]


def test_foreign_stacks_are_checked_as_they_run(marked, tmp_path):
    done, found = run(marked, " ".join(python(CLIENT)))
    assert done.returncode == 0, found
    assert len(found["checks"]) == 8
    # One that steps again when asked again.
    stepping = tmp_path / "stepping.py"
    source = CLIENT.read_text()
    again = '        say("command", answer)  # asked again'
    assert again in source
    source = source.replace(again, '        say("command", answer | {"again": 1})  # asked again')
    stepping.write_text(source)
    done, found = run(marked, " ".join(python(stepping)))
    assert done.returncode == 1
    assert set(failed(found)) == {"repeated seq"}
    # Some whose every answer is not what was asked for.
    said = '            say("command", answer)\n'
    assert CLIENT.read_text().count(said) == 1
    for name, expected in (
        ("twice", "tick 0: commands for slots [0, 0], only 0 is active"),
        ("slot", "tick 0: commands for slots [0, 1], only 0 is active"),
        ("seq", "answers seq 1, asked for 0; echo the tick's"),
    ):
        stepping.write_text(CLIENT.read_text().replace(said, f"            {FAULTS[name]}\n{said}"))
        done, found = run(marked, " ".join(python(stepping)))
        assert done.returncode == 1, done.stderr
        assert expected in " ".join(failed(found).values()), failed(found)
    # One that ends, one that says nothing, one that is not there.
    done, found = run(marked, f"{python(CLIENT)[0]} -c 'print(\"bye\"); raise SystemExit(4)'")
    assert done.returncode == 1
    assert failed(found) == {"starts": "stack exit code 4: bye"}
    done, found = run(marked, "sleep 100", "--deadline-s", "3")
    assert done.returncode == 1
    assert failed(found) == {"starts": "stack does not say that it is ready within 3 s"}


def test_what_cannot_be_checked_is_bad_input(marked, tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("campaign: c\nautonomy: {bridge: autodrive, comand: [x]}\nmatrix: {}\n")
    for words, line in (
        (("no.yaml",), "no.yaml: "),
        (("run 'this",), "No closing quotation"),
        ((str(path),), "autonomy.comand"),
        (("gap:Stack", "--parameters", "[]"), "expected a JSON object"),
        (("/no/such/stack",), "no command '/no/such/stack' here"),
        (("nosuch:Stack",), "no module 'nosuch'"),
        (("devkit.aeb:AebStak",), "did you mean 'AebStack'?"),
        (("devkit.aeb:AebStack", "--parameters", '{"gap": 1}'), "unknown parameter of devkit.aeb"),
    ):
        done, _ = run(marked, *words)
        assert done.returncode == 2
        assert line in done.stderr
