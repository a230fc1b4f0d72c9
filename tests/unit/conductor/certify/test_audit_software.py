"""Certificates of other software are refused by name; what a campaign does not need may differ."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest
from certificates import campaign, decoded, made

import conductor.certify.software as here
from conductor.certify.audit import AuditOptions, audit, inspect
from conductor.certify.form import Certificate, encode_certificate
from conductor.certify.software import difference_from
from conductor.records.software_file import (
    FILE_NAME,
    SoftwareParts,
    read_software,
    write_software,
)
from schemas.digest import digest
from schemas.files.software import OPENCV, digest_of
from schemas.sections.stack_identity import StackIdentity
from twin.base.errors import InfrastructureError
from twin.base.software import library_versions, software_digest, software_files

FILES, LIBRARIES = software_files(), library_versions()
FLOAT = {"net": {"type": "network", "model": "yolov3-w25"}}


class RanError(Exception):
    """The audit got as far as running cases."""


def certificate(
    files: dict[str, str] | None = None,
    libraries: dict[str, str] | None = None,
    data: dict[str, Any] | None = None,
) -> Certificate:
    """A certificate that was made where these files and libraries were installed."""
    files = FILES if files is None else files
    libraries = LIBRARIES if libraries is None else libraries
    made_there = made(data, files=files, libraries=libraries, software=digest_of(files, libraries))
    return decoded(encode_certificate(made_there))


def portable(**changed: Any) -> dict[str, Any]:
    """A campaign of a stack that says that it is portable, as it was submitted."""
    identity = msgspec.to_builtins(StackIdentity(portable=True))
    return campaign(2, stack_identity=identity, **changed)


def refusal(certificate: Certificate) -> str:
    """The one line by which an audit refuses a certificate; empty: its cases are run."""

    def run_cases(_plan: object, _folder: Path) -> int:
        raise RanError

    options = AuditOptions(cases=1, seed="s")
    with pytest.raises((RanError, InfrastructureError)) as caught:
        audit(certificate, "c.cert", options, run_cases)
    if isinstance(caught.value, RanError):
        return ""
    assert caught.value.exit_code == 3
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """An audit without --out writes below the current folder."""
    monkeypatch.chdir(tmp_path)


def test_the_same_software_runs():
    assert refusal(certificate(data=portable())) == ""


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (FILES | {"twin/cli.py": "0" * 64}, "; twin/cli.py has another content here; install"),
        (FILES | {"twin/gone.py": "0" * 64}, "; twin/gone.py is not here; install"),
        (
            {name: sha for name, sha in FILES.items() if name != "devkit/aeb.py"},
            "; devkit/aeb.py is here and was not there; install",
        ),
        (
            FILES | {"devkit/new.py": "0" * 64, "twin/cli.py": "0" * 64},
            "; twin/cli.py has another content here (and 1 more); install",
        ),
    ],
)
def test_a_file_of_ours_that_differs_is_named(files, words):
    line = refusal(certificate(files, data=portable()))
    assert words in line
    assert line.startswith("c.cert: made with software ")
    assert "`conductor audit c.cert --lock` prints" in line


def test_a_library_that_every_campaign_needs_is_named():
    line = refusal(certificate(libraries=LIBRARIES | {"numpy": "1.0"}, data=portable()))
    assert f"; numpy 1.0: here {LIBRARIES['numpy']}; install" in line
    line = refusal(certificate(libraries=LIBRARIES | {"warp-lang": "0.1"}, data=portable()))
    assert "; warp-lang 0.1: here " in line


GPU = {"onnxruntime-gpu": "1.31.1", "nvidia-cudnn-cu13": "9.1", "nvidia-cublas": "13.0"}
BARE = {
    name: version
    for name, version in LIBRARIES.items()
    if name not in ("onnxruntime", "dracopy", "meshopt", "opengl-basisu")
}


@pytest.mark.parametrize("libraries", [BARE, BARE | GPU, BARE | {"dracopy": "0.1"}])
def test_a_portable_table_of_a_gpu_machine_runs_on_a_laptop(libraries):
    assert libraries != LIBRARIES
    there = certificate(libraries=libraries, data=portable())
    assert there.head.software != software_digest()
    assert refusal(there) == ""
    assert inspect(there, "c.cert").startswith("as it was signed, and its rows are those")


def test_opencv_counts_for_networks_of_floats_alone():
    other = LIBRARIES | {OPENCV: "5.0.1.2"}
    assert refusal(certificate(libraries=other, data=portable())) == ""
    data = portable(autonomy={"perception": FLOAT})
    data["matrix"] |= {"model": ["net"]}
    line = refusal(certificate(libraries=other, data=data))
    assert f"; {OPENCV} 5.0.1.2: here {LIBRARIES[OPENCV]}; install" in line


def test_a_certificate_of_before_is_read_by_the_digest_of_before():
    """While OpenCV's version was part of it."""
    parts = [f"{path}={sha}" for path, sha in sorted(FILES.items())]
    parts += [f"{name}=={version}" for name, version in sorted(LIBRARIES.items())]
    then = digest(part.encode() for part in parts)
    assert then != software_digest()
    there = made(portable(), files=FILES, libraries=LIBRARIES, software=then)
    assert refusal(decoded(encode_certificate(there))) == ""


