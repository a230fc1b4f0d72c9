"""Kinds are named in their tables and in their own folders: no branch on one anywhere else."""

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

from schemas.kinds.batch_system import batch_systems
from schemas.kinds.bridge import bridges
from schemas.kinds.perception import perception_kinds
from schemas.kinds.scenario import scenario_kinds
from schemas.kinds.sensor import sensor_kinds

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("schemas", "twin", "devkit", "conductor", "viewer", "hpc", "drivetwin")
TABLES = "schemas/kinds/"
"""Where every kind may be named."""

KINDS = (
    *(*batch_systems().declared, *bridges().declared, *scenario_kinds().declared),
    *(kind for kind in sensor_kinds().declared if kind.name != "pose"),
)
"""Declarations that are looked for; a table joins with its own. A pose is much besides a sensor."""

SIGHTS = perception_kinds().declared
"""Declarations of perception variants. Their folders are libraries of devkit's, open to others of
it, so only their names and types are looked for."""

SIGHTS_NAMED = {
    "ground_truth": (
        *("schemas/sections/perception.py", "schemas/sections/autonomy.py"),
        "conductor/bench/report_campaign.py",
    ),
    "network": (
        *("schemas/sections/perception.py", "conductor/report/autodrive/importing.py"),
        *("devkit/darknet/build.py", "devkit/darknet/variant.py"),
        *("twin/sandbox/view.py", "twin/worker/protection.py", "devkit/bridges/ros2/bridge.py"),
    ),
}
"""Files that join the types to one, say what a campaign has without any, or write a campaign file;
and the section of a Darknet file and the network of a host, which are called the same."""

HOMONYMS = {
    "encoders": (
        *("devkit/bridges/autodrive/fields.py", "schemas/messages.py"),
        "devkit/fusion/stack.py",
    ),
    "imu": (
        *("devkit/bridges/autodrive/fields.py", "schemas/messages.py"),
        "devkit/fusion/stack.py",
    ),
    "gnss": ("schemas/messages.py",),
    "radar": (
        *("devkit/fusion/sensing.py", "twin/bench/radar.py"),
        *("twin/validate/command.py", "twin/validate/radar_truth.py"),
        "twin/bench/trends/benches.py",
    ),
    "storyboard": (
        *("twin/scenario/storyboard/native/compiler.py", "twin/play/report.py"),
        *("twin/bench/storyboard_traffic.py", "viewer/playing/story.py"),
        *("schemas/files/played_scenario.py", "twin/bench/trends/benches.py"),
        "twin/drives/writing.py",
    ),
    "ros2": ("viewer/playback/ros2_file.py",),
    "autodrive": (
        *("schemas/sections/environment.py", "twin/world/sky/almanac.py"),
        *("twin/world/sky/weather.py", "devkit/reference/planning.py"),
        *("devkit/replaying/parity.py", "conductor/report/autodrive/importing.py"),
    ),
}
"""Files in which a bridge or a stack says where each reading goes, in which columns have their
public names, that measure how fast or how true a sensor is, that write a campaign file, or in which
the same word means something else: the outermost element of a scenario file, weather families,
rules of the planner, and the simulator of imported logs, which are called after AutoDRIVE, too."""


def home(kind) -> str:
    """Folder of a kind's implementation, from the root of the repository."""
    path = kind.implementation.partition(":")[0].replace(".", "/")
    return f"{path}/" if (ROOT / path).is_dir() else f"{path.rpartition('/')[0]}/"


@cache
def modules() -> dict[str, list[tuple[int, str]]]:
    """The texts of every module outside the tables."""
    paths = (path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
    names = {path.relative_to(ROOT).as_posix(): path for path in paths}
    return {
        name: list(texts(ast.parse(path.read_text(encoding="utf-8"))))
        for name, path in names.items()
        if not name.startswith(TABLES)
    }


def texts(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Texts and imported modules of a syntax tree, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, f"{alias.name}.") for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.lineno, f"{node.module}."
            yield from ((node.lineno, f"{node.module}.{alias.name}.") for alias in node.names)


def strays(found: Iterable[tuple[int, str]], name: str, folder: str) -> list[int]:
    """Lines that name the kind, or a module of its folder, or its own module beside the tables."""
    package = folder.replace("/", ".")
    declaration = re.compile(rf"schemas\.kinds\.\w+\.{name}[.:]")
    return sorted(
        {
            line
            for line, text in found
            if text == name or text.startswith(package) or declaration.match(text)
        }
    )


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_nothing_outside_its_folder_names_a_kind(kind):
    parts = [home(k) for k in KINDS if getattr(k, "part_of", "") == kind.name]
    strangers = [
        f"{path}:{line}"
        for path, found in modules().items()
        if not path.startswith((home(kind), *parts)) and path not in HOMONYMS.get(kind.name, ())
        for line in strays(found, kind.name, home(kind))
    ]
    assert not strangers, f"'{kind.name}' is named there; ask its declaration in {TABLES} instead"


@pytest.mark.parametrize("kind", SIGHTS, ids=lambda kind: kind.name)
def test_nothing_outside_devkit_names_a_perception_variant(kind):
    own = (f"{kind.implementation.partition(':')[0].replace('.', '/')}.py", "devkit/detector/")
    words = (kind.name, f".{kind.config.__name__}.", f"schemas.kinds.perceptions.{kind.name}.")
    strangers = {
        path
        for path, found in modules().items()
        if not path.startswith(own)
        if any(text == words[0] or text.endswith(words[1:]) for _, text in found)
    }
    assert strangers == set(SIGHTS_NAMED[kind.name])


def test_no_template_names_a_kind():
    paths = [p for name in PACKAGES for end in ("*.j2", "*.js") for p in (ROOT / name).rglob(end)]
    assert len(paths) > 5
    names = [kind.name for kind in (*KINDS, *SIGHTS) if kind.name not in HOMONYMS]
    found = {path.name: path.read_text(encoding="utf-8") for path in paths}
    assert [(path, n) for path, text in found.items() for n in names if f'"{n}"' in text] == []


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_kind_has_a_folder_of_its_own(kind):
    assert (ROOT / home(kind)).is_dir()
    assert [other.name for other in KINDS if home(other) == home(kind)] == [kind.name]


@pytest.mark.parametrize(
    "line",
    [
        'if system.name == "slurm": pass',
        'WORDS = {"slurm": 1}',
        "from hpc.slurm import commands",
        "from hpc import slurm",
        "import hpc.slurm.commands",
        'load("hpc.slurm.commands:Slurm")',
    ],
)
def test_a_stray_name_is_noticed(line):
    assert strays(texts(ast.parse(line)), "slurm", "hpc/slurm/") == [1]


@pytest.mark.parametrize(
    "line",
    [
        "from schemas.kinds.scenarios.jump_scare import JumpScareConfig",
        "from twin.scenario import jump_scare",
        'if case.scenario.type == "jump_scare": pass',
    ],
)
def test_a_family_is_noticed_and_so_are_its_types(line):
    assert strays(texts(ast.parse(line)), "jump_scare", "twin/scenario/jump_scare/") == [1]


def test_words_about_a_kind_are_no_branch():
    words = ast.parse('"""Of Slurm, or slurm, and hpc.slurmy."""')
    assert strays(texts(words), "slurm", "hpc/slurm/") == []


@pytest.mark.parametrize(("word", "path"), [(w, p) for w, ps in HOMONYMS.items() for p in ps])
def test_a_homonym_is_still_there(word, path):
    kind = next(kind for kind in KINDS if kind.name == word)
    assert strays(modules()[path], word, home(kind))
