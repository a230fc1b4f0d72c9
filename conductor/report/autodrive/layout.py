"""What stands beside the AutoDRIVE study's logs: their configuration, and where an import came
from.

Case n of the configuration, from 0, is instance ``n % size + 1`` of batch ``n // size + 1``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from schemas.files.autodrive_log import CONFIG_FILE, LOG_BYTES_MAX
from schemas.files.json_text import JsonError, decode_json
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.names import WEATHERS
from schemas.sections.scenario import Scenario
from twin.base.errors import InfrastructureError, UsageError, storage_error

IMPORT_FILE = "imported.json"
"""File in a campaign folder that was made from logs: where they came from, and what was left
out."""

BATCH_SIZE = 32
"""Instances of a batch in the study."""
LOG_S_MIN = 120.0
"""The study's script writes its log until the job's wall time of three minutes is up: the published
logs last 155 to 172 s. One that is shorter than this was cut off [s]."""
STEERING_MAX_RAD = 0.62
"""Road-wheel angle at a steering command of 1, as of the vehicle ``opencav`` [rad]."""
PICTURE_PX = (640, 360)
"""Image in which the study's script measures the size of a box [px]."""


EndedOutcome = Literal["verdict", "failed", "unresolved", "cancelled"]


class ExportedEnd(msgspec.Struct, frozen=True):
    """How the case of an exported log ended. An import believes it as long as the log has the bytes
    that were exported, because a log does not hold everything that a verdict is made of."""

    outcome: EndedOutcome
    verdict: Annotated[str, Meta(max_length=10_000)] = ""
    reasons: Annotated[list[Annotated[str, Meta(max_length=10_000)]], Meta(max_length=1000)] = []
    log_sha256: str = ""
    """SHA-256 of the log's bytes; empty: the case has no log."""


class Instance(msgspec.Struct, frozen=True, omit_defaults=True):
    """One case of the configuration."""

    time_of_day: Annotated[int, Meta(ge=0, lt=1440)]
    """Minutes after midnight."""
    weather_id: Annotated[int, Meta(ge=1, le=len(WEATHERS))]
    """1 clear to 8 heavy snow, the order of :data:`schemas.names.WEATHERS`."""
    model: Annotated[str, Meta(min_length=1, max_length=200)]
    """Perception model."""
    exported: ExportedEnd | None = None
    """End of the case, written by an export."""

    @property
    def weather(self) -> str:
        """Name of its weather here."""
        return WEATHERS[self.weather_id - 1]


class StudyConfig(msgspec.Struct, frozen=True, omit_defaults=True):
    """Content of ``config.json``; the study's script ignores further keys."""

    simulation_instances: Annotated[list[Instance], Meta(min_length=1, max_length=100_000)]
    batch_size: Annotated[int, Meta(ge=1)] = BATCH_SIZE
    """Size of a batch, written by an export whose batches have another size than the study's."""
    campaign: Annotated[str, Meta(max_length=200)] = ""
    """Name of the campaign; written by an export. Empty: the folder's name."""
    log_s_min: Annotated[float, Meta(ge=0, le=86_400)] = LOG_S_MIN
    """A log without a collision that is shorter was cut off [s]."""
    false_braking_m: Annotated[float, Meta(gt=0, le=1000)] = Scenario().false_braking_m
    """Coming to rest further than this from the obstacle is false braking [m]."""


class ImportNote(msgspec.Struct, frozen=True):
    """Content of :data:`IMPORT_FILE`."""

    source: str
    """Name of the folder of logs."""
    sha256: str
    """SHA-256 over names and bytes of the configuration and every log that was read."""
    files: int
    """Logs that were read."""
    rows: int
    """Rows that became KPI rows."""
    left_out: list[str]
    """What could not be read: file, line and reason."""
    absent_batches: list[int]
    """Batches of the configuration of which there is no log; their cases are no part of it."""
    sources: dict[str, str]
    """Case -> its log; cases whose log is missing have none."""
    batches: dict[str, int]
    """Case -> its batch."""
    without_aeb: list[str]
    """Cases whose log does not say in any row whether AEB was active."""
    warnings: list[str] = []
    """What makes the logs doubtful, a line each."""
    log_s_min: float = LOG_S_MIN
    """Duration below which a log without a collision was cut off, as of the configuration [s]."""
    no_collision: list[str] = []
    """Unresolved cases whose complete log tells of no collision: free of one by the study's rule,
    though nobody knows how they would have ended."""


def read_config(folder: Path) -> tuple[StudyConfig, bytes]:
    """The configuration in ``folder``, and its bytes.

    Raises:
        UsageError: there is none, or it is none.
    """
    path = folder / CONFIG_FILE
    try:
        if path.exists() and not path.is_file():
            raise UsageError(f"{path}: not a file")
        with path.open("rb") as file:
            data = file.read(LOG_BYTES_MAX + 1)
    except OSError as error:
        raise UsageError(
            f"{path}: {error.strerror or error}; give the folder that holds {CONFIG_FILE} and "
            "batch_1, batch_2, ... of the AutoDRIVE study"
        ) from None
    if len(data) > LOG_BYTES_MAX:
        raise UsageError(f"{path}: larger than {LOG_BYTES_MAX} bytes, no configuration")
    try:
        return decode_json(data, StudyConfig), data
    except JsonError as error:
        raise UsageError(f"{path}: no configuration of the AutoDRIVE study: {error}") from None


def read_imported(folder: Path) -> ImportNote | None:
    """Where the campaign in ``folder`` was imported from; None: it was run.

    Raises:
        InfrastructureError: the file is damaged.
    """
    path = folder / IMPORT_FILE
    try:
        return decode_json(read_regular(path, RUN_FILE_BYTES_MAX), ImportNote)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise storage_error(error, str(path)) from None
    except JsonError as error:
        raise InfrastructureError(f"{path}: damaged: {error}") from None
