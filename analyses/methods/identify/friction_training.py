"""Training of networks for friction near zero velocity: friction samples in, networks out.

One 1-10-1 network a joint (tanh, linear; Lu et al., section 3.1), all joints in one batch, on the
samples with |v| <= v_crit. Outside it the velocity law holds; a correction closes the gap between
the two at +-v_crit (wrenchsight.models.friction.semi_parametric_friction).

The rule for v_crit, joint by joint: the samples' deviation from the law, counted positive against
the motion, is averaged over `NUM_BINS` ranges of |v| with as many samples each. v_crit is the speed
at which the average first changes its sign: below it the law is off to one side, there it meets the
data. Slower than `REST_SPEED_SHARE` of the highest speed is rest: a joint that rests carries any
torque up to its stiction, which shows nothing of the law. v_crit lies between `MIN_SPEED_SHARE` and
`MAX_SPEED_SHARE` of that speed, and reaches as far within them as the fewest samples that training
needs.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.friction_network import FrictionNetworks
from wrenchsight.models.numerics.arrays import Array

NUM_BINS = 40
REST_SPEED_SHARE = 0.002  # of the highest speed
MIN_SPEED_SHARE, MAX_SPEED_SHARE = 0.01, 0.5  # of the highest speed
MIN_BAND_SAMPLES = 40  # samples in the band of each joint, and ten in each direction
MOST_SAMPLES = 600  # of a joint that are trained on; more add nothing
HELD_OUT = 0.2
NUM_NEURONS = 10
LEAST_RATE = 1e-4  # of Adam, at the last step
_SAME_SPEED = 1e-9  # relative
_MIN_SD = 1e-12  # N m, added to the torque's sd: a joint without any is learnt as zero
# 1 over the band's edge, of kinks at the start: as wide as the band, as steep as the jump
_MIN_STEEPNESS, _MAX_STEEPNESS = 2.0, 60.0
_FIRST_OUTPUT_SD = 0.3  # of W2 at the start
_LEAST_GAIN = 1e-5  # relative, of the held-out error, from which on a step is better


@dataclass
class TrainingConfig:
    """Settings of the networks' training."""

    seed: int = 0  # of the first weights and of the split
    odd: bool = False  # f(-v) = -f(v) + constant, built in
    steepest: float = 60.0  # of the first neuron at its start: its jump is as wide as v_crit / this
    steps: int = 1500  # of Adam, at most
    patience: int = 250  # steps without a better held-out error after which a joint is done
    learning_rate: float = 0.02


@dataclass(frozen=True, eq=False)
class TrainedNetworks:
    """Networks, and how well they do."""

    networks: FrictionNetworks  # to be evaluated by `wrenchsight.models.friction.friction_network`
    v_crit: Array  # (n,) rad/s
    rmse: Array  # (n,) N m, on the held-out samples of the band
    steps: NDArray[np.int64]  # (n,) after which each joint's weights were taken


def critical_velocity(v: Array, torque: Array, law: CoulombViscous) -> Array:
    """(n,) rad/s: speed below which samples and law part, by the rule at the top of this file.

    It may leave fewer samples below it than training needs, and is 0 of a joint without a sample
    in motion: `train_networks` refuses such a band.

    Args:
        v: (N, n) rad/s; rows with NaN in a joint do not count for that joint.
        torque: (N, n) N m, friction.
        law: law of all velocities.
    """
    v_crit = np.zeros(law.num_joints)
    against_motion = np.sign(v) * (torque - law.torque(v))
    for j in range(law.num_joints):
        counts = np.isfinite(against_motion[:, j]) & _moves(v[:, j])
        order = np.argsort(np.abs(v[counts, j]), kind="stable")
        velocity, deviation = v[counts, j][order], against_motion[counts, j][order]
        if len(velocity):
            most = MAX_SPEED_SHARE * np.abs(velocity[-1])
            least = min(_least_edge(velocity), most)
            v_crit[j] = np.clip(_first_crossing(np.abs(velocity), deviation), least, most)
    return v_crit


