"""The training itself: epoch by epoch, from where it was left, until it is done or interrupted."""

from __future__ import annotations

import contextlib
import math
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from devkit.detector.evaluate import Evaluation
from devkit.training.augment import plan_epoch
from devkit.training.examples import Examples
from devkit.training.folder import LOG, TrainingFolder
from devkit.training.loss import PARTS
from devkit.training.parameters import TrainingParameters
from devkit.training.steps import Trainer, learning_rate
from twin.base.errors import UnfinishedError, UsageError
from twin.base.progress import ProgressReport

CHECKPOINT_S = 60.0
"""Least time between two checkpoints; an interruption writes one at once [s]."""

Row = dict[str, Any]
"""One line of ``log.csv``."""


@dataclass(slots=True)
class _Progress:
    """Progress of a training."""

    epoch: int
    step: int
    """Step in this epoch."""
    sums: Tensor
    """Sums of the losses in this epoch."""
    history: list[Row]


def train(
    trainer: Trainer,
    examples: Examples,
    parameters: TrainingParameters,
    folder: TrainingFolder,
    validate: Callable[[], Evaluation] | None,
    report: ProgressReport,
) -> int:
    """Train until the last epoch is done; returns the number of images seen.

    What comes out does not depend on interruptions: order and variations of the images follow from
    seed, epoch and step alone.

    Args:
        validate: scores of the running mean; None: there is nothing to score on.

    Raises:
        KeyboardInterrupt: SIGINT; a checkpoint was written.
        UnfinishedError: SIGTERM; a checkpoint was written.
        UsageError: the loss is not finite any more, or the checkpoint is damaged.
    """
    device = examples.images.device
    now = _begin(trainer, folder, device)
    images = len(examples.images)
    batch = min(parameters.batch, images)
    steps = images // batch
    total = parameters.epochs * steps
    saved_s = time.monotonic()
    with _signals() as caught:
        while now.epoch < parameters.epochs:
            order, chance = (
                torch.from_numpy(array).to(device)
                for array in plan_epoch(parameters.seed, now.epoch, images)
            )
            while now.step < steps:
                number = now.epoch * steps + now.step
                rate = learning_rate(parameters.recipe, number, steps, parameters.epochs)
                chosen = slice(now.step * batch, (now.step + 1) * batch)
                now.sums += trainer.step(examples, order[chosen], chance[chosen], number, rate)
                now.step += 1
                report(number + 1, total)
                if caught:
                    _save(trainer, folder, now)
                    _leave(caught[0])
            _end_epoch(now, steps, parameters, validate, folder, report)
            if time.monotonic() - saved_s >= CHECKPOINT_S or now.epoch == parameters.epochs:
                _save(trainer, folder, now)
                saved_s = time.monotonic()
        if caught:  # during the last epoch's end: its checkpoint is written
            _leave(caught[0])
    return total * batch


def _begin(trainer: Trainer, folder: TrainingFolder, device: torch.device) -> _Progress:
    state = folder.load_checkpoint(device)
    if state is None:
        return _Progress(0, 0, torch.zeros(len(PARTS), device=device), [])
    trainer.load_state(state["trainer"])
    return _Progress(state["epoch"], state["step"], state["sums"], state["history"])


def _save(trainer: Trainer, folder: TrainingFolder, now: _Progress) -> None:
    folder.save_checkpoint(
        {
            "epoch": now.epoch,
            "step": now.step,
            "sums": now.sums,
            "history": now.history,
            "trainer": trainer.state(),
        }
    )


def _end_epoch(
    now: _Progress,
    steps: int,
    parameters: TrainingParameters,
    validate: Callable[[], Evaluation] | None,
    folder: TrainingFolder,
    report: ProgressReport,
) -> None:
    losses = (now.sums / steps).tolist()
    epoch = now.epoch + 1
    if not all(math.isfinite(value) for value in losses):
        raise UsageError(
            f"training: the loss is not finite in epoch {epoch}; give a new folder and a smaller"
            f" learning rate, --set learning_rate={parameters.recipe.learning_rate / 4:g}"
        )
    done = epoch * steps
    rate = learning_rate(parameters.recipe, done - 1, steps, parameters.epochs)
    row: Row = {"epoch": epoch, "steps": done, "learning_rate": rate, "loss": sum(losses)}
    row |= dict(zip(PARTS, losses, strict=True))
    row |= {"map50": None}
    every = parameters.validate_every
    if validate is not None and every and (epoch % every == 0 or epoch == parameters.epochs):
        scorecard = validate()
        row["map50"] = scorecard.all.mean_ap
        scores = [f"{name} {_percent(one.ap)}" for name, one in scorecard.all.classes.items()]
        report.say(
            f"epoch {epoch}: loss {sum(losses):.3f}, mAP@0.5 {_percent(scorecard.all.mean_ap)}"
            f" ({', '.join(scores)})"
        )
    now.history.append(row)
    folder.write(LOG, _log(now.history))
    now.epoch, now.step = epoch, 0
    now.sums = torch.zeros_like(now.sums)


def _log(history: list[Row]) -> bytes:
    lines = [",".join(history[0])]
    for row in history:
        cells = ("" if value is None else f"{value:.6g}" for value in row.values())
        lines.append(",".join(cells))
    return ("\n".join(lines) + "\n").encode()


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f}"


@contextlib.contextmanager
def _signals() -> Iterator[list[int]]:
    """Signals that ask for an end, as they come in; a second SIGINT ends at once."""
    caught: list[int] = []

    def on_signal(number: int, _frame: object) -> None:
        if caught and number == signal.SIGINT:
            raise KeyboardInterrupt
        caught.append(number)

    before = {name: signal.signal(name, on_signal) for name in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)


def _leave(number: int) -> None:
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise UnfinishedError("training: stopped; run the same command again to go on")
