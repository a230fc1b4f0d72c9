"""What ``devkit check`` takes its argument for."""

import json
from pathlib import Path

import pytest

from devkit.checking.check import plan_of
from twin.base.errors import UsageError


def test_a_command_line_may_end_with_a_file_of_its_own():
    found = plan_of("/opt/run --config mine.yaml", {"gap_m": 8}).campaign
    assert found.autonomy.command == ["/opt/run", "--config", "mine.yaml"]
    assert plan_of("a.b:C", {}).campaign.autonomy.stack == "a.b:C"
    with pytest.raises(UsageError, match=r"mine\.yaml"):
        plan_of("mine.yaml", {})


def test_models_lie_beside_the_campaign_file(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    variants = {"mine": {"type": "network", "model": "nets/mine.onnx"}}
    data = {"campaign": "c", "autonomy": {"perception": variants}, "matrix": {"repeat": [0]}}
    (tmp_path / "c.yaml").write_text(json.dumps(data))  # JSON is YAML
    found = plan_of("../c.yaml", {}).campaign
    model = Path(found.autonomy.perception["mine"].model)
    assert model.resolve() == tmp_path / "nets/mine.onnx"
    assert model.is_absolute()
