"""``--weather``: the cases of a campaign in other weathers than its file says."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import yaml
from rulebooks import BRAKING, CROSSING, rulebook_data

from conductor.run.source import load
from schemas.campaign import WEATHERS
from twin.base.errors import UsageError


def loaded(folder: Path, weather: str, data: dict[str, Any]) -> Any:
    path = folder / "campaign.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return load(str(path), weather=weather)


def test_all_rows_are_run_in_all_weathers(tmp_path: Path) -> None:
    data = rulebook_data(BRAKING)
    plain = loaded(tmp_path, "", data).cases
    cases = loaded(tmp_path, "all", data).cases
    weathers = Counter(case.variation.weather for case in cases)
    assert weathers == dict.fromkeys(WEATHERS, len(plain))
    clear = [case for case in cases if case.variation.weather == "clear"]
    assert [case.variation.scenario.trial.speed_kmh for case in clear] == [
        case.variation.scenario.trial.speed_kmh for case in plain
    ]


def test_named_weathers_stand_in_place_of_those_of_the_matrix(tmp_path: Path) -> None:
    data = rulebook_data(BRAKING, matrix={"weather": ["clear"], "time_of_day": ["12:00"]})
    cases = loaded(tmp_path, "heavy_snow, cloudy", data).cases
    assert {case.variation.weather for case in cases} == {"heavy_snow", "cloudy"}
    assert len(cases) == 18
    assert all(case.variation.time_of_day_min == 720 for case in cases)


@pytest.mark.parametrize(
    ("weather", "changes", "words"),
    [
        ("sunny", {}, r"--weather: no weather 'sunny'; allowed: all, clear, "),
        ("heavy_rian", {}, r"--weather: no weather 'heavy_rian'; did you mean 'heavy_rain'\?"),
        ("clear,clear", {}, "--weather: 'clear' is named twice; name each once"),
        ("clear,", {}, "--weather: no weather ''; allowed: "),
        (
            "all",
            {"cases": [{"row": "braking", "repeat": 0}]},
            "--weather: .*campaign.yaml lists its cases; give them a weather there",
        ),
    ],
)
def test_what_cannot_be_done_is_told_in_one_line(
    tmp_path: Path, weather: str, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=rf"^{words}[^\n]*$"):
        loaded(tmp_path, weather, rulebook_data(BRAKING, **changes))


def test_a_row_with_a_weather_of_its_own_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as refused:
        loaded(tmp_path, "all", rulebook_data(BRAKING, CROSSING))
    assert "--weather: row 'crossing' of the rulebook sets it, too" in str(refused.value)
