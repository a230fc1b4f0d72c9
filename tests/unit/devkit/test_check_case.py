"""What ``devkit check`` takes its argument for."""

import pytest

from devkit.check import case_of
from twin.fabric.errors import UsageError


def test_a_command_line_may_end_with_a_file_of_its_own():
    case = case_of("/opt/run --config mine.yaml", {"gap_m": 8})
    assert case.foreign.command == ["/opt/run", "--config", "mine.yaml"]
    assert case_of("a.b:C", {}).stack == "a.b:C"
    with pytest.raises(UsageError, match=r"mine\.yaml"):
        case_of("mine.yaml", {})
