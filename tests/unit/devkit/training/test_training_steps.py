"""One step of training: schedule, running mean, and that it never waits for the device."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
import torch
from torch.profiler import ProfilerActivity, profile

from devkit.darknet.variant import architecture_network
from devkit.training.augment import plan_epoch
from devkit.training.examples import LABEL, Boxes, Examples
from devkit.training.parameters import TrainingParameters, TrainingRecipe
from devkit.training.steps import FINAL_SHARE, Trainer, learning_rate

CPU = torch.device("cpu")


def examples(count: int = 4, places: int = 6) -> Examples:
    rng = np.random.default_rng(1)
    box = torch.tensor(0.1 + 0.5 * rng.random((count, places, 4)), dtype=torch.float32)
    class_id = torch.tensor(rng.integers(0, 4, (count, places)))
    images = torch.from_numpy(rng.integers(0, 256, (count, 96, 160, 3), dtype=np.uint8))
    return Examples(images, Boxes(box, class_id, torch.full((count, places), LABEL)))


def trainer(name: str = "yolov3-tiny-w25", **recipe) -> Trainer:
    network = architecture_network(name, classes=4, width=160, height=96)
    return Trainer(network, TrainingParameters(model=name, recipe=TrainingRecipe(**recipe)), CPU)


def take(one: Trainer, count: int, rate: float = 1e-3) -> list[float]:
    data = examples()
    losses = []
    for number in range(count):
        order, chance = (torch.from_numpy(part) for part in plan_epoch(1, number, 4))
        losses.append(one.step(data, order, chance, number, rate).sum().item())
    return losses


def test_warm_up_then_a_cosine():
    recipe = TrainingRecipe(learning_rate=1.0, warmup_epochs=2)
    rates = [learning_rate(recipe, step, 10, 10) for step in range(100)]
    assert rates[:3] == pytest.approx([0.05, 0.1, 0.15])
    assert rates[19] == pytest.approx(1.0)
    assert max(rates) <= 1.0
    assert rates[60] == pytest.approx(FINAL_SHARE + (1 - FINAL_SHARE) / 2)
    assert all(a > b for a, b in itertools.pairwise(rates[20:]))
    assert rates[-1] == pytest.approx(FINAL_SHARE, abs=1e-3)
    # A training shorter than its warm-up, and none at all.
    assert learning_rate(recipe, 9, 10, 1) == pytest.approx(1.0)
    assert learning_rate(TrainingRecipe(learning_rate=1.0, warmup_epochs=0), 0, 10, 1) == 1.0


def test_the_loss_falls():
    losses = take(trainer(jitter=0.0, flip=0.0, warmup_epochs=0), 12, 3e-3)
    assert losses[-1] < 0.8 * losses[0]


def test_the_mean_follows_the_weights():
    one = trainer(ema_decay=0.5)
    before = one.mean.block(0).convolution.weight.clone()
    take(one, 1)
    now, mean = (m.block(0).convolution.weight for m in (one.model, one.mean))
    # Of the first step it keeps a tenth of what was.
    assert torch.allclose(mean, 0.1 * before + 0.9 * now, atol=1e-6)
    assert not torch.equal(now, before)
    norm, own = one.mean.block(0).normalisation, one.model.block(0).normalisation
    assert torch.allclose(norm.running_mean, 0.9 * own.running_mean, atol=1e-6)
    assert not any(p.requires_grad for p in one.mean.parameters())


def test_weights_decay_but_scales_and_biases_do_not():
    one = trainer(weight_decay=0.5)
    decays = {
        id(p): group["weight_decay"]
        for group in one.optimizer.param_groups
        for p in group["params"]
    }
    block = one.model.block(0)
    assert decays[id(block.convolution.weight)] == 0.5
    assert decays[id(block.normalisation.weight)] == 0.0
    assert len(decays) == len(list(one.model.parameters()))


@pytest.mark.parametrize("name", ["yolov2-tiny-w25", "yolov3-tiny-w25"])
@pytest.mark.parametrize("box_loss", ["squared", "ciou"])
def test_no_step_waits_for_the_device(name, box_loss):
    one = trainer(name, box_loss=box_loss)
    take(one, 1)
    with profile(activities=[ProfilerActivity.CPU]) as seen:
        take(one, 1)
    names = [event.name for event in seen.events()]
    assert names.count("aten::convolution") > 5
    # What brings a number to the host. The optimiser does it on the CPU alone, once per tensor:
    # on CUDA its steps are counted on the device. The last one is the test's own.
    waits = names.count("aten::_local_scalar_dense") + names.count("aten::nonzero")
    assert waits == len(list(one.model.parameters())) + 1


def test_a_step_follows_from_its_number_alone():
    one, other = trainer(), trainer()
    take(one, 3)
    take(other, 3)
    for name, value in one.mean.state_dict().items():
        assert torch.equal(value, other.mean.state_dict()[name]), name
    resumed = trainer()
    resumed.load_state(copy.deepcopy(one.state()))
    assert take(resumed, 2) == take(one, 2)
