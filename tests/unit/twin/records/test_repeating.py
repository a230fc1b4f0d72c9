"""Commands that repeat a run are typed beside it, and mean what they say in a shell."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from twin.records.repeating import again_folder, campaign_of, repeat_command, run_name

NAMES = ("aeb-demo", "my run", "it's; rm -rf $HOME", "-o", "--out", "ärger", "a\nb")


@pytest.mark.parametrize("name", NAMES)
def test_a_shell_reads_the_words_that_were_meant(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    command = repeat_command(campaign_of(folder), run_name(folder), device="cuda:0")
    words = shlex.split(command)
    assert words[:2] == ["conductor", "run"]
    assert words[3:] == ["--out", f"again-{name}", "--device", "cuda:0"]
    assert not words[2].startswith("-")
    assert (tmp_path / words[2]).resolve() == folder / "campaign.yaml"
    # The repetition lies beside the run, never in it.
    assert (tmp_path / again_folder(run_name(folder))).parent == folder.parent


def test_a_case_is_named_and_recorded() -> None:
    command = repeat_command("r/campaign.yaml", "a b", case="a b", record=True)
    assert command == ("conductor run r/campaign.yaml --case 'a b' --view record --out 'again-a b'")


def test_a_folder_is_called_as_the_one_that_holds_it_calls_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run" / "inner").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "run")
    assert campaign_of(Path()) == "run/campaign.yaml"
    assert campaign_of(Path("inner/..")) == "run/campaign.yaml"
    monkeypatch.chdir(tmp_path)
    assert campaign_of(Path("run/")) == "run/campaign.yaml"
