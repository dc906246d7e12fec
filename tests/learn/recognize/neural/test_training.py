"""Training: the same seed gives the same network, also when it was killed in between."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from ecat.errors import CorruptError, InputError, LimitError
from learn.recognize import kept
from learn.recognize.dataset import Labels
from learn.recognize.neural.checkpoints import read_tensors, write_tensors
from learn.recognize.neural.networks import Dense, RawNetwork, SlotNetwork
from learn.recognize.neural.training import History, Settings, fit

GENERATOR = torch.Generator().manual_seed(0)
INPUTS = torch.randn(60, 4, generator=GENERATOR)
LABELS = (INPUTS[:, :1] > 0).long().expand(-1, 5).contiguous()
SGD = Settings("mlp", epochs=6, batch=20, rate=0.5, keep=0.8)
WINDOWS = torch.randn(40, 20, 75, generator=GENERATOR) / 10
SHARES = torch.eye(3)[torch.randint(3, (40,), generator=GENERATOR)]
VOCABULARY: Labels = np.array([[0, 0, 0, 0, 0], [2, 0, 0, 3, 0], [3, 0, 0, 3, 0]], np.int8)
ADAM = replace(SGD, model="neural", decay=0, rate=1e-2)


def trained(
    settings: Settings, *, epochs: int = 6, checkpoint: Path | None = None, identity: str = "it"
) -> tuple[dict[str, torch.Tensor], History]:
    """Train as far as ``epochs`` of what the settings say, as if killed then."""

    def kill(what: str, done: int, total: int) -> None:
        if done == epochs < total:
            raise KeyboardInterrupt

    torch.manual_seed(settings.seed)
    raw = settings.model == "neural"
    network = RawNetwork(VOCABULARY, 8, 0.2) if raw else SlotNetwork(Dense(4, 8, 0.8), 8, crf=True)
    inputs, targets = (WINDOWS, SHARES) if raw else (INPUTS, LABELS)
    history = History()
    with suppress(KeyboardInterrupt):
        history = fit(
            network, inputs, targets, settings, checkpoint=checkpoint, identity=identity, progress=kill
        )
    return network.state_dict(), history


@pytest.mark.parametrize("settings", [SGD, ADAM])
def test_training_that_was_killed_goes_on_as_if_nothing_had_been(settings: Settings, tmp_path: Path) -> None:
    whole, history = trained(settings)
    trained(settings, epochs=3, checkpoint=tmp_path / "c.npz")
    torch.manual_seed(99)
    resumed, same = trained(settings, checkpoint=tmp_path / "c.npz")
    assert same == history
    for name, values in whole.items():
        torch.testing.assert_close(resumed[name], values, rtol=0, atol=0)


def test_losses_fall() -> None:
    _, history = trained(SGD)
    assert history.losses[-1] < 0.7 * history.losses[0]


def test_another_seed_gives_another_network() -> None:
    one, other = trained(SGD)[0], trained(replace(SGD, seed=1))[0]
    assert any(not torch.equal(values, other[name]) for name, values in one.items())


def test_it_stops_when_validation_gets_no_better_and_keeps_the_best() -> None:
    torch.manual_seed(0)
    network = SlotNetwork(Dense(4, 8, 1.0), 8, crf=False)
    said = iter([0.1, 0.5, 0.4, 0.5, 0.3, 0.9])
    weights: list[torch.Tensor] = []

    def validate() -> float:
        weights.append(next(network.parameters()).detach().clone())
        return next(said)

    history = fit(network, INPUTS, LABELS, replace(SGD, patience=3), validate=validate)
    assert (history.best, history.scores) == (1, [0.1, 0.5, 0.4, 0.5, 0.3])
    torch.testing.assert_close(next(network.parameters()).detach(), weights[1])


def test_a_checkpoint_of_another_training_is_refused(tmp_path: Path) -> None:
    trained(SGD, epochs=2, checkpoint=tmp_path / "c.npz")
    with pytest.raises(InputError, match="cannot go on"):
        trained(SGD, checkpoint=tmp_path / "c.npz", identity="another")


@pytest.mark.parametrize("settings", [SGD, ADAM])
def test_a_network_whose_checkpoint_could_not_be_read_again_is_not_trained_at_all(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained(settings, epochs=1, checkpoint=tmp_path / "c.npz")
    arrays, _ = read_tensors(tmp_path / "c.npz")
    kept_bytes = sum(values.numel() * values.element_size() for values in arrays.values())
    monkeypatch.setattr(kept, "MOST_BYTES", kept_bytes - 8_000)  # random numbers' state has 5,056

    def no_epoch(*_: object) -> float:
        raise AssertionError("it was trained")

    monkeypatch.setattr("learn.recognize.neural.training._Trainer.run_epoch", no_epoch)
    with pytest.raises(LimitError, match="train a smaller model"):
        trained(settings, checkpoint=tmp_path / "other.npz")


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", b"\x80\x04K\x01."])
def test_a_damaged_checkpoint_is_one_error(damage: bytes, tmp_path: Path) -> None:
    (tmp_path / "c.npz").write_bytes(damage)
    with pytest.raises(CorruptError):
        trained(SGD, checkpoint=tmp_path / "c.npz")


CHANGES: dict[str, Callable[[dict[str, Any], dict[str, Any]], object]] = {
    "a mean is missing": lambda arrays, _: arrays.pop("mean.gate.weight"),
    "no random state": lambda arrays, _: arrays.pop("random"),
    "a short random state": lambda arrays, _: arrays.update(random=np.zeros(3, np.uint8)),
    "a random state of fractions": lambda arrays, _: arrays.update(random=np.zeros(5056, np.float32)),
    "a name that is no number": lambda arrays, _: arrays.update({"optimiser.x.y": np.zeros(3)}),
    "a parameter that there is not": lambda arrays, _: arrays.update({"optimiser.999.step": np.zeros(3)}),
    "momenta of another network": lambda arrays, _: arrays.update({"optimiser.0.exp_avg": np.zeros(3)}),
    "no momenta": lambda arrays, _: [arrays.pop(key) for key in list(arrays) if key.startswith("optimiser")],
    "a mean of another network": lambda arrays, _: arrays.update({"mean.gate.weight": np.zeros(3)}),
    "weights that are not known": lambda arrays, _: arrays["network.gate.weight"].fill(np.nan),
    "more history": lambda _, history: history.update(extra=2),
    "losses that are text": lambda _, history: history.update(losses="ab"),
    "scores of other epochs": lambda _, history: history.update(scores=[0.5]),
    "a best that there is not": lambda _, history: history.update(best=5),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_checkpoint_that_is_not_whole_is_one_error(
    change: Callable[[dict[str, Any], dict[str, Any]], object], tmp_path: Path
) -> None:
    dest = tmp_path / "c.npz"
    trained(ADAM, epochs=2, checkpoint=dest)
    with np.load(dest) as kept:
        arrays: dict[str, Any] = dict(kept)
    identity, history = json.loads(arrays["text"].tobytes())
    change(arrays, history)
    arrays["text"] = np.frombuffer(json.dumps([identity, history]).encode(), np.uint8)
    np.savez(dest, allow_pickle=False, **arrays)
    with pytest.raises(CorruptError, match="cannot go on") as error:
        trained(ADAM, checkpoint=dest)
    assert "remove it" in error.value.fix


def test_training_that_goes_astray_is_not_kept(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot keep"):
        trained(replace(ADAM, rate=float("inf")), checkpoint=tmp_path / "c.npz")


def test_a_pickle_among_the_arrays_is_not_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "c.npz", text=np.zeros(0, np.uint8), evil=np.array([print], object))
    with pytest.raises(ValueError, match="numbers"):
        read_tensors(tmp_path / "c.npz")


def test_tensors_come_back_as_they_were(tmp_path: Path) -> None:
    written = {"a": torch.randn(2, 3), "b.c": torch.tensor(7), "d": torch.zeros(0)}
    write_tensors(tmp_path / "t.npz", written, "kept")
    read, text = read_tensors(tmp_path / "t.npz")
    assert text == "kept"
    assert set(read) == set(written)
    assert all(torch.equal(read[name], values) for name, values in written.items())