def _first_crossing(speed: Array, deviation: Array) -> float:
    """Speed at which the mean deviation first changes its sign; the highest where it never does.

    Args:
        speed: (K,) rad/s, ascending.
        deviation: (K,) N m of the samples from the law, positive against the motion.
    """
    edges = _between_speeds(speed, min(NUM_BINS, len(speed)))  # of the ranges of speed, samples
    means = np.array([deviation[begin:end].mean() for begin, end in pairwise(edges)])
    middle = 0.5 * (speed[edges[:-1]] + speed[edges[1:] - 1])  # of each range
    is_other_sign = means * means[0] <= 0.0
    # Twice in a row: one range alone may be noise.
    turned = np.flatnonzero(is_other_sign[:-1] & is_other_sign[1:])
    if not len(turned):
        return float(speed[-1])
    k = int(turned[0])
    if k == 0:  # it is zero from the first range on
        return float(middle[0])
    share = means[k - 1] / (means[k - 1] - means[k])  # of the way between the ranges, at zero
    return float(middle[k - 1] * (1.0 - share) + middle[k] * share)


def _least_edge(velocity: Array) -> float:
    """Speed, rad/s, up to which a band must reach for as many samples as training needs.

    Of a joint that has fewer samples altogether, their number does not count.

    Args:
        velocity: (K,) rad/s in the order of the speed.
    """
    speed = np.abs(velocity)
    each_way = MIN_BAND_SAMPLES // 4
    needed = [speed[MIN_BAND_SAMPLES - 1 : MIN_BAND_SAMPLES]]  # one speed each, or none
    needed += [speed[velocity * sign > 0.0][each_way - 1 : each_way] for sign in (1.0, -1.0)]
    return float(max([MIN_SPEED_SHARE * speed[-1], *np.concatenate(needed)]))


def _between_speeds(speed: Array, count: int) -> NDArray[np.intp]:
    """Bounds of `count` ranges of as many rows of ascending speeds, or fewer.

    A pair of passes has one speed, forth and back: no range holds only one half of such a pair, or
    rounding would decide which.
    """
    edges = np.linspace(0, len(speed), count + 1).astype(int)
    apart = np.flatnonzero(np.diff(speed) > _SAME_SPEED * speed[1:]) + 1
    starts = np.concatenate([[0], apart, [len(speed)]])
    return np.unique(starts[np.searchsorted(starts, edges)])


def train_networks(
    v: ArrayLike,
    torque: ArrayLike,
    law: CoulombViscous,
    groups: ArrayLike | None = None,
    v_crit: ArrayLike | None = None,
    config: TrainingConfig | None = None,
    joint_names: tuple[str, ...] | None = None,
) -> TrainedNetworks:
    """Trains the near-zero networks of all joints; the same numbers give the same weights.

    A fifth of the samples is held out, in stretches of the log (of each group). Training of a joint
    stops when its held-out error has not improved for `patience` steps. Its weights are those of
    the best step.

    Args:
        v: (N, n) rad/s at all velocities; NaN where a joint has no sample.
        torque: (N, n) N m, friction there.
        law: outside the band.
        groups: (N,) which run a row is of; held-out stretches never straddle two.
        v_crit: (n,) rad/s; None: by the rule.
        config: see `TrainingConfig`.
        joint_names: for messages.

    Raises:
        InputError: a joint has too few samples in its band.
        ValueError: v and torque of different shapes.
    """
    config = config or TrainingConfig()
    v, torque = np.asarray(v, float), np.asarray(torque, float)
    n = law.num_joints
    if v.ndim != 2 or v.shape != torque.shape or v.shape[1] != n:
        raise ValueError(f"v {v.shape} and torque {torque.shape} must be (N, {n})")
    edge = critical_velocity(v, torque, law) if v_crit is None else np.asarray(v_crit, float)
    names = joint_names or tuple(f"joint {j + 1}" for j in range(n))
    band_rows = [_band(v[:, j], torque[:, j], float(edge[j]), names[j]) for j in range(n)]
    group = np.zeros(len(v), int) if groups is None else np.asarray(groups)
    rng = np.random.default_rng(config.seed)
    # (n, K) each: v over the edge, torque, and weights whose sum is 1 a joint (`_BandSamples`).
    x, y, fitted, held_out = _band_samples(v, torque, edge, band_rows, group, rng)
    # The networks are trained on torques of mean zero and unit sd, and scaled back below.
    mean = (fitted * y).sum(axis=1)
    sd = np.sqrt((fitted * (y - mean[:, None]) ** 2).sum(axis=1)) + _MIN_SD
    z = (y - mean[:, None]) / sd[:, None]
    with one_thread():  # the same sums in the same order on every machine; faster, too
        (W1, b1, W2, b2), mean_squares, steps = _descend(x, z, fitted, held_out, config)
    networks = FrictionNetworks(W1, b1, W2 * sd[:, None], b2 * sd + mean, edge)
    return TrainedNetworks(
        networks=networks,
        v_crit=edge,
        rmse=np.sqrt(mean_squares) * sd,
        steps=steps,
    )


