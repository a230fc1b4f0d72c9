"""A kernel cache that cannot be written is replaced, and one line says so."""

import warp as wp

from twin.world.kernel_cache import prepare_kernels


def test_fallback(tmp_path, monkeypatch, capsys):
    prepare_kernels()
    assert capsys.readouterr().err == ""
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(blocked / "cache"))
    prepare_kernels()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "cannot be written" in lines[0]
    assert wp.config.kernel_cache_dir != str(blocked / "cache")
