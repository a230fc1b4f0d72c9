"""The software digest: which files and versions are part of it."""

import importlib.metadata
import importlib.util
import os
import socket
from types import SimpleNamespace

import pytest

from schemas.files.software import OPENCV, OPENCV_USUAL
from twin.base import software


def test_files_that_decide_a_result_are_part_of_it(monkeypatch, tmp_path):
    monkeypatch.setattr(software, "package_folder", lambda package: tmp_path / package)
    (tmp_path / "devkit" / "models").mkdir(parents=True)
    found = {software.software_digest()}
    for name in (
        "stack.py",
        "downtown.yaml",
        "yolov3.cfg",
        "coco.names",
        "models/a.onnx",
        "b.integer",
    ):
        (tmp_path / "devkit" / name).write_bytes(b"1")
        found.add(software.software_digest())
        (tmp_path / "devkit" / name).write_bytes(b"2")
        found.add(software.software_digest())
    assert len(found) == 13
    (tmp_path / "devkit" / "models" / "a.md").write_text("a model card")
    assert software.software_digest() in found


def test_libraries_of_a_gpu_count_where_something_computes_with_them(monkeypatch, tmp_path):
    monkeypatch.setattr(software, "package_folder", lambda package: tmp_path)
    versions = {"numpy": "2.4.0", "nvidia-cudnn-cu13": "9.1"}
    monkeypatch.setattr(software, "version_of", lambda name: versions.get(name, ""))

    def other_cudnn() -> bool:
        before = software.software_digest()
        versions["nvidia-cudnn-cu13"] += ".1"
        return software.software_digest() != before

    assert not other_cudnn()
    versions["onnxruntime-gpu"] = "1.31.1"
    assert other_cudnn()


def test_versions_are_those_that_are_installed(monkeypatch, tmp_path):
    versions = software.library_versions()
    installed = {name: version for name, version in versions.items() if name != "python"}
    assert {"numpy", "warp-lang"} <= set(installed)
    assert installed == {name: importlib.metadata.version(name) for name in installed}
    about = tmp_path / "pillow-1.5.dist-info"
    about.mkdir()
    head = "Metadata-Version: 2.1\nName: pillow\nVersion: 1.5\n\n"
    (about / "METADATA").write_text(f"{head}What its page says.\nVersion: 9\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert software.library_versions() == versions | {"pillow": "1.5"}


@pytest.mark.parametrize(
    ("first_s", "then_s", "seen"), [(0, 0, True), (1, 1, True), (1, 60, True), (60, 61, False)]
)
def test_a_file_that_may_change_and_keep_its_time_is_read_again(
    monkeypatch, tmp_path, first_s, then_s, seen
):
    """Some file systems count seconds, older kernels hundredths. What has been as it is for a
    minute is read once."""
    monkeypatch.setattr(software, "package_folder", lambda package: tmp_path)
    path, changed_ns = tmp_path / "stack.py", 10**18
    plain = os.fstat

    def coarse(descriptor: int) -> SimpleNamespace:
        status = plain(descriptor)
        names = ("st_mode", "st_size", "st_ino", "st_dev")
        same = {name: getattr(status, name) for name in names}
        return SimpleNamespace(**same, st_mtime_ns=changed_ns, st_ctime_ns=changed_ns)

    def files_at(age_s: int) -> dict[str, str]:
        clock = SimpleNamespace(time_ns=lambda: changed_ns + age_s * 10**9)
        with monkeypatch.context() as patched:
            patched.setattr(software, "time", clock)
            patched.setattr(os, "fstat", coarse)
            return software.software_files()

    path.write_bytes(b"1")
    before = files_at(first_s)
    path.write_bytes(b"2")
    assert (files_at(then_s) != before) == seen


def test_what_is_no_file_does_not_count(monkeypatch, tmp_path):
    monkeypatch.setattr(software, "package_folder", lambda package: tmp_path)
    (tmp_path / "stack.py").write_bytes(b"1")
    before = software.software_files()
    (tmp_path / "folder.py").mkdir()
    (tmp_path / "nowhere.py").symlink_to("nothing.py")
    (tmp_path / "itself.py").symlink_to("itself.py")
    os.mkfifo(tmp_path / "pipe.py")
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket.py")
        assert software.software_files() == before
    (tmp_path / "link.py").symlink_to("stack.py")
    assert len(software.software_files()) == len(before) + 3


@pytest.mark.parametrize(
    ("installed", "named"),
    [
        (None, ""),
        (f'opencv_version = "{OPENCV_USUAL}"\ncontrib = False\n', ""),
        ('opencv_version = "5.0.1.2"\nheadless = False\n', "~opencv-5.0.1.2"),
        ('opencv_version = "4.6 of \x1b[1m somebody"\n', "~opencv-unknown"),
        ("", "~opencv-unknown"),
    ],
    ids=["none", "usual", "other", "odd", "silent"],
)
@pytest.mark.parametrize("distribution", [OPENCV, "opencv-python"])
def test_opencv_is_part_of_the_device_class_alone(
    monkeypatch, tmp_path, installed, named, distribution
):
    """What Python imports counts: a distribution of another name brings the same package."""
    plain, digest = software.hardware_class("cpu"), software.software_digest()
    find, version_of = importlib.util.find_spec, software.version_of

    def spec(name: str) -> object:
        if name != "cv2":
            return find(name)
        folders = [str(tmp_path / "nothing"), str(tmp_path)]
        return None if installed is None else SimpleNamespace(submodule_search_locations=folders)

    def installed_version(name: str) -> str:
        if name != OPENCV:
            return version_of(name)
        return "5.0.7.7" if name == distribution else ""

    if installed:
        (tmp_path / "version.py").write_text(installed)
    monkeypatch.setattr(importlib.util, "find_spec", spec)
    monkeypatch.setattr(software, "version_of", installed_version)
    assert software.device_class("cpu") == plain + named
    assert software.hardware_class("cpu") == plain
    assert software.software_digest() == digest
    named_library = "5.0.7.7" if distribution == OPENCV else ""
    assert software.library_versions().get(OPENCV, "") == named_library


def test_the_opencv_that_is_here_says_its_version():
    metadata = importlib.metadata.version(OPENCV)
    assert software.opencv_version() == metadata
