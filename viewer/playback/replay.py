"""Opens recordings in the native viewer, or says how to open them on a laptop."""

from __future__ import annotations

import json
import re
import shlex
import sys

from rich.console import Console

from twin.base.cli import Output
from viewer.playback import native
from viewer.playback.catalogue import Catalogue, table
from viewer.playback.folder import FoundRecording, RecordedMoment
from viewer.playback.window import ViewerWindow, asked, window


def replay(found: FoundRecording, moment: RecordedMoment) -> None:
    """Show the recording, paused at ``moment``, until its window is closed."""
    if not native.has_display():
        print(f"no display here to show {found.path}; on a laptop with the same rerun-sdk:")
        for line in native.fetch_commands(found.path):
            print(f"  {line}")
        print(f"then go to {moment.label}")
        return
    print(f"{found.path}: {moment.label}; close the window to end")
    with window([str(found.path)]) as shown:
        shown.show(moment)
        shown.process.wait()


def print_catalogue(catalogue: Catalogue, output: Output) -> None:
    """The table, on standard output."""
    if output is Output.json:
        print(json.dumps(catalogue.as_json(), indent=1))
    else:
        # Lines of a file or a pipe need not fit into a terminal.
        Console(width=None if sys.stdout.isatty() else 180).print(table(catalogue))


def replay_all(catalogue: Catalogue) -> None:
    """Show the table of all recordings until the window is closed; a click opens a case."""
    if not native.has_display():
        folder = shlex.quote(str(catalogue.folder))
        print(f"no display here; `viewer web {folder}` serves them to a browser behind ssh")
        return
    print(f"{len(catalogue.rows)} recordings; close the window to end")
    with window([str(row.found.path) for row in catalogue.rows]) as shown:
        open_catalogue(shown, catalogue)
        shown.process.wait()


def open_catalogue(shown: ViewerWindow, catalogue: Catalogue) -> None:
    """Pause every recording at its moment, then show the table of them.

    The viewer reads files through a catalogue of its own, chunk by chunk as they are looked at, so
    hundreds of recordings cost little. Its table has our properties as columns.
    """
    state = shown.loaded(len(catalogue.rows))
    moments = {row.recording_id: row.moment for row in catalogue.rows}
    for recording in state.recordings:
        shown.pause(moments[recording.store_id.rpartition(":")[2]], recording.store_id)
    # Beside a case, what leads back to the table.
    asked(lambda: shown.client.run_command("ui.expand_blueprint_panel"))
    dataset = re.search(r"app_id=(\w+)", state.recordings[0].location)
    if dataset is not None and state.catalog_url:
        url = f"{state.catalog_url}/dataset/{dataset[1]}"
        asked(lambda: shown.client.open(url))
