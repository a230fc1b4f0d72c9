"""What ``devkit check`` takes its argument for."""

import pytest

from devkit.check import campaign_of
from twin.fabric.errors import UsageError


def test_a_command_line_may_end_with_a_file_of_its_own():
    found = campaign_of("/opt/run --config mine.yaml", {"gap_m": 8})
    assert found.autonomy.command == ["/opt/run", "--config", "mine.yaml"]
    assert campaign_of("a.b:C", {}).autonomy.stack == "a.b:C"
    with pytest.raises(UsageError, match=r"mine\.yaml"):
        campaign_of("mine.yaml", {})
