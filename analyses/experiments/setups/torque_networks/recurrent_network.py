"""A recurrent network that predicts joint torque from the last half second of q and v.

After FACTR 2 (arXiv 2606.12406), whose LSTM learns ten minutes of contact-free motion in a minute,
and whose residual is read as contact; here a GRU (Cho et al., EMNLP 2014).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.identify.friction_training import LEAST_RATE, one_thread
from wrenchsight.models.numerics.arrays import Array, Flags

if TYPE_CHECKING:
    import torch

HISTORY: Final = 0.5  # s
TAP: Final = 0.04  # s between the samples of a history: five a period of what a 5 Hz log holds
BATCH: Final = 256


@dataclass(frozen=True)
class NetworkConfig:
    """Size and training of a network."""

    hidden: int = 64
    epochs: float = 15.0
    most_steps: int = 1600  # of Adam: about a minute
    rate: float = 5e-3
    decay: float = 0.1  # of the weights, a step and unit of rate
    blur: float = 0.0  # rad, sd of an offset of a history's angles while it is trained
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Motion:
    """A log on a uniform grid; N samples.

    Attributes:
        q: (N, n) rad.
        v: (N, n) rad/s.
        torque: (N, n) N m, what is to be predicted.
        used: (N,) samples that count.
        time_step: s.
    """

    q: Array
    v: Array
    torque: Array
    used: Flags
    time_step: float

    def histories(self, rows: NDArray[np.intp]) -> "torch.Tensor":
        """(K, taps, 2 n) q and v of the half second before each row; the first sample before it."""
        import torch

        at = np.maximum(rows[:, None] - self._back()[::-1], 0)
        return torch.from_numpy(np.concatenate([self.q, self.v], axis=1).astype(np.float32)[at])

    def rows(self) -> NDArray[np.intp]:
        """Rows that count and whose whole history counts."""
        reach = int(self._back()[-1]) + 1
        return np.flatnonzero(
            np.convolve(self.used, np.ones(reach))[: len(self.used)] > reach - 0.5
        )

    def _back(self) -> NDArray[np.intp]:
        every = max(1, round(TAP / self.time_step))
        return np.arange(0, round(HISTORY / self.time_step) + 1, every)


class TorqueNetwork:
    """A trained network: sin q, cos q and v in, the torques of all joints out, all normalised.

    Attributes:
        limit: (n,) N m, bound of its output: twice the largest torque that it was trained on.
    """

    def __init__(self, motions: Sequence[Motion], config: NetworkConfig) -> None:
        """Trains it; the same numbers give the same weights.

        Raises:
            ValueError: no motion holds a history that counts.
        """
        import torch

        rows = [motion.rows() for motion in motions]
        if not any(len(history_rows) for history_rows in rows):
            raise ValueError("no motion is as long as the network's history")
        x = torch.cat([motion.histories(k) for motion, k in zip(motions, rows, strict=True)])
        y = np.concatenate([motion.torque[k] for motion, k in zip(motions, rows, strict=True)])
        self._mean, self._scale = y.mean(axis=0), y.std(axis=0) + 1e-9
        self.limit = 2.0 * np.abs(y).max(axis=0)
        newest = _signals(x)[:, -1]
        self._centre, self._spread = newest.mean(dim=0), newest.std(dim=0) + 1e-3
        with one_thread(), torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self._gru = torch.nn.GRU(newest.shape[1], config.hidden, batch_first=True)
            self._out = torch.nn.Linear(config.hidden, y.shape[1])
            normal = ((y - self._mean) / self._scale).astype(np.float32)
            self._descend(x, torch.from_numpy(normal), config)

    def torque(self, motion: Motion) -> Array:
        """(N, n) N m, the predicted torque of a motion."""
        import torch

        every = np.arange(len(motion.q))
        with one_thread(), torch.no_grad():
            parts = [
                self._of(motion.histories(rows)).numpy()
                for rows in np.array_split(every, 1 + len(every) // 2048)
            ]
        torque = self._mean + self._scale * np.concatenate(parts).astype(float)
        return np.asarray(np.clip(torque, -self.limit, self.limit))

    def _of(self, histories: "torch.Tensor") -> "torch.Tensor":
        x = (_signals(histories) - self._centre) / self._spread
        torque: torch.Tensor = self._out(self._gru(x)[0][:, -1])
        return torque

    def _descend(self, x: "torch.Tensor", y: "torch.Tensor", config: NetworkConfig) -> None:
        import torch

        size, n = min(BATCH, len(x)), x.shape[2] // 2
        steps = min(config.most_steps, math.ceil(config.epochs * len(x) / size))
        parameters = [*self._gru.parameters(), *self._out.parameters()]
        optimiser = torch.optim.AdamW(parameters, lr=config.rate, weight_decay=config.decay)
        rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps, LEAST_RATE)
        draw = np.random.default_rng(config.seed)
        order: list[int] = []
        for _ in range(steps):
            if len(order) < size:
                order += draw.permutation(len(x)).tolist()
            batch, order = torch.tensor(order[:size]), order[size:]
            histories = x[batch]
            histories[:, :, :n] += torch.from_numpy(config.blur * draw.normal(size=(size, 1, n)))
            optimiser.zero_grad()
            error = self._of(histories) - y[batch]
            (error**2).mean().backward()
            optimiser.step()
            rate.step()


def _signals(histories: "torch.Tensor") -> "torch.Tensor":
    import torch

    q, v = histories.chunk(2, dim=2)
    return torch.cat([q.sin(), q.cos(), v], dim=2)
