"""An S3 server of a fabric's host, behind a wire that breaks: `broken_store.py ADDRESS FILE LOG`.

FILE says what breaks, as JSON: share of the requests by the name of the fault, and `down`. It is
read anew for each request, so a fault begins and ends with its being replaced.
"""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

from object_store import Wire, s3_server

PORT = 7449


def main(address: str, file: Path, log: Path) -> None:
    """Serve until killed."""
    with s3_server(log) as port:
        wire = Wire(port, address=address, port=PORT)

        def look(method: str, path: str) -> None:
            wanted = json.loads(file.read_text())
            wire.down = wanted.pop("down", False)
            wire.faults = wanted

        wire.first = look
        threading.Event().wait()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
