"""Commands that run a campaign, or a case of it, again, as reports and the console print them.

They are typed in the folder that holds the run's: what they write lies beside the run, which stays
as it was signed.
"""

from __future__ import annotations

import shlex
from pathlib import Path

CAMPAIGN_FILE = "campaign.yaml"


def run_name(folder: Path) -> str:
    """What a run's folder is called in the folder that holds it; no word of it is an option."""
    name = folder.resolve().name or "."
    return f"./{name}" if name.startswith("-") else name


def campaign_of(folder: Path) -> str:
    """The campaign file of a run, as it is called in the folder that holds the run's."""
    return f"{run_name(folder)}/{CAMPAIGN_FILE}"


def again_folder(word: str) -> str:
    """Where a repetition goes; ``word`` is the case, or the run's folder if all cases run."""
    return f"again-{word.removeprefix('./')}"


def repeat_command(
    campaign: str, word: str, *, case: str = "", record: bool = False, device: str = ""
) -> str:
    """The command that runs a campaign file again, quoted for a shell.

    Args:
        campaign: path of the file, from where the command is typed.
        word: what the folder of the repetition is named after.
        case: the only case that is run; empty: all of them.
        record: whether cameras and samples are recorded.
        device: the device that is asked for; empty: the one that the command chooses.
    """
    words = ["conductor", "run", campaign]
    words += ["--case", case] if case else []
    words += ["--view", "record"] if record else []
    words += ["--out", again_folder(word)]
    words += ["--device", device] if device else []
    return shlex.join(words)
