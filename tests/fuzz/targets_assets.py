"""Networks, meshes and heightmaps: formats of others, read by libraries."""

from __future__ import annotations

import os
import time
from functools import cache
from pathlib import Path

from fuzz_target import Target, of_file

from devkit.darknet.build import build_network, read_network
from devkit.darknet.importer import _labels
from devkit.darknet.network import DarknetNetwork
from devkit.darknet.sections import parse_sections
from devkit.darknet.weights import read_weights
from devkit.detector.description import read_description
from devkit.detector.detector import Detector
from devkit.replaying.parity import Parity, judge
from schemas.files.assets import mesh_files
from twin.base.errors import UsageError
from twin.base.picture_file import read_picture
from twin.world.apart.checks import AnswerError, unpack
from twin.world.apart.frames import FrameReader
from twin.world.meshes.apart import MESH_DATA
from twin.world.meshes.mesh_file import load_mesh
from twin.world.meshes.terrain import read_samples

CFG = """[net]
width=32
height=32
channels=3
[convolutional]
filters=7
size=1
stride=1
activation=linear
[yolo]
anchors=8,8
classes=2
num=1
"""


@cache
def small_network() -> DarknetNetwork:
    """To which weights must fit."""
    return build_network(parse_sections(CFG, "n.cfg"), "n.cfg")


def _mesh(path: Path) -> object:
    mesh_files(path)
    return load_mesh(path)


def _score_table(data: bytes) -> None:
    judge("log.csv", data.decode("utf-8", "replace"), Parity())


def _mesh_answer(data: bytes) -> object:
    """What a parser's process answers of a mesh."""
    memory = os.memfd_create("answer")
    try:
        os.pwrite(memory, data, 0)
        head, arrays = FrameReader(memory, time.monotonic() + 60.0, 16 << 20).frame()
    except EOFError:
        raise AnswerError("cut off") from None
    finally:
        os.close(memory)
    return head.error or unpack(head.tree, MESH_DATA, arrays)


MESH = (ValueError,)
TARGETS = {
    "onnx": Target(of_file("m.onnx", Detector), (UsageError,), cost=15),
    "integer-network": Target(of_file("n.integer", Detector), (UsageError,), cost=15),
    "detector-description": Target(of_file("d.json", read_description), (UsageError,)),
    "darknet-cfg": Target(of_file("n.cfg", read_network), (UsageError,), cost=3),
    "darknet-weights": Target(
        of_file("n.weights", lambda path: read_weights(path, small_network())),
        (UsageError,),
        cost=5,
    ),
    "darknet-names": Target(
        of_file("n.names", lambda path: _labels(small_network(), path)), (UsageError,)
    ),
    "parity-table": Target(_score_table, ()),
    **{
        f"mesh-{kind}": Target(of_file(f"m.{kind}", _mesh), MESH, cost=10)
        for kind in ("obj", "ply", "stl", "gltf", "glb")
    },
    "mesh-answer": Target(_mesh_answer, (AnswerError,)),
    "heights-npy": Target(of_file("h.npy", read_samples), MESH),
    "heights-png": Target(of_file("h.png", read_samples), MESH),
    "picture": Target(of_file("p.png", read_picture), (UsageError,), cost=2),
}
