"""Opens a recording in the native viewer, or says how to open it on a laptop."""

from __future__ import annotations

from viewer import native
from viewer.folder import Found, Moment
from viewer.window import window


def replay(found: Found, moment: Moment) -> None:
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
