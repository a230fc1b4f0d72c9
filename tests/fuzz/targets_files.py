"""Files that people write, and files that other processes left."""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_target import Target, of_file

from conductor.core.state import Config
from conductor.journal.owner import FILE_NAME as OWNER_FILE
from conductor.journal.owner import FolderClaim, FolderOwner
from conductor.journal.store import FILE_NAME as JOURNAL_FILE
from conductor.journal.store import FolderLockedError, Journal, JournalError
from conductor.records import fingerprint
from conductor.records.outcomes import read_outcomes
from conductor.records.timeline import FILE_NAME as TIMELINE_FILE
from conductor.report.autodrive import layout as autodrive_layout
from conductor.report.autodrive import logs as autodrive_logs
from conductor.report.reading import cache, leases, resources
from conductor.serve.engine import ConductorEngine
from devkit.detector.labelled_images import read_head
from devkit.replaying.replay import sensor_messages
from hpc.site import load_site
from schemas.files.assets import asset_digest
from schemas.files.drive_record import DRIVE_FILE
from schemas.files.proposals import FILE_NAME as PROPOSED_FILE
from schemas.files.proposals import with_proposals
from schemas.files.yaml_file import YamlError, load_yaml
from schemas.formulas.parse import parse_formula, parse_row_formula
from schemas.plan import parse_campaign
from twin.base.errors import InfrastructureError, TwinError, UsageError
from twin.dataset.recipe import parse_recipe
from twin.fabric import discovery
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role
from twin.kpi.robustness import robustness
from twin.records import kpi_file
from twin.records.autodrive_files import read_log_files
from twin.records.drive_record import RecordReader
from twin.records.play_file import read_play
from twin.rig.interventions.journal import read_journal
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import load_native
from twin.sensors.lidar.profile_file import load_lidar_profile
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.scene import load_scene
from viewer.playback import folder as viewer_folder
from viewer.playing.bodies import bodies, styles
from viewer.playing.eyes import top_eyes
from viewer.playing.ground import ground
from viewer.playing.layout import play_blueprint
from viewer.playing.names import body_names
from viewer.playing.recording import origin
from viewer.playing.story import fired, log_rows, summary
from viewer.recording import naming

ROOT = Path(__file__).parents[2]
MISTAKES_MAX = 500
"""Lines of a refused campaign."""


class FewRows:
    """Five ticks of any columns, in which a value of each is missing."""

    rows = 5

    def column(self, name: str) -> np.ndarray:
        return np.arange(5) * (50_000_000 if name == "sim_time_ns" else 0.5)

    def valid(self, name: str) -> np.ndarray:
        return np.arange(5) != len(name) % 5


SEARCHED = {
    "campaign": "searched",
    "matrix": {"weather": ["clear"]},
    "autonomy": {"perception": {"eyes": {"type": "ground_truth"}}},
    "search": {
        "parameters": {"scenario.ego_start_m": {"distribution": "uniform", "low": 40, "high": 100}},
        "objective": {"kpi": "dtc_min_m", "fails_below": 0.5},
        "budget": {"cases": 20, "generation": 10},
    },
}


def _formula(data: bytes) -> object:
    """A text that passes, over rows in which nothing is known of most columns."""
    text = data.decode(errors="replace")
    with contextlib.suppress(ValueError):
        parse_row_formula(text)
    parse_formula(text)
    return robustness(text, FewRows())


def _proposed(data: bytes) -> object:
    """A run's folder whose campaign file names just these lines."""
    named = {"generations": data.count(b"\n") + 1, "sha256": hashlib.sha256(data).hexdigest()}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / PROPOSED_FILE).write_bytes(data)
        content = with_proposals({"search": {"proposed": named}}, Path(folder), "campaign.yaml")
    search = {**SEARCHED["search"], "proposed": content["search"]["proposed"]}
    campaign, mistakes = parse_campaign({**SEARCHED, "search": search})
    if campaign is None:
        raise UsageError(mistakes[0].line("campaign.yaml"))
    return campaign


def _campaign(path: Path) -> object:
    campaign, mistakes = parse_campaign(load_yaml(path))
    if campaign is None:
        raise UsageError("\n".join(mistake.line(path.name) for mistake in mistakes))
    return campaign


def _scene(path: Path) -> object:
    asset_digest(path)
    return load_scene(str(path))


def _recipe(path: Path) -> object:
    data = load_yaml(path)
    return parse_recipe(data, path.name) if isinstance(data, dict) else None


def _journal(path: Path) -> None:
    """What a conductor does with the journal when it starts."""
    journal = Journal(path.parent)
    try:
        ConductorEngine(journal, Config(folder=str(path.parent)), 0)
    finally:
        journal.close()


def _kpi(path: Path) -> object:
    kpi_file.read_kpi_columns(path, ["sim_time_ns", "dtc_m"])
    return kpi_file.kpi_sha256(kpi_file.read_kpi(path))


def _outcomes(path: Path) -> object:
    viewer_folder.committed_attempts(path.parent)
    read_outcomes(path.parent)
    return fingerprint.fingerprint(path.parent)


def _owner(path: Path) -> object:
    me = FolderOwner(id="a", pid=1, host="b")
    return FolderClaim(path.parent, me, 1.0).read()


def _cached(path: Path) -> object:
    folder = path.parent / cache.FOLDER
    folder.mkdir()
    path.rename(folder / "read.msgpack")
    return [cache.unpacked(entry) for entry in cache.load(path.parent).entries.values()]


