"""What a worker says that cannot write recordings or run networks."""

import importlib.util

import pytest

from conductor.core.decisions import NAME_CHARS_MAX
from schemas.kinds.perception import lacking_perceptions
from schemas.sections.view_mode import RECORDER, ViewMode
from twin.base.errors import EXIT_USAGE, UsageError
from twin.worker.options import lacking_recorder

RECORDS = [ViewMode.record, ViewMode.record_live]
OTHERS = [ViewMode.none, ViewMode.live]


@pytest.fixture(params=["viewer", "rerun"])
def missing(request, monkeypatch):
    """The package that is not installed."""
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, package=None: None if name == request.param else find(name, package),
    )
    return request.param


@pytest.mark.parametrize("view", [None, *RECORDS, *OTHERS])
def test_with_all_packages_nothing_is_lacking(view):
    assert lacking_recorder(view) == {}


def test_a_campaign_may_ask_for_what_is_lacking(missing):
    (lack,) = lacking_recorder(None).values()
    assert list(lacking_recorder(None)) == [RECORDER]
    assert f"no package {missing}: pip " in lack
    assert "--view live" in lack
    assert len(lack) <= NAME_CHARS_MAX, "the conductor refuses longer words"


@pytest.mark.parametrize("view", OTHERS)
def test_who_is_told_not_to_record_lacks_nothing(missing, view):
    assert lacking_recorder(view) == {}


@pytest.mark.parametrize("view", RECORDS)
def test_who_is_told_to_record_is_refused_in_a_line(missing, view):
    with pytest.raises(UsageError, match=f"needs? the package {missing}, ") as refused:
        lacking_recorder(view)
    line = str(refused.value)
    assert line.startswith(f"--view {view.value}: ")
    assert "pip install" in line
    assert "\n" not in line
    assert refused.value.exit_code == EXIT_USAGE


def test_a_worker_without_opencv_says_that_it_runs_no_network(monkeypatch):
    assert lacking_perceptions() == {}
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "schemas.kinds.perception.find_spec", lambda name: None if name == "cv2" else find(name)
    )
    lack = "no package cv2: pip install 'drivetwin-worker[networks]'"
    assert lacking_perceptions() == {"perception network": lack}
    assert len(lack) <= NAME_CHARS_MAX
