"""The repository of a stack: fetched and built where there is a network, and pinned to its commit.

That is the business of ``hpc``, which is asked as any user would ask it: by a process of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys

import msgspec

from schemas.campaign import Campaign
from schemas.validation import Mistake
from twin.fabric.cache import cache_folder
from twin.fabric.errors import UsageError


def with_repository(campaign: Campaign, shown: str) -> Campaign:
    """The campaign with the commit in place of a branch or tag; the files are in the cache.

    Raises:
        UsageError: no such repository or ref, or its set-up failed, with its last lines.
    """
    repository = campaign.autonomy.repository
    if repository is None:
        return campaign
    words = [sys.executable, "-m", "hpc", "fetch", "repository"]
    words += ["--ref", repository.ref, "--setup", repository.setup, "--output", "json"]
    words += ["--cache", str(cache_folder()), "--", repository.url]
    done = subprocess.run(words, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode:
        said = done.stderr.strip().removeprefix("hpc: ") or f"exit code {done.returncode}"
        raise UsageError(Mistake("autonomy.repository", said).line(shown))
    pinned = msgspec.structs.replace(repository, ref=str(json.loads(done.stdout)["commit"]))
    autonomy = msgspec.structs.replace(campaign.autonomy, repository=pinned)
    return msgspec.structs.replace(campaign, autonomy=autonomy)