def _resources(path: Path) -> object:
    data = path.read_bytes()
    if data[:1] == b"P":
        return resources.read_resources(path.parent)
    folder = path.parent / resources.PARTS_FOLDER
    folder.mkdir()
    path.rename(folder / f"w{resources.PART_SUFFIX}")
    return resources.read_resources(path.parent)


def _key(path: Path) -> object:
    path.chmod(0o600)
    return load_key(path, Role.viewer)


def _log(data: bytes) -> object:
    instance = autodrive_layout.Instance(time_of_day=300, weather_id=1, model="yolov2")
    return autodrive_logs.read_log("batch_1/aeb_metrics_sim_inst_1.csv", data, instance)


def _logs(path: Path) -> object:
    return list(read_log_files(path.parent))


def _drive_record(path: Path) -> int:
    """What ``devkit replay`` does with it before a stack sees anything."""
    reader = RecordReader(path)
    each = {"v": 1, "seq": 0, "active": [True], "token": [1], "tick": [0], "sim_time_ns": [0]}
    return sum(len(list(sensor_messages(tick.seen, reader, each))) for tick in reader.ticks())


def _play(path: Path) -> object:
    """What ``viewer play`` does with it before a recording is written."""
    play = read_play(path)
    origin_m = origin(play)
    play_blueprint(play, origin_m)
    drawn = [ground(play, origin_m), styles(play), list(bodies(play, origin_m))]
    names = [list(body_names(play, origin_m, eye)) for eye in top_eyes(play, origin_m)]
    return [*drawn, *names, log_rows(play), fired(play, origin_m), summary(play)]


def _folder(run: Callable[[Path], Any]) -> Callable[[Path], Any]:
    return lambda path: run(path.parent)


YAML = (YamlError, UsageError)
CAMPAIGNS = tuple(sorted((ROOT / "conductor/campaigns").glob("*.yaml")))
SCENES = tuple(sorted((ROOT / "twin/world/scenes").glob("*.yaml")))
TARGETS = {
    "yaml-campaign": Target(
        of_file("c.yaml", _campaign), YAML, CAMPAIGNS, lines_max=MISTAKES_MAX, cost=20
    ),
    "formula": Target(_formula, (ValueError,)),
    "proposed": Target(_proposed, YAML, cost=5),
    "yaml-vehicle": Target(
        of_file("v.yaml", lambda path: load_vehicle(str(path))),
        (ValueError,),
        tuple(sorted((ROOT / "twin/vehicle/models").glob("*.yaml"))),
        cost=40,
    ),
    "yaml-scene": Target(of_file("s.yaml", _scene), (ValueError,), SCENES, cost=20),
    "yaml-lidar": Target(
        of_file("l.yaml", lambda path: load_lidar_profile(str(path))),
        (ValueError,),
        tuple(sorted((ROOT / "twin/sensors/lidar/profiles").glob("*.yaml"))),
        cost=10,
    ),
    "yaml-scenario": Target(
        of_file("s.yaml", lambda path: compile_native(load_native(path))),
        (ValueError,),
        tuple(sorted((ROOT / "twin/scenario/storyboard/shipped").rglob("*.yaml"))),
        lines_max=MISTAKES_MAX,
        cost=20,
    ),
    "yaml-site": Target(of_file("site.yaml", load_site), (UsageError,), lines_max=MISTAKES_MAX),
    "yaml-dataset": Target(of_file("dataset.yaml", _folder(read_head)), (UsageError,), cost=5),
    "yaml-recipe": Target(of_file("r.yaml", _recipe), (ValueError, UsageError), cost=5),
    "journal": Target(
        of_file(JOURNAL_FILE, _journal), (JournalError, UsageError, FolderLockedError), cost=10
    ),
    "owner": Target(of_file(OWNER_FILE, _owner), ()),
    "kpi": Target(of_file(fingerprint.KPI_FILE, _kpi), (InfrastructureError,), cost=3),
    "outcomes": Target(of_file("outcomes.json", _outcomes), (TwinError,)),
    "conductor-json": Target(
        of_file(discovery.FILE_NAME, _folder(discovery.find_conductor)), (UsageError,)
    ),
    "recording-note": Target(of_file(naming.RECORDING_NOTE, _folder(viewer_folder._note)), ()),
    "steering-journal": Target(of_file("interventions.jsonl", read_journal), (UsageError,)),
    "timeline": Target(of_file(TIMELINE_FILE, _folder(leases.read_leases)), ()),
    "resources": Target(of_file(resources.RESOURCES_FILE, _resources), (InfrastructureError,)),
    "report-cache": Target(of_file("read.msgpack", _cached), (ValueError,)),
    "autodrive-log": Target(_log, ()),
    "autodrive-archive": Target(of_file("batch_1.tar.gz", _logs), ()),
    "autodrive-config": Target(
        of_file("config.json", _folder(autodrive_layout.read_config)), (UsageError,)
    ),
    "autodrive-imported": Target(
        of_file(autodrive_layout.IMPORT_FILE, _folder(autodrive_layout.read_imported)),
        (InfrastructureError,),
    ),
    "key": Target(of_file("f.key", _key), (UsageError,), cost=2),
    "play": Target(of_file("s.play", _play), (UsageError,), cost=10),
    "drive-record": Target(of_file(DRIVE_FILE, _drive_record), (UsageError,), cost=2),
}
