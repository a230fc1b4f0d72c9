"""One of the processes that render a dataset: ``python -m twin.dataset.crew.child``."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import BinaryIO

from msgspec import Struct

from twin.base.errors import TwinError, UsageError, storage_error
from twin.base.process import bind_to_parent
from twin.dataset.crew.messages import (
    Begin,
    ChildReady,
    ChildWork,
    ImageWritten,
    Trouble,
    line_of,
    read_order,
)


def main() -> int:
    """Take tasks until standard input ends; the exit code."""
    bind_to_parent()
    # Whatever prints by mistake must not end up between the messages.
    out = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    try:
        _work(sys.stdin.buffer, out)
    except TwinError as error:
        _say(out, Trouble(str(error), isinstance(error, UsageError)))
        return error.exit_code
    except OSError as error:
        failure = storage_error(error, str(error.filename or "dataset"))
        _say(out, Trouble(str(failure), isinstance(failure, UsageError)))
        return failure.exit_code
    return 0


def _work(orders: BinaryIO, out: BinaryIO) -> None:
    begin = read_order(orders.readline())
    assert isinstance(begin, Begin), "the first line says what all is about"

    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    import cv2

    from twin.dataset.crew.renderer import Renderer
    from twin.dataset.folder import Folder

    cv2.setNumThreads(1)
    folder = Folder(Path(begin.folder))
    with folder.writing():
        renderer = Renderer(folder, begin.recipe, begin.slots, begin.device)
        _say(out, ChildReady())
        while line := orders.readline():
            order = read_order(line)
            assert isinstance(order, ChildWork), "after the first line there are tasks"
            for index in renderer.render(order.task):
                _say(out, ImageWritten(index))
            _say(out, ChildReady())


def _say(out: BinaryIO, message: Struct) -> None:
    out.write(line_of(message))


if __name__ == "__main__":
    sys.exit(main())