def test_a_table_of_float_networks_needs_the_same_runtime():
    data = portable(autonomy={"perception": FLOAT})
    data["matrix"] |= {"model": ["net"]}
    assert refusal(certificate(data=data)) == ""
    there = certificate(libraries=BARE | GPU, data=data)
    line = refusal(there)
    assert "; nvidia-cublas 13.0: " in line
    assert "dracopy" not in line


def test_a_runtime_that_is_here_alone_is_named(monkeypatch):
    data = portable(autonomy={"perception": FLOAT})
    data["matrix"] |= {"model": ["net"]}
    there = certificate(libraries=LIBRARIES, data=data)
    more = LIBRARIES | {"onnxruntime-gpu": "1.31.1"}
    monkeypatch.setattr(here, "library_versions", lambda: more)
    assert "; onnxruntime-gpu 1.31.1: was not installed there; install" in refusal(there)


def test_a_scene_of_somebody_needs_the_same_decoders(tmp_path):
    scene = tmp_path / "mine.yaml"
    data = portable(scenario={"scene": str(scene)}, files={str(scene): "0" * 64})
    there = certificate(libraries=LIBRARIES | {"dracopy": "0.1"}, data=data)
    assert "; dracopy 0.1: " in refusal(there)


def test_a_certificate_that_lists_no_files_is_refused_as_a_whole():
    line = refusal(made(portable(), software="1" * 64))
    assert line.startswith("c.cert: made with software 111111111111, this is ")


def test_a_certificate_of_other_software_is_looked_at_no_further():
    assert inspect(made(portable(), software="1" * 64), "c.cert").startswith("as it was signed; o")
    files = FILES | {"twin/cli.py": "0" * 64}
    assert inspect(certificate(files), "c.cert").startswith("as it was signed; other software")


def test_files_that_are_not_those_of_the_signed_digest():
    true = certificate(data=portable())
    for files in (FILES | {"twin/cli.py": "0" * 64}, {}):
        with pytest.raises(InfrastructureError, match="not those of the software that was signed"):
            decoded(encode_certificate(msgspec.structs.replace(true, files=files)))
    for name in ("../twin/cli.py\n", "", "twin/\u202ecli.py", "a" * 301):
        data = json.loads(encode_certificate(true))
        data["files"] = {name: "0" * 64}
        with pytest.raises(InfrastructureError, match="its files"):
            decoded(json.dumps(data, separators=(",", ":")).encode() + b"\n")


def test_names_of_a_certificate_are_escaped(monkeypatch):
    lines = here.library_lines({"a\x1b[31m": "\x1b[2J"}, {})
    assert "\x1b" not in lines[0]


def test_a_run_says_what_it_was_made_with(tmp_path):
    write_software(tmp_path, "0" * 64)
    assert not (tmp_path / FILE_NAME).exists(), "other software ran it"
    write_software(tmp_path, software_digest())
    parts = read_software(tmp_path, software_digest())
    assert parts == SoftwareParts(FILES, LIBRARIES)
    assert difference_from(parts) == ""
    assert read_software(tmp_path, "0" * 64) is None


def test_a_run_of_other_software_names_library_and_file():
    old = SoftwareParts(FILES | {"twin/cli.py": "0" * 64}, LIBRARIES | {"numpy": "1.0"})
    assert difference_from(old) == f"; numpy 1.0: here {LIBRARIES['numpy']} (and 1 more)"
    old = SoftwareParts(FILES | {"twin/cli.py": "0" * 64}, LIBRARIES)
    assert difference_from(old) == "; twin/cli.py has another content here"
    assert difference_from(None) == ""


@pytest.mark.parametrize("damage", [b"", b"[]", b'{"files":{},"libraries":{}}', b"\xff"])
def test_a_damaged_record_says_nothing(tmp_path, damage):
    write_software(tmp_path, software_digest())
    (tmp_path / FILE_NAME).write_bytes(damage)
    assert read_software(tmp_path, software_digest()) is None
