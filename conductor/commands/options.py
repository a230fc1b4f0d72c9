"""Options of ``conductor run``, ``serve``, ``submit`` and ``validate``, declared once."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from schemas.sections.view_mode import ViewMode
from twin.base.cli import duration

Source = Annotated[str, typer.Argument(help="Shipped campaign or path of a campaign file.")]
Listen = Annotated[
    str,
    typer.Option(
        help="Where to listen; port 0 takes a free one. Beyond loopback (e.g. 0.0.0.0:0) it is "
        "TLS, with the keys that --key names or keys/ in the state folder, made if missing."
    ),
]


class OnOff(StrEnum):
    """A switch."""

    on = "on"
    off = "off"


class FilmsOf(StrEnum):
    """Cases that a report makes films of."""

    failures = "failures"


class Durable(StrEnum):
    """What a reply of a conductor waits for."""

    local = "local"
    store = "store"


Reported = Annotated[
    str | None,
    typer.Argument(
        metavar="FOLDER|STORE",
        help="Campaign folder, e.g. runs/aeb-demo, or a result store, e.g. s3://bucket/prefix; of "
        "a store, only what is needed is read.",
    ),
]
Store = Annotated[
    str,
    typer.Option(
        metavar="URL",
        help="Keep results and journal there, too: a folder, s3://bucket/prefix or another URL of "
        "fsspec. With an empty --state folder, what the last conductor left there is taken over.",
    ),
]
DurableIn = Annotated[
    Durable,
    typer.Option(
        "--durable",
        help="What replies wait for: local, this disk; store, also the store of --store.",
    ),
]
View = Annotated[
    ViewMode | None,
    typer.Option(
        help="live: `viewer live` may look; record: an .rrd per case; default: as the campaign's "
        "`view` says, which is live."
    ),
]
ByBatch = Annotated[
    bool, typer.Option("--by-batch", help="Run the campaign's batches one after the other.")
]
History = Annotated[
    Path | None,
    typer.Option(
        metavar="RUN",
        help="Folder of an earlier run of such a campaign: its longest cases begin first.",
    ),
]
RunFolder = Annotated[
    Path | None, typer.Option(help="Campaign folder; default runs/CAMPAIGN. Run again: resume.")
]
Workers = Annotated[
    str | None,
    typer.Option(
        help="Local workers; default: one per core, at most 8; with clock realtime or scripts at a "
        "port one. cuda: one on every GPU, 4xcuda: four on every GPU, each with cores of its own; "
        "without a GPU, the default."
    ),
]
Slots = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=4096,
        help="Cases together per worker; default: 2 if each worker has four cases or more, else 1; "
        "with --workers cuda what fits, at most 256.",
    ),
]
Device = Annotated[str, typer.Option(help="cpu or cuda:N; --workers cuda chooses by itself.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Replaces the campaign's seed.")]
OneCase = Annotated[str, typer.Option(help="Only this case; choose another --out for it.")]
FirstCases = Annotated[
    int | None, typer.Option(min=1, help="Only so many, the first; choose another --out.")
]
Rows = Annotated[
    str,
    typer.Option(
        help="Only these rows of its rulebook: names of rows, groups or tests, or tags of groups, "
        "with commas between; choose another --out for them."
    ),
]
Quick = Annotated[
    bool,
    typer.Option(
        "--quick",
        help="Only the first and the last point of each row of its rulebook, once each: the "
        "easiest and the hardest; choose another --out for them.",
    ),
]
Weather = Annotated[
    str,
    typer.Option(
        help="Each case in all of these weathers, with commas between, or `all`; in place of the "
        "campaign's; choose another --out for them."
    ),
]
Axes = Annotated[
    list[str] | None,
    typer.Option(
        "--axis",
        metavar="NAME=V1,V2",
        help="These values of an axis of the matrix, in place of the campaign's; repeatable; "
        "choose another --out for them.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="A key of the campaign by its path, in place of the file's, e.g. camera.width=320; "
        "repeatable; choose another --out for it.",
    ),
]
RecordDrive = Annotated[
    bool,
    typer.Option(
        "--record-drive",
        help="Record what the stack sees and answers, without loss, for `devkit replay`.",
    ),
]
Render = Annotated[
    OnOff | None,
    typer.Option(help="off: no camera sees anything; default: as the campaign says, on."),
]
MemoryGb = Annotated[
    float | None,
    typer.Option(min=0.1, max=1e6, help="Most memory of a rig; one that needs more is ended [GB]."),
]
StateFolder = Annotated[
    Path | None,
    typer.Option(
        help="State folder; one conductor each; default runs, with --campaign runs/CAMPAIGN, "
        "which is then the campaign's folder."
    ),
]
CampaignToServe = Annotated[
    str, typer.Option(help="Submit this campaign: a shipped one, or the path of a file.")
]
UntilDone = Annotated[
    bool,
    typer.Option(
        "--until-done",
        help="End when every case of --campaign has ended, with its report and its exit code.",
    ),
]
TimeToLive = Annotated[
    float, duration("A silent worker's cases are given to others [s].", least=0.5, most=3600)
]
Metrics = Annotated[str, typer.Option(help="Serve Prometheus metrics, e.g. at 127.0.0.1:9100.")]
AllowUnprotected = Annotated[
    bool,
    typer.Option(
        "--allow-unprotected",
        help="Beyond loopback: also accept campaigns and workers whose stacks have no sandbox.",
    ),
]
