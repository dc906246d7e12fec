"""Training of networks: two recipes, early stopping, and checkpoints from which it goes on as if nothing had been."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from ecat.progress import Progress, silent
from learn.recognize.kept import require_size
from learn.recognize.neural.checkpoints import Checkpoint, going_on, read_checkpoint, write_checkpoint

Augment = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class Settings:
    """How a network is trained.

    Attributes
    ----------
    model : its name.
    rate, decay : of stochastic gradient descent, the learning rate, and what it is multiplied with after each epoch
        from the tenth on; or where ``decay`` is 0, the highest rate of AdamW, which rises for a fifth of the steps,
        then falls along a cosine, while the mean of recent weights is what is kept.
    keep : share of outputs that are not dropped out.
    members : networks that are trained together and asked together; of the raw network only.
    step : frames from one window for training to the next.
    durations : how many times as long sessions take that are learned from; of the raw network only.
    carries : whether states are carried from batch to batch, windows are in order, and the last are dropped.
    crf_weight : of scores of pairs when recognising.
    validation : share of the training sessions that say when to stop; 0 trains for all epochs.
    patience : epochs without a better score before it stops.
    """

    model: str
    hidden: int = 200
    layers: int = 1
    epochs: int = 100
    batch: int = 80
    rate: float = 0.2
    decay: float = 0.95
    keep: float = 0.6
    members: int = 1
    step: int = 5
    durations: tuple[float, ...] = (1.0,)
    carries: bool = False
    crf_weight: float = 1.0
    validation: float = 0.1
    patience: int = 25
    seed: int = 0


@dataclass
class History:
    """Of each epoch, the mean loss, and the share of windows for validation that were right."""

    losses: list[float] = field(default_factory=list[float])
    scores: list[float] = field(default_factory=list[float])
    best: int = -1

    def require_whole(self) -> None:
        """Raise a ValueError unless there are numbers of all epochs, and the best is among them."""
        numbers = [*self.losses, *self.scores]
        if (
            not all(isinstance(number, float) for number in numbers)
            or len(self.scores) not in (0, len(self.losses))
            or self.best not in range(-1, len(self.scores))
        ):
            raise ValueError("its history is not that of a training")


def fit(
    network: Any,
    inputs: Tensor,
    targets: Tensor,
    settings: Settings,
    *,
    augment: Augment | None = None,
    validate: Callable[[], float] | None = None,
    checkpoint: Path | None = None,
    identity: str = "",
    progress: Progress = silent,
) -> History:
    """Train a network in place, on one process' random numbers, which the caller has seeded.

    Parameters
    ----------
    network : a module with ``loss(inputs, targets)``.
    augment : makes other inputs of a batch, of which the same is true.
    validate : the score of the network as it is.
    checkpoint : written after every epoch; where there is one, training goes on from it.
    identity : of settings and sessions; a checkpoint of another is refused.

    Raises
    ------
    InputError : the checkpoint is of other settings or sessions.
    CorruptError : it is damaged.
    LimitError : it would be larger than what is read.
    """
    trainer = _Trainer(network, settings, max(1, len(inputs) // settings.batch))
    if checkpoint is not None and checkpoint.exists():
        kept = read_checkpoint(checkpoint, identity)
        with going_on(checkpoint):
            trainer.restore(kept)
    elif checkpoint is not None:
        require_size(checkpoint, trainer.n_bytes)  # before the first epoch, not after it
    history = trainer.history
    with one_thread():
        while trainer.epoch < settings.epochs and not trainer.is_done:
            progress("training: epochs", trainer.epoch, settings.epochs)
            trainer.history.losses.append(trainer.run_epoch(inputs, targets, augment))
            if validate is not None:
                trainer.note(validate)
            if checkpoint is not None:
                write_checkpoint(checkpoint, trainer.state(), identity)
    progress("training: epochs", settings.epochs, settings.epochs)
    trainer.finish()
    return history


@contextmanager
def one_thread() -> Generator[None]:
    """Sums are made in the same order on every machine, and two trainings on one do not wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def forget(network: Any) -> None:
    """Drop the states that a network carries, if it does."""
    drop: Any = getattr(getattr(network, "body", None), "forget", None)
    if drop is not None:
        drop()