def _moves(v: Array) -> NDArray[np.bool_]:
    speed = np.abs(v)
    highest = np.nanmax(speed, initial=0.0)
    return np.asarray(np.isfinite(v) & (speed > REST_SPEED_SHARE * highest) & (speed > 0.0))


def _band(v: Array, torque: Array, v_crit: float, name: str) -> NDArray[np.intp]:
    inside = np.isfinite(torque) & _moves(v) & (np.abs(v) <= v_crit)
    rows = np.flatnonzero(inside)
    forth, back = int((v[rows] > 0.0).sum()), int((v[rows] < 0.0).sum())
    if len(rows) < MIN_BAND_SAMPLES or min(forth, back) < MIN_BAND_SAMPLES // 4:
        raise InputError(
            "friction training",
            name,
            f"{len(rows)} samples with |v| <= {v_crit:.3g} rad/s ({forth} forth, {back} back), "
            f"{MIN_BAND_SAMPLES} or more are needed, {MIN_BAND_SAMPLES // 4} each way",
            "record slow motion of this joint in both directions",
        )
    return rows


class _BandSamples(NamedTuple):
    """The samples of all joints' bands, a row a joint; zeros at the end of joints with fewer.

    Attributes:
        x: (n, K) velocity over the band's edge, -1 to 1.
        y: (n, K) N m.
        fitted: (n, K) weights of the samples that are fitted: 1 / their number, else 0.
        held_out: (n, K) the same of those that are not.
    """

    x: Array
    y: Array
    fitted: Array
    held_out: Array


def _band_samples(
    v: Array,
    torque: Array,
    edge: Array,
    band_rows: list[NDArray[np.intp]],
    group: NDArray[Any],
    rng: np.random.Generator,
) -> _BandSamples:
    """Takes MOST_SAMPLES of each joint's band at most, and holds some of them out.

    Joints with fewer samples than K, the most of any, have zeros at the end: of weight 0.

    Args:
        v, torque: (N, n) rad/s and N m.
        edge: (n,) rad/s, of the bands.
        band_rows: of each joint the rows in its band.
        group: (N,) which run a row is of.
        rng: draws what is held out, joint by joint in their order.
    """
    size = min(MOST_SAMPLES, max(len(rows) for rows in band_rows))
    x, y, fitted, held_out = np.zeros((4, len(edge), size))
    for j, all_rows in enumerate(band_rows):
        # Evenly through the log, so that the same stretch of it stays together in the split.
        count = min(size, len(all_rows))
        rows = all_rows[np.linspace(0, len(all_rows) - 1, count).astype(int)]
        is_held_out = _held_out(group[rows], rng)
        x[j, :count] = v[rows, j] / edge[j]
        y[j, :count] = torque[rows, j]
        fitted[j, :count] = ~is_held_out / max(1, int((~is_held_out).sum()))
        held_out[j, :count] = is_held_out / max(1, int(is_held_out.sum()))
    return _BandSamples(x=x, y=y, fitted=fitted, held_out=held_out)


