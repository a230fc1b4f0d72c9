"""One step of training: learning rate, gradient, weights, their running mean."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import torch
from torch import Tensor

from devkit.darknet.network import DarknetNetwork
from devkit.training.augment import Augmentation
from devkit.training.examples import Boxes, Examples
from devkit.training.loss import GridLoss
from devkit.training.network import TorchNetwork
from devkit.training.parameters import TrainingParameters, TrainingRecipe

FINAL_SHARE = 0.01
"""Share of the learning rate at the end of the schedule [-]."""

BETAS = (0.9, 0.999)
"""Decays of AdamW's running means (Loshchilov, Hutter, 2019)."""


def learning_rate(recipe: TrainingRecipe, step: int, steps_per_epoch: int, epochs: int) -> float:
    """Linear warm-up, then half a cosine down to :data:`FINAL_SHARE` of it."""
    warmup = min(recipe.warmup_epochs, epochs) * steps_per_epoch
    if step < warmup:
        return recipe.learning_rate * (step + 1) / warmup
    done = (step - warmup) / max(steps_per_epoch * epochs - warmup, 1)
    share = FINAL_SHARE + (1.0 - FINAL_SHARE) * 0.5 * (1.0 + math.cos(math.pi * done))
    return recipe.learning_rate * share


class Trainer:
    """Weights, optimiser and running mean; :meth:`step` is all that changes them."""

    def __init__(
        self, network: DarknetNetwork, parameters: TrainingParameters, device: torch.device
    ) -> None:
        recipe = parameters.recipe
        self._recipe = recipe
        self._device = device
        self.model = TorchNetwork(network, parameters.seed).to(device)
        self.mean = TorchNetwork(network, parameters.seed).to(device)
        """Running mean of ``model``: what is evaluated and exported."""
        self.mean.load_state_dict(self.model.state_dict())
        self.mean.requires_grad_(False).eval()
        # The layout that tensor cores want; a fifth faster on a CPU, too.
        for model in (self.model, self.mean):
            model.to(memory_format=torch.channels_last)
        self._loss = GridLoss(network, recipe, device)
        self._augmentation = Augmentation(recipe, network.input.width, network.input.height, device)
        kernels = [p for p in self.model.parameters() if p.ndim > 1]
        others = [p for p in self.model.parameters() if p.ndim <= 1]
        self.optimizer = torch.optim.AdamW(
            [
                {"params": kernels, "weight_decay": recipe.weight_decay},
                {"params": others, "weight_decay": 0.0},
            ],
            lr=recipe.learning_rate,
            betas=BETAS,
            fused=device.type == "cuda",
        )
        self._parameters = list(self.model.parameters())
        self._numbers = _numbers(self.model)
        self._mean_numbers = _numbers(self.mean)

    def step(
        self, examples: Examples, index: Tensor, chance: Tensor, number: int, rate: float
    ) -> Tensor:
        """One batch; returns its losses, float32 [len(PARTS)], on the device.

        Args:
            examples: all images.
            index: int64 [B]: which of them.
            chance: float32 [B, CHANCES]: how they vary.
            number: steps before this one.
            rate: learning rate.
        """
        boxes = examples.boxes
        truth = Boxes(boxes.box[index], boxes.class_id[index], boxes.kind[index])
        with torch.no_grad():
            images = self._augmentation.images(examples.images[index], chance)
            truth = self._augmentation.boxes(truth, chance)
        self.model.train()
        with self._lower_precision():
            raw = self.model(images.contiguous(memory_format=torch.channels_last))
        losses = torch.stack(self._loss(raw, truth))
        self.optimizer.zero_grad(set_to_none=True)
        losses.sum().backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self._parameters, self._recipe.gradient_norm_max)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.optimizer.step()
        # At the beginning the mean follows closely, or it would remember the random weights.
        decay = min(self._recipe.ema_decay, (1 + number) / (10 + number))
        with torch.no_grad():
            torch._foreach_lerp_(self._mean_numbers, self._numbers, 1.0 - decay)
        return losses.detach()

    def state(self) -> dict[str, Any]:
        """All numbers, for a checkpoint."""
        return {
            "model": self.model.state_dict(),
            "mean": self.mean.state_dict(),
            "optimizer": self.optimizer.state_dict(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of :meth:`state`."""
        self.model.load_state_dict(state["model"])
        self.mean.load_state_dict(state["mean"])
        self.optimizer.load_state_dict(state["optimizer"])

    def _lower_precision(self) -> contextlib.AbstractContextManager[Any]:
        if self._device.type == "cuda":
            return torch.autocast("cuda", torch.bfloat16)
        return contextlib.nullcontext()


def _numbers(model: TorchNetwork) -> list[Tensor]:
    """All weights, and means and variances of the batches."""
    return [value.detach() for value in model.state_dict().values() if value.is_floating_point()]
