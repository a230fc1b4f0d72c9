"""Writes one valid seed per format: fuzzing begins with what is accepted. Run it again when a
message or a file has changed; other seeds stay::

    cd tests; C=unit/twin/scenario/storyboard/compile
    PYTHONPATH=.:fuzz:unit/conductor/report:$C python fuzz/fuzz_seeds.py
"""

from __future__ import annotations

import io
import json
import struct
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import onnx
import pyarrow.parquet as pq
import yaml
from autodrive_logs import config, drive
from certificates import made
from compiled_text import HEADER, ROADS, SPEED, TELEPORT, by_entity, compiled, scenario_text
from darknet_oracle import random_weights
from fuzz_target import SEEDS
from integer_networks import PLAIN, convolution, head, network
from played_files import played
from road_files import crossing
from road_furniture import furniture_file
from road_networks import composed_file, junction_file, shapes_file, turned_file
from ros2_recordings import (
    MAKE,
    PERIOD_NS,
    START_NS,
    ahead,
    circle_rows,
    odometry,
    transform,
    write_bag,
)
from targets_assets import CFG, small_network
from targets_stores import CASE, MARK, MemoryStore
from targets_wire import CONTROL, DRIVE, PART, STEERING, VIEW
from test_compile_trajectories import follow, vertex
from tiny_networks import write_dark_spot_detector
from wire_messages import case, control, drive_plane, result, steering, view_plane

from conductor.certify.form import encode_certificate
from conductor.certify.proof import prove
from conductor.core.facts import EpochRaised
from conductor.core.snapshot import take
from conductor.core.state import Config
from conductor.journal.owner import this_process
from conductor.journal.store import FILE_NAME as JOURNAL_FILE
from conductor.journal.store import Journal
from conductor.records.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.report.autodrive.layout import ImportNote
from conductor.report.reading.cache import Cache
from conductor.report.reading.resources import RESOURCES_SCHEMA
from conductor.serve.engine import ConductorEngine, IncomingRequest
from conductor.stored.owner import StoreClaims
from conductor.stored.replica import head_name
from conductor.stored.replicator import Replicator
from conductor.stored.seals import StoreSeal
from devkit.darknet.weights import write_weights
from devkit.detector.integer.network_file import encode_network
from devkit.detector.integer.steps import IntegerPool
from schemas import SCHEMA_VERSION as V
from schemas.files.drive_record import RecordAnswer, RecordHead, RecordSeen
from schemas.files.kpi import KPI_COLUMNS
from schemas.files.yaml_file import dump_yaml
from schemas.messages import Command, Detection
from schemas.wire.case_files import CaseFilePiece, CaseFileRequest
from schemas.wire.codec import encode
from schemas.wire.control import Result, Sealed
from schemas.wire.delivery import SeenFolder
from schemas.wire.interventions import (
    JournalEnd,
    JournalHead,
    SetLights,
)
from schemas.wire.interventions import RecordedAction as Steered
from twin.dataset.recipe import parse_recipe
from twin.fabric.discovery import ConductorFile
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import as_line
from twin.fabric.ros2.attachment import Attachment
from twin.fabric.ros2.names import Endpoint, Entity, RosNode, endpoint_token, node_token
from twin.records.drive_record import RecordWriter, coded
from twin.records.kpi_file import kpi_table
from twin.rig.pipe import CaseDone, Progress, pack
from twin.road.opendrive.reading.reader import read_network
from twin.ros2.commands import write_plain
from twin.ros2.parts import MessageParts
from twin.ros2.store import type_store
from twin.ros2.tables import COMMAND_TYPES
from twin.scenario.storyboard.parsing import ProgramAnswer
from twin.stores.objects import attempt_name, put_attempt, put_pack
from twin.worker.spool import pack as spooled
from twin.world.apart.checks import pack as packed
from twin.world.apart.frames import write_frame
from twin.world.meshes.apart import MESH_DATA
from twin.world.meshes.mesh_file import MeshData, Part

DETECTION = Detection("car", 0.9, 1.0, 2.0, 3.0, 4.0)