class _Trainer:
    def __init__(self, network: Any, settings: Settings, steps: int) -> None:
        self.network, self.settings, self.steps = network, settings, steps
        self.history = History()
        self.averages = settings.decay == 0
        parameters = list(network.parameters())
        self.optimiser: Any = (
            torch.optim.AdamW(parameters, settings.rate, weight_decay=0.05)
            if self.averages
            else torch.optim.SGD(parameters, settings.rate)
        )
        self.mean = copy.deepcopy(network.state_dict())
        self.best = copy.deepcopy(network.state_dict())

    @property
    def epoch(self) -> int:
        return len(self.history.losses)

    @property
    def n_bytes(self) -> int:
        """Of a checkpoint, which also has what the optimiser knows of each parameter: of AdamW two numbers."""
        parts = [value for part in self._parts().values() for value in part.values()]
        known = [*self.network.parameters()] * 2 if self.averages else []
        return sum(value.numel() * value.element_size() for value in [*parts, *known])

    @property
    def is_done(self) -> bool:
        scores = self.history.scores
        return bool(scores) and self.epoch - 1 - self.history.best >= self.settings.patience

    def run_epoch(self, inputs: Tensor, targets: Tensor, augment: Augment | None) -> float:
        self.network.train()
        forget(self.network)
        n, batch = len(inputs), self.settings.batch
        order = torch.arange(n) if self.settings.carries else torch.randperm(n)
        total = torch.zeros(())
        for step in range(self.steps):
            rows = order[step * batch : (step + 1) * batch]
            seen = augment(inputs[rows]) if augment else inputs[rows]
            total += self._step(self.epoch * self.steps + step, seen, targets[rows])
        forget(self.network)
        return float(total) / self.steps

    def note(self, validate: Callable[[], float]) -> None:
        """Score the network as it would be kept, and keep it if it is the best."""
        own = copy.deepcopy(self.network.state_dict())
        kept = self.mean if self.averages else own
        self.network.load_state_dict(kept)
        score = validate()
        forget(self.network)
        if not self.history.scores or score > self.history.scores[self.history.best]:
            self.history.best = len(self.history.scores)
            self.best = copy.deepcopy(kept)
        self.history.scores.append(score)
        self.network.load_state_dict(own)

    def finish(self) -> None:
        if self.history.scores:
            self.network.load_state_dict(self.best)
        elif self.averages and self.epoch:
            self.network.load_state_dict(self.mean)
        self.network.eval()

    def state(self) -> Checkpoint:
        arrays = {
            f"{name}.{key}": value for name, part in self._parts().items() for key, value in part.items()
        }
        for number, values in self.optimiser.state_dict()["state"].items():
            arrays |= {
                f"optimiser.{number}.{key}": value for key, value in values.items() if value is not None
            }
        arrays["random"] = torch.get_rng_state()
        return Checkpoint(arrays, vars(self.history))

    def restore(self, kept: Checkpoint) -> None:
        """Go on from there; if it is damaged, anything may be raised, or a ValueError."""
        history = History(**kept.history)
        history.require_whole()
        for name, part in self._parts().items():
            part_kept = {key: _like(value, kept.arrays[f"{name}.{key}"]) for key, value in part.items()}
            if name == "network":
                self.network.load_state_dict(part_kept)
            else:
                setattr(self, name, part_kept)
        self.optimiser.load_state_dict(self._optimised(kept))
        torch.set_rng_state(kept.arrays["random"])
        self.history = history

    def _optimised(self, kept: Checkpoint) -> dict[str, Any]:
        whole, parameters = self.optimiser.state_dict(), list(self.network.parameters())
        for name, value in kept.arrays.items():
            head, _, rest = name.partition(".")
            if head == "optimiser":
                number, _, key = rest.partition(".")
                if value.shape not in ((), parameters[int(number)].shape):
                    raise ValueError(f"{name} is of another network")
                whole["state"].setdefault(int(number), {})[key] = value
        if self.averages and len(whole["state"]) != len(parameters):
            raise ValueError("it lacks what the optimiser knew")
        return whole

    def _parts(self) -> dict[str, dict[str, Tensor]]:
        return {"network": self.network.state_dict(), "mean": self.mean, "best": self.best}

    def _step(self, step: int, inputs: Tensor, targets: Tensor) -> Tensor:
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.rate * self._factor(step)
        loss: Tensor = self.network.loss(inputs, targets)
        self.optimiser.zero_grad()
        loss.backward()  # pyright: ignore[reportUnknownMemberType]
        nn.utils.clip_grad_norm_(self.network.parameters(), 1.0 if self.averages else 5.0)
        self.optimiser.step()
        if self.averages:
            self._average(1 - min(0.998, (step + 1) / (step + 11)))
        return loss.detach()

    def _average(self, share: float) -> None:
        for name, value in self.network.state_dict().items():
            if value.dtype.is_floating_point:
                self.mean[name].lerp_(value, share)
            else:
                self.mean[name].copy_(value)

    def _factor(self, step: int) -> float:
        if not self.averages:
            return self.settings.decay ** max(step // self.steps - 10, 0)
        done = step / max(self.steps * self.settings.epochs, 1)
        return done / 0.2 if done < 0.2 else 0.5 * (1 + math.cos(math.pi * (done - 0.2) / 0.8))


def _like(value: Tensor, other: Tensor) -> Tensor:
    if (value.shape, value.dtype) != (other.shape, other.dtype):
        raise ValueError("its numbers are of another network")
    return other
