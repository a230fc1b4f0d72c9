"""The conductor of a bench: what ``conductor serve`` runs, bound to the life of the bench."""

from __future__ import annotations

import twin.base.start  # noqa: F401 - as every command of ours begins

# isort: split
import sys
from pathlib import Path

from conductor.serve.command import serve_folder
from conductor.stored.link import StoreOptions
from twin.base.process import bind_to_parent, watch_lifeline

if __name__ == "__main__":
    bind_to_parent()
    watch_lifeline()
    folder, *store = sys.argv[1:]
    kept_in = StoreOptions(store[0], durable=store[1] == "store") if store else None
    sys.exit(serve_folder(Path(folder), "tcp/127.0.0.1:0", "bench", by_batch=False, store=kept_in))