def _write_clusters() -> None:
    """What clusters say, and the files that say which there are."""
    sites = {
        "north": {
            "scheduler": "slurm",
            "ssh": "me@login",
            "folder": "/home/me",
            "bin": "/opt/bin",
            "workers": 2,
            "time": "01:00",
            "cost": 0.5,
            "modules": ["cuda/12"],
        },
        "pool": {
            "scheduler": "kubernetes",
            "kubeconfig": "/home/me/.kube/pool",
            "gpus": 1,
            "directives": ["--image=a:1"],
            "connect": "tls/login:7447",
        },
        "south": {"scheduler": "pbs", "dials_out": True, "bin": "/opt/bin", "partition": "gpu"},
    }
    _write("yaml-sites", "three", yaml.safe_dump({"listen": "tls/0.0.0.0:1", "sites": sites}))
    book = {
        "campaign": "aeb-demo",
        "run": "0123",
        "made": 1,
        "allocations": [
            {
                "id": "north-1",
                "site": "north",
                "scheduler": "slurm",
                "workers": 2,
                "walltime_h": 1.0,
                "made_s": 1.8e9,
                "job": "12",
                "state": "running",
            }
        ],
        "sites": {"north": {"failures": 1, "rests_until_s": 1.8e9, "cost": 0.5}},
    }
    _write("allocations", "one", json.dumps(book))
    answers = {
        "id": "12\n",
        "scontrol": "JobId=12 JobState=RUNNING Reason=None Restarts=1 ExitCode=0:0 NodeList=n1",
        "sacct": "CANCELLED by 0|0:15|n1|2\n",
        "sinfo": "gpu*|1-00:00:00|4|gpu:a100:8|up\n",
        "qstat": "Job Id: 7.head\n    job_state = F\n    Exit_status = 1\n    comment = a\n\tb\n",
        "queues": "Queue: work\n    started = True\n    resources_max.walltime = 24:00:00\n",
    }
    for name, text in answers.items():
        _write("batch-answer", name, text)
    status = {"phase": "Running", "containerStatuses": []}
    pod = {
        "metadata": {"name": "a", "labels": {"app.kubernetes.io/component": "conductor"}},
        "spec": {"nodeName": "n1", "containers": [{"name": "conductor"}]},
        "status": status,
    }
    template = {"spec": {"containers": [{"name": "conductor"}]}}
    event = {"type": "Warning", "reason": "FailedCreate", "message": "exceeded quota"}
    pod |= event | {"involvedObject": {"name": "dt-x-worker"}}
    job = {"spec": {"template": template}, "status": {"failed": 1}, "items": [pod]}
    _write("kube-answer", "running", f"200\n{json.dumps(job)}")
    refusal = {"kind": "Status", "message": "jobs is forbidden", "code": 403}
    _write("kube-answer", "forbidden", f"403\n{json.dumps(refusal)}")


def _write(target: str, name: str, data: bytes | str) -> None:
    folder = SEEDS / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)


def _messages(target: str, types: Sequence[Any], messages: Sequence[Any]) -> None:
    for index, message in enumerate(messages):
        kinds = [i for i, type_ in enumerate(types) if isinstance(message, type_)]
        data = bytes(kinds[:1]) + encode(message)
        _write(target, f"{type(message).__name__.lower()}-{index}", data)


def _ros2_wire() -> None:
    node, type_name = RosNode("ab", 0, "driver"), "geometry_msgs/msg/Twist"
    endpoint = Endpoint(node, 1, Entity.publisher, "/drive", type_name, "RIHS01_" + "0" * 64)
    _write("ros2-token", "node", node_token(0, node))
    _write("ros2-token", "publisher", endpoint_token(0, endpoint))
    _write("ros2-attachment", "good", Attachment(1, 2, bytes(16)).encoded())
    store = type_store()
    parts = MessageParts(store)
    twist = store.make(type_name, linear=parts.vector(1.0), angular=parts.vector(z=0.1))
    drive = store.make(
        "ackermann_msgs/msg/AckermannDrive",
        **dict.fromkeys(("steering_angle", "steering_angle_velocity"), 0.1),
        **dict.fromkeys(("speed", "acceleration", "jerk"), 1.0),
    )
    gear = store.make("autoware_vehicle_msgs/msg/GearCommand", stamp=parts.time(0), command=2)
    for message in (write_plain(store, 0, Command(0, 0, 7, 0.1, 0.0, 0.0)), twist, drive, gear):
        index = COMMAND_TYPES.index(message.__msgtype__)
        name = message.__msgtype__.rpartition("/")[2].lower()
        _write("ros2-pedals", name, bytes([index]) + store.encode(message))


