"""The software digest: which files and versions are part of it."""

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
    monkeypatch.setattr(software, "_version", lambda name: versions.get(name, ""))

    def other_cudnn() -> bool:
        before = software.software_digest()
        versions["nvidia-cudnn-cu13"] += ".1"
        return software.software_digest() != before

    assert not other_cudnn()
    versions["onnxruntime-gpu"] = "1.31.1"
    assert other_cudnn()
