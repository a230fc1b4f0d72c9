"""The conductor of a bench: what ``conductor serve`` runs, bound to the life of the bench."""

from __future__ import annotations

import sys
from pathlib import Path

from conductor.serve.command import serve_folder
from twin.base.process import bind_to_parent, watch_lifeline

if __name__ == "__main__":
    bind_to_parent()
    watch_lifeline()
    sys.exit(serve_folder(Path(sys.argv[1]), "tcp/127.0.0.1:0", "bench", by_batch=False))