def _wire() -> None:
    _messages("wire-control", CONTROL, control())
    _messages("wire-drive", DRIVE, drive_plane())
    _messages("wire-view", VIEW, view_plane())
    _messages("wire-steering", STEERING, steering())
    _write("wire-delivery", "seen", encode(SeenFolder(V, "c", "0" * 64)))
    _write("wire-case-file", "log", encode(CaseFileRequest(V, "c", "c1", "log.txt", -1000)))
    _write("wire-case-piece", "log", encode(CaseFilePiece(V, b"log", 1, 4, 1, "0" * 64)))
    ready, tick, _, frame, _ = (encode(message) for message in drive_plane())
    parts = [(0, ready, b""), (3, bytes(12), frame), (1, tick, b"")]
    stream = b"".join(PART.pack(k, len(a), len(b)) + a + b for k, a, b in parts)
    _write("wire-stack-end", "seq", stream)
    _write("wire-pipe", "done", pack(Progress([65537], [3])) + pack(CaseDone(result())))
    _write("wire-socketio", "event", '42["Bridge",{"V1 Throttle":"0.1"}]')
    _write("view-points", "two", np.arange(8, dtype="<i2").tobytes())
    _write("view-jpeg", "small", cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    _write("spool", "result", spooled(result(), control()[0]))


def _conductor_files(folder: Path) -> None:
    journal = Journal(folder, owner=this_process())
    engine = ConductorEngine(journal, Config(folder=str(folder)), 0)
    hello, next_, *_, submit = control()[:5]
    for request in (submit, hello, msgspec.structs.replace(next_, results=[], held=[])):
        engine.turn([IncomingRequest(encode(request), 1)])
    journal.append([EpochRaised(engine.state.epoch + 1)])
    journal.close()
    _write("journal", "leased.db", (folder / JOURNAL_FILE).read_bytes())
    engine = ConductorEngine(journal := Journal(folder), Config(folder=str(folder)), 0)
    engine.close()
    journal.close()
    _write("journal", "snapshot.db", (folder / JOURNAL_FILE).read_bytes())
    _write("owner", "mine", msgspec.json.encode(this_process()))
    found = ConductorFile("tcp/127.0.0.1:7447", 1, "node", 1, "twin", "0.1.0")
    _write("conductor-json", "mine", msgspec.json.encode(found))
    passed = CaseOutcome(
        outcome="verdict",
        verdict="pass",
        attempt_dir="cases/clear/attempt-1",
        kpi_sha256="0" * 64,
    )
    lost = CaseOutcome(outcome="unresolved", reasons=["crash"])
    outcomes = Outcomes(
        campaign="c",
        digest="0" * 64,
        seed=1,
        simulator="twin",
        software="0" * 64,
        device="same",
        device_classes=[],
        complete=True,
        cases={},
    )
    for name, ended in (("passed", passed), ("lost", lost)):
        with_case = msgspec.structs.replace(outcomes, cases={"clear": ended})
        _write("outcomes", name, encode_outcomes(with_case))
    event = {"at_s": 1.0, "event": "leased", "case": "clear", "worker": "w", "token": 1}
    _write("timeline", "leased", json.dumps(event) + "\n")


def _stores(folder: Path) -> None:
    """Objects of a conductor and of a worker, as they lie in a store."""
    store = MemoryStore()
    seal = StoreSeal(store, None)
    state = folder / "stored"
    state.mkdir()
    journal = Journal(state, owner=this_process())
    engine = ConductorEngine(journal, Config(folder=str(state)), 0)
    own = StoreClaims(store, seal).claim(1, 1, this_process(), "ab" * 16)
    journal.mirror = made = Replicator(store, seal, own, journal.rows)
    hello, next_, *_, submit = control()[:5]
    for request in (submit, hello, msgspec.structs.replace(next_, results=[], held=[])):
        engine.turn([IncomingRequest(encode(request), 1)])
    made.round()
    tail = dict(store.objects)
    engine.close()
    journal.append([take(engine.state)])
    made.round()
    journal.close()
    _write("store-mark", "owner", store.objects["owner/000001"])
    for kind, name in (("owner", "owner/000001"), ("head", head_name(1))):
        _write(f"store-{kind}", "written", store.objects[name].partition(b"\n")[2])
    objects = [name for name in (*tail, *store.objects) if name.startswith("objects/")]
    for number, name in enumerate(dict.fromkeys(objects)):
        kind = "tail" if name in tail else "pack"
        _write(f"store-{kind}", f"object-{number}", {**tail, **store.objects}[name])
    done = Result(*CASE, 1, "verdict", "pass", manifest_sha256=MARK)
    (folder / "log.txt").write_bytes(b"a log\n")
    put_attempt(store, folder, done, 1)
    _write("store-attempt", "log", store.objects[attempt_name(*CASE, MARK)])
    put_pack(store, "w1", 1, [Sealed(1, "w1", encode(done), bytes(64))])
    (name,) = store.names("results/")
    _write("store-results", "one", store.objects[name])


def _result_files(folder: Path) -> None:
    values: dict[str, Any] = {"float64": 1.5, "int32": 1, "int64": 2, "bool": True, "name": "car"}
    values["detections"] = [
        {
            **dict.fromkeys(("confidence", "x_px", "y_px", "width_px", "height_px"), 1.0),
            "label": "car",
        }
    ]
    data = io.BytesIO()
    pq.write_table(kpi_table({c.name: [values[c.type]] for c in KPI_COLUMNS}), data)
    _write("kpi", "row.parquet", data.getvalue())
    data = io.BytesIO()
    pq.write_table(RESOURCES_SCHEMA.empty_table(), data)
    _write("resources", "none.parquet", data.getvalue())
    _write("recording-note", "whole", '{"complete": true, "samples": 3, "lost": 0, "kept": true}')
    head = JournalHead(V, 1, "0" * 64, "cpu:avx2", 1, case())
    lines = [head, Steered(3, 150_000_000, SetLights(None)), JournalEnd("verdict", "pass", "", 4)]
    _write("steering-journal", "lights", b"\n".join(msgspec.json.encode(line) for line in lines))
    _write("report-cache", "none", msgspec.msgpack.encode(Cache()))
    key = (make_keys(folder / "keys", days=36_500) / "viewer.key").read_bytes()
    _drive_record(folder / "d")
    _write("play", "small", msgspec.msgpack.encode(played()))
    _write("key", "viewer", key)
    _write("key", "line", as_line(key))


def _certificates() -> None:
    certificate = made()
    _write("certificate", "table", encode_certificate(certificate))
    rows = msgspec.json.encode(certificate.rows)
    lines = (certificate.signed, rows, certificate.campaign, certificate.lock)
    _write("certificate-signed", "table", b"\n".join(lines))
    few = msgspec.json.encode({"schemas/files/software.py": "0" * 64, "twin/cli.py": "1" * 64})
    _write("certificate-signed", "with-files", b"\n".join((*lines, few)))
    _write("certificate-proof", "case", prove(certificate, certificate.rows[3].case))
    _write("certificate-lock", "three", certificate.lock)


def _drive_record(path: Path) -> None:
    """Two ticks with an array of each coding, and one that was cut off."""
    writer = RecordWriter(path, RecordHead(V, 1, "0" * 64, "cpu:avx2", 1, case()))
    sensors = {
        "camera": coded(np.arange(36, dtype=np.uint8).reshape(3, 4, 3)),
        "lidar.roof": coded(np.arange(120, dtype=np.float32).reshape(40, 3), 7),
        "imu": coded(np.zeros(4)),
    }
    assert {each.coding for each in sensors.values()} == {"png", "zlib", "raw"}
    for tick in range(2):
        writer.write(RecordSeen(tick, 50_000_000 * tick, sensors))
        writer.write(RecordAnswer(Command(0, 1, tick, 0.5, 0.0, 0.1)))
    _write("drive-record", "cut", path.read_bytes()[:-7])
    writer.end("verdict", "pass", "")
    _write("drive-record", "whole", path.read_bytes())


def _autodrive() -> None:
    instance = config()["simulation_instances"][0] | {"model": "yolov2"}
    rows = drive(instance)[:6]
    text = "\n".join([",".join(rows[0]), *(",".join(row.values()) for row in rows), ""])
    _write("autodrive-log", "six-rows", text)
    _write("parity-table", "six-rows", text)
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        member = tarfile.TarInfo("batch_1/aeb_metrics_sim_inst_1.csv")
        member.size = len(text)
        archive.addfile(member, io.BytesIO(text.encode()))
    _write("autodrive-archive", "one", packed.getvalue())
    _write("autodrive-config", "four", json.dumps(config()))
    imported = ImportNote("logs", "0" * 64, 1, 6, [], [], {"a": "b"}, {"a": 1}, [])
    _write("autodrive-imported", "one", msgspec.json.encode(imported))


def _assets(folder: Path) -> None:
    spots = write_dark_spot_detector(folder / "spots.onnx")
    model = onnx.load(spots)
    _write("onnx", "spots", spots.read_bytes())
    _write(
        "integer-network",
        "small",
        encode_network(network(convolution(0, 3, 4), IntegerPool(1, PLAIN), head(2, 4))),
    )
    _write("detector-description", "spots", model.metadata_props[0].value)
    _write("darknet-cfg", "head", CFG)
    write_weights(folder / "w", small_network(), random_weights(small_network(), 7))
    _write("darknet-weights", "whole", (folder / "w").read_bytes())
    _write("darknet-names", "two", "car\ntruck\n")
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    _write("mesh-obj", "face", f"{corners}f 1 2 3\n")
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    _write("mesh-ply", "face", f"{head}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    points = np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    _write("mesh-stl", "face", bytes(80) + struct.pack("<I", 1) + points.tobytes() + bytes(2))
    _gltf()
    np.save(folder / "h.npy", np.arange(9, dtype=np.float32).reshape(3, 3))
    _write("heights-npy", "nine", (folder / "h.npy").read_bytes())
    picture = cv2.imencode(".png", np.arange(9, dtype=np.uint8).reshape(3, 3))[1]
    _write("heights-png", "nine", picture.tobytes())
    picture_rgb = np.arange(27, dtype=np.uint8).reshape(3, 3, 3)
    for kind in ("png", "jpg", "bmp", "webp"):
        _write("picture", kind, cv2.imencode(f".{kind}", picture_rgb)[1].tobytes())


def _gltf() -> None:
    import trimesh

    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    scene = trimesh.Scene(mesh)
    _write("mesh-glb", "face", scene.export(file_type="glb"))
    files = scene.export(file_type="gltf", embed_buffers=True)
    _write("mesh-gltf", "face", files["model.gltf"])
    points = np.eye(3)
    picture = np.zeros((2, 2, 3), np.uint8)
    faces, color = np.array([[0, 1, 2]]), np.full((1, 3), 0.5)
    part = Part(points, faces, color, uv=points[:, :2].copy(), image=picture)
    answer = bytearray()
    write_frame(answer.extend, *packed(MeshData([part], ["m.obj: a note"]), MESH_DATA))
    _write("mesh-answer", "face", bytes(answer))


def _yaml() -> None:
    _write("yaml-site", "partition", "partition: short\n")
    _write_clusters()
    _write("yaml-recipe", "small", "count: 10\nseed: 3\n")
    recipe = msgspec.to_builtins(parse_recipe({"count": 10}, "r"))
    head = {"format": 1, "software": "0", "recipe": recipe, "complete": True}
    _write("yaml-dataset", "empty", dump_yaml({**head, "counts": {"train": {"images": 10}}}))


def _roads() -> None:
    _write("opendrive", "shapes", shapes_file())
    _write("opendrive", "composed", composed_file())
    _write("opendrive", "turned", turned_file())
    _write("opendrive", "junction", junction_file())
    _write("opendrive", "two-roads", ROADS)
    _write("opendrive", "furniture", furniture_file())
    data = msgspec.msgpack.encode(read_network(crossing(), "r.xodr"))
    _write("opendrive-answer", "crossing", data)
    data = msgspec.msgpack.encode(read_network(shapes_file(), "r.xodr"))
    _write("opendrive-answer", "shapes", data)
    data = msgspec.msgpack.encode(read_network(furniture_file(), "r.xodr"))
    _write("opendrive-answer", "furniture", data)


_LAMP = (
    "<AppearanceAction><LightStateAction><LightType><VehicleLight "
    'vehicleLightType="indicatorLeft"/></LightType><LightState mode="flashing" '
    'flashingOnDuration="0.4" flashingOffDuration="0.6"/></LightStateAction></AppearanceAction>'
)
_SKY = (
    '<EnvironmentAction><Environment name="e"><TimeOfDay animation="false" '
    'dateTime="2026-01-31T22:30:00"/><Weather fractionalCloudCover="sixOktas"><Sun azimuth="1" '
    'elevation="0.5" illuminance="900"/><Fog visualRange="80"/><Precipitation '
    'precipitationType="rain" precipitationIntensity="4"/><Wind direction="2" speed="7"/></Weather>'
    '<RoadCondition frictionScaleFactor="0.6" wetness="moist"/></Environment></EnvironmentAction>'
)


def _scenarios(folder: Path) -> None:
    lane = '<LanePosition roadId="b" laneId="-1" s="{}" offset="0.5"/>'
    place = f"<Position>{lane}</Position>"
    moved = f"<PrivateAction>{TELEPORT.format(lane.format(5))}</PrivateAction>"
    lines = "".join(vertex(x, x * 0.1, h=0.1, time=x) for x in (0.0, 2.0, 5.0))
    controls = "".join(
        f'<ControlPoint weight="{1 + x}">{place.format(10 * x)}</ControlPoint>' for x in range(4)
    )
    knots = "".join(f'<Knot value="{value}"/>' for value in (0, 0, 0, 0, 1, 1, 1, 1))
    bend = f'<Clothoid curvature="0" curvatureDot="0.001" length="40">{place.format(1)}</Clothoid>'
    other = '<RelativeTargetLane entityRef="Other" value="1"/>'
    dynamics = (
        '<LaneChangeActionDynamics dynamicsShape="cubic" dynamicsDimension="rate" value="2"/>'
    )
    change = f"<LaneChangeAction>{dynamics}<LaneChangeTarget>{other}</LaneChangeTarget>"
    acquired = f"<AcquirePositionAction>{place.format(9)}</AcquirePositionAction>"
    declared = (
        '<ParameterDeclarations><ParameterDeclaration name="v" parameterType="double" value="3">'
        '<ConstraintGroup><ValueConstraint rule="lessThan" value="9"/></ConstraintGroup>'
        "</ParameterDeclaration></ParameterDeclarations>"
    )
    reach = f'<ReachPositionCondition tolerance="2">{place.format(30)}</ReachPositionCondition>'
    distance = (
        '<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal" '
        'value="4" freespace="true" rule="lessThan" coordinateSystem="lane"/>'
    )
    texts = {
        "speed": scenario_text(),
        "placed": scenario_text(init=moved, condition=by_entity(reach), edge="rising", delay="1"),
        "polyline": scenario_text(action=follow(f"<Polyline>{lines}</Polyline>")),
        "nurbs": scenario_text(action=follow(f'<Nurbs order="4">{controls}{knots}</Nurbs>')),
        "clothoid": scenario_text(init=moved, action=follow(bend)),
        "lane": scenario_text(
            init=moved,
            action=f"<PrivateAction><LateralAction>{change}</LaneChangeAction></LateralAction>"
            "</PrivateAction>",
            condition=by_entity(distance),
        ),
        "acquire": scenario_text(
            init=moved,
            action=f"<PrivateAction><RoutingAction>{acquired}</RoutingAction></PrivateAction>",
        ),
        "surroundings": scenario_text(
            init=f"<PrivateAction>{_LAMP}</PrivateAction>",
            action=f"<GlobalAction>{_SKY}</GlobalAction>",
        ),
        "expression": scenario_text(
            before=declared,
            action=f"<PrivateAction>{SPEED.format('${$v * 2 ** 3}')}</PrivateAction>",
        ),
    }
    for name, text in texts.items():
        _write("openscenario", name, text)
        program = msgspec.structs.replace(compiled(folder, text).program, network=None)
        answer = ProgramAnswer((), ("a note",), program, 0)
        _write("program-answer", name, msgspec.msgpack.encode(answer))
    inner = {
        "set": '<DistributionSet><Element value="1"/><Element value="2"/></DistributionSet>',
        "range": '<DistributionRange stepWidth="0.5"><Range lowerLimit="0" upperLimit="2"/>'
        "</DistributionRange>",
    }
    head = f'<OpenSCENARIO>{HEADER}<ParameterValueDistribution><ScenarioFile filepath="s.xosc"/>'
    tail = "</ParameterValueDistribution></OpenSCENARIO>"
    for name, values in inner.items():
        single = f'<DeterministicSingleParameterDistribution parameterName="v">{values}'
        text = f"<Deterministic>{single}</DeterministicSingleParameterDistribution></Deterministic>"
        _write("openscenario-distribution", name, f"{head}{text}{tail}")
    drawn = (
        '<NormalDistribution expectedValue="5" variance="4"><Range lowerLimit="0" upperLimit="9"/>'
    )
    text = (
        '<Stochastic numberOfTestRuns="3" randomSeed="1"><StochasticDistribution parameterName="v">'
        f"{drawn}</NormalDistribution></StochasticDistribution></Stochastic>"
    )
    _write("openscenario-distribution", "normal", f"{head}{text}{tail}")


def _ros2(folder: Path) -> None:
    """A command of each type, and drives of odometry with objects and of transforms."""
    store, command = type_store(), Command(0, 0, 3, 0.5, 0.0, 0.1, detections=[DETECTION])
    _write("ros2-command", "drive", b"\0" + store.encode(write_plain(store, 7, command)))
    fields = ("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk")
    wheel = store.make("ackermann_msgs/msg/AckermannDrive", **dict.fromkeys(fields, 0.5))
    for message in (wheel, odometry(7, (1.0, 2.0, 0.5)).twist.twist):
        number = COMMAND_TYPES.index(message.__msgtype__)
        _write("ros2-command", f"type-{number}", bytes([number]) + store.encode(message))
    times = [START_NS + tick * PERIOD_NS for tick in range(8)]
    rows = [("/tf", t, transform(t, "map", "base_link", (t % 9.0, 0.0, 0.0))) for t in times]
    seen = MAKE.detections(START_NS, "base_link", [ahead("a", "car", 9.0, 1.0)])
    for name, told in (
        ("odometry.mcap", circle_rows(8)),
        ("transforms.mcap", [*rows, ("/seen", START_NS, seen)]),
    ):
        bag = write_bag(folder / name, told)
        _write("ros2-recording", name, (bag / f"{name}.mcap").read_bytes())


def main() -> None:
    """Write all."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _wire()
        _ros2_wire()
        _conductor_files(folder)
        _stores(folder)
        _result_files(folder)
        _autodrive()
        _certificates()
        _assets(folder)
        _yaml()
        _roads()
        _scenarios(folder)
        _ros2(folder)


if __name__ == "__main__":
    main()
