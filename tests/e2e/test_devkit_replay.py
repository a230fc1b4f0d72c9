"""``devkit replay``: recorded drives for the same stack, an edited one, and one of another kind."""

import json

import pyarrow.parquet as parquet
from foreign_campaigns import CLASS, CLIENT, campaign, python
from processes import outcomes

from twin.records.kpi_file import kpi_sha256

FUSSY = """
class Fussy(GapStack):
    def reset(self, slot, episode):
        super().reset(slot, episode)
        self.fails = "heavy_fog" in episode.case

    def step(self, observation):
        if self.fails and observation.tick.max() == 3:
            raise ValueError("cannot see")
        return super().step(observation)
"""
"""Fails in fog: the record of such an attempt ends with the tick that it did not answer."""


def run(marked, path, out, *options):
    words = ("--workers", "1", "--output", "json", "--out", str(out), *options)
    done = marked.run("conductor", "run", str(path), *words)
    return done, json.loads(done.stdout)


def replay(marked, *words):
    done = marked.run("devkit", "replay", *map(str, words), "--output", "json")
    return done, json.loads(done.stdout) if done.stdout else None


def differing(found):
    """Case -> fields that differ, with the first tick."""
    return {
        case["case"]: {f["field"]: f["first_tick"] for f in case["fields"] if f["differ"]}
        for case in found["cases"]
    }


def digest(folder, case):
    (kpi,) = folder.glob(f"cases/{case}/attempt-*/kpi.parquet")
    return kpi_sha256(parquet.read_table(kpi))


def test_recorded_drives_for_stacks_without_a_simulator(marked, tmp_path, monkeypatch):
    (tmp_path / "gapstack.py").write_text(CLASS + FUSSY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    autonomy = {"stack": "gapstack:Fussy", "parameters": {"gap_m": 7.0}}
    weathers = {"matrix": {"weather": ["clear", "heavy_fog", "heavy_rain"]}, "attempts_max": 1}
    path = campaign(tmp_path, "recorded", autonomy, **weathers)
    folder = tmp_path / "run"
    done, _ = run(marked, path, folder, "--record-drive")
    assert done.returncode == 1, done.stderr
    assert outcomes(folder)["heavy_fog"]["outcome"] == "failed"
    # A record costs no bit of the result.
    plain = campaign(tmp_path, "plain", autonomy, matrix={"weather": ["clear"]})
    assert run(marked, plain, tmp_path / "plain")[0].returncode == 0
    assert digest(folder, "clear") == digest(tmp_path / "plain", "clear")
    assert not list((tmp_path / "plain").rglob("drive.record"))

    # The recorded stack: equal, and it fails where it failed.
    done, found = replay(marked, folder, "--plots", tmp_path / "plots")
    assert done.returncode == 1, done.stderr
    clear, fog, rain = found["cases"]
    assert (clear["case"], clear["equal"], rain["equal"]) == ("clear", True, True)
    assert clear["ticks"] >= 20
    assert "tick 3: stack: ValueError: cannot see" in fog["ended"]
    assert (fog["ticks"], fog["equal"]) == (3, False)
    assert {p.name for p in (tmp_path / "plots").iterdir()} == {
        *("clear.png", "heavy_fog.png", "heavy_rain.png")
    }
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in (tmp_path / "plots").iterdir())

    # The same policy in sixty lines of Python; what the other one did not answer is no difference.
    client = " ".join(python(CLIENT))
    given = ("--stack", client, "--parameters", '{"gap_m": 7.0}')
    done, found = replay(marked, folder, *given)
    assert done.returncode == 0, (done.stderr, found)
    assert found["cases"][1]["notes"] == [
        "tick 3: no command in the record, the stack gives one now"
    ]
    assert found["cases"][1]["ticks"] == 4

    # One that is not there is bad input, no regression.
    for wrong in ("gapstack:Gap", "nosuch:Stack", "/no/such/stack"):
        done = marked.run("devkit", "replay", str(folder), "--stack", wrong)
        assert done.returncode == 2, done.stderr
        assert wrong.partition(":")[0] in done.stderr

    # An edited one: what it does otherwise, from when on, and by how much.
    edited = ("--stack", "gapstack:GapStack", "--parameters", '{"gap_m": 6.2}')
    done, found = replay(marked, folder, "clear", *edited)
    assert done.returncode == 1
    fields = differing(found)["clear"]
    assert set(fields) == {"throttle", "brake", "aeb"}
    assert len(set(fields.values())) == 1
    assert fields["brake"] == 4
    largest = {f["field"]: f["largest"] for f in found["cases"][0]["fields"]}
    assert (largest["throttle"], largest["brake"], largest["aeb"]) == (0.3, 1.0, None)
    assert largest["steering_rad"] == 0.0
    words = marked.run("devkit", "replay", str(folder), "clear", *edited).stdout
    assert f"brake {clear['ticks']:>14}" in words
    assert words.endswith("0 of 1 equal\n")

    # Damaged ones are named, at their head or amid the ticks; the others are shown all the same.
    head, middle = (
        folder / f"cases/{case}/attempt-1/drive.record" for case in ("clear", "heavy_fog")
    )
    head.write_bytes(b"no record of a drive")
    data = bytearray(middle.read_bytes())
    data[len(data) // 2] ^= 1
    middle.write_bytes(data)
    done, found = replay(marked, folder, *given)
    assert done.returncode == 2
    assert [case["case"] for case in found["cases"]] == ["heavy_rain"]
    assert found["cases"][0]["equal"]
    assert not found["equal"]
    assert [line.partition(":")[0] for line in found["damaged"]] == [str(head), str(middle)]
    assert [line in done.stderr for line in found["damaged"]] == [True, True]

    # One that is not there has no case to be blamed for: one line.
    done, found = replay(marked, folder / "cases/heavy_rain/attempt-1", "--stack", "gapstack:None")
    assert (done.returncode, found) == (2, None), done.stderr
    assert "no class 'None'" in done.stderr
    assert "Traceback" not in done.stderr