def _held_out(group: NDArray[Any], rng: np.random.Generator) -> NDArray[np.bool_]:
    """A fifth of the rows, in stretches: neighbours in a log know each other's error."""
    count = len(group)
    length = max(1, count // 50)
    stretch = np.arange(count) // length
    _, stretch = np.unique(np.stack([group, stretch]), axis=1, return_inverse=True)
    number = int(stretch.max()) + 1
    away = np.zeros(number, bool)
    away[rng.permutation(number)[: max(1, round(HELD_OUT * number))]] = True
    return np.asarray(away[stretch.ravel()])


@contextmanager
def one_thread() -> Iterator[None]:
    """Torch on one thread for as long as a block lasts: its sums have one order."""
    import torch

    previous_threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(previous_threads)


def _first_weights(n: int, config: TrainingConfig) -> list[Array]:
    """W1 (n, H), b1 (n, H), W2 (n, H), b2 (n,) from which the training starts.

    Kinks are spread over the band, from as wide as it to as steep as the jump at zero velocity. The
    first neuron is that jump.
    """
    draw = np.random.default_rng(config.seed + 1)
    shape = (n, NUM_NEURONS)
    steepness = np.exp(draw.uniform(np.log(_MIN_STEEPNESS), np.log(_MAX_STEEPNESS), shape))
    steepness[:, 0] = config.steepest
    W1 = steepness * draw.choice([-1.0, 1.0], shape)
    W2 = _FIRST_OUTPUT_SD * draw.normal(size=shape)
    kink = draw.uniform(-1.0, 1.0, shape)  # over the band's edge
    b1 = np.zeros_like(W1) if config.odd else W1 * kink
    b1[:, 0] = 0.0
    return [W1, b1, W2, np.zeros(n)]


def _descend(
    x: Array,
    z: Array,
    fitted: Array,
    held_out: Array,
    config: TrainingConfig,
) -> tuple[list[Array], Array, NDArray[np.int64]]:
    """Adam on all joints at once; each keeps the weights of its own best step.

    A joint's network is b2 + W2 . tanh(W1 x + b1), with H = NUM_NEURONS neurons.

    Args:
        x: (n, K) velocity over the band's edge, -1 to 1.
        z: (n, K) torque to learn, in units of its sd.
        fitted, held_out: (n, K) weights of the samples in the two mean squares.

    Returns:
        W1 (n, H), b1 (n, H), W2 (n, H), b2 (n,); (n,) held-out mean squares, and the steps at which
        they were reached.
    """
    import torch

    n = len(x)
    start = _first_weights(n, config)
    parameters = [torch.tensor(a, dtype=torch.float64, requires_grad=True) for a in start]
    X, Z, fit_weight, held_out_weight = (
        torch.tensor(a, dtype=torch.float64) for a in (x, z, fitted, held_out)
    )
    optimiser = torch.optim.Adam(parameters, config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.steps, LEAST_RATE)
    # Of each joint: the best weights so far, their held-out mean square, the step that gave them.
    best = [p.detach().clone() for p in parameters]
    lowest = torch.full((n,), torch.inf, dtype=torch.float64)
    best_step = torch.zeros(n, dtype=torch.int64)
    for step in range(config.steps):
        W1, b1, W2, b2 = parameters
        hidden = torch.tanh(W1[:, None, :] * X[:, :, None] + b1[:, None, :])
        square = ((hidden * W2[:, None, :]).sum(dim=2) + b2[:, None] - Z) ** 2
        fit_error = (fit_weight * square).sum(dim=1)
        held_out_error = (held_out_weight * square).sum(dim=1)
        with torch.no_grad():
            better = held_out_error < lowest * (1.0 - _LEAST_GAIN)
            lowest = torch.where(better, held_out_error, lowest)
            best_step = torch.where(better, step, best_step)
            for best_values, values in zip(best, parameters, strict=True):
                best_values[better] = values[better]
            if int((step - best_step).min()) > config.patience:
                break
        optimiser.zero_grad()
        fit_error.sum().backward()  # joints share no parameter
        if config.odd:
            b1.grad.zero_()  # it stays zero: tanh(W1 x) is odd
        optimiser.step()
        schedule.step()
    return [p.numpy() for p in best], lowest.numpy(), best_step.numpy()
