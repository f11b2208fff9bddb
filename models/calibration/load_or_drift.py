"""Load or drift: the odds that a residual comes from a constant load, friction drift, both or none.

Four fits of the same rows are compared: with a load's ten parameters, with three changes of
friction per joint, with both and with none. Errors of the arm's inertial parameters are unknowns of
all four. Their evidence (`models.calibration.prior_least_squares`) gives the probability of each;
all four are equally likely beforehand. The log shows a load if

- load, or both, have all but MAX_OTHER_PROBABILITY of the probability;
- its mass is `MIN_MASS_ERRORS` standard errors above zero. They include errors of gains and of the
  arm's model, and the spread between joints (`models.calibration.mass_across_joints`): one joint's
  friction error is no load;
- both halves of the log show the same mass, within MAX_MASS_DIFFERENCE of its standard errors. A
  force that comes or goes, or changes sides, is a contact.

A load may also be taken up while the log runs (`weigh_begin`). Its columns are then zero before
some row. All rows are equally likely beforehand; the evidence gives their probabilities. Both
halves of the log after that row have to show the same mass.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.calibration.friction_refresh import FrictionDrift
from wrenchsight.models.calibration.load_identification import (
    COM_DETERMINED_SD,
    MIN_MASS_ERRORS,
    LoadEstimate,
    LoadPrior,
    LoadRows,
    estimate_load,
    vague_spread,
)
from wrenchsight.models.calibration.mass_across_joints import mass_sd_across_joints
from wrenchsight.models.calibration.prior_least_squares import fit_with_prior
from wrenchsight.models.calibration.residual_noise import NUM_DRIFTS
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.numerics.arrays import Array

MAX_OTHER_PROBABILITY = 0.01
MAX_MASS_DIFFERENCE = 3.0  # standard errors of the difference
MIN_ROWS = 40  # rows
# rows that a pass tries as the begin of a load; the next pass searches around the best
PLACES_PER_PASS = 25
FIRST_PASS_ROWS = 600  # rows of a long log that the first pass uses
_LEAST_PROBABILITY = 1e-300  # of no load, for a division
_HELD_SD = 1e-9  # of a column that a fit without unknowns has: the prior holds it at zero
_CAUSE_NAMES = {(False, False): "none", (True, False): "load", (False, True): "drift"}


@dataclass(frozen=True, eq=False)
class LoadOrDrift:
    """A load, and the probability that the log shows it.

    Attributes:
        load: as estimated beside friction's drift.
        mass_sd: kg, standard error of the mass with the spread between joints.
        probability: probability of "none", "load", "drift" and "both".
        is_steady: whether both halves of the log, or of its part with the load, show the same mass.
        begin: s, in the log's time, at which the load is taken up; None: before the log's start.
        begin_sd: s.
    """

    load: LoadEstimate
    mass_sd: float
    probability: dict[str, float]
    is_steady: bool
    begin: float | None = None
    begin_sd: float = 0.0

    @property
    def is_shown(self) -> bool:
        """Whether the log shows a load."""
        loaded = self.probability["load"] + self.probability["both"]
        is_significant = self.load.mass > MIN_MASS_ERRORS * self.mass_sd
        return self.is_steady and is_significant and loaded > 1.0 - MAX_OTHER_PROBABILITY

    def sentence(self) -> str:
        """Mass, place, time and odds of the load, and what to do, for the user."""
        load = self.load
        place = ""
        if (load.sd.com < COM_DETERMINED_SD).all():
            com = ", ".join(f"{1e3 * x:.0f}" for x in load.com)
            com_sd = ", ".join(f"{1e3 * x:.0f}" for x in load.sd.com)
            place = f" at ({com}) +- ({com_sd}) mm from the flange"
        begin = "since the log's start"
        if self.begin is not None:
            begin = f"since t = {self.begin:.1f} +- {max(self.begin_sd, 0.1):.1f} s"
        friction = "drifted friction"
        if self.probability["load"] > self.probability["both"]:
            friction = "the model's friction"
        return (
            f"unmodelled load at the tool: {load.mass:.3g} +- {self.mass_sd:.2g} kg{place}, "
            f"{begin}, with {friction} (odds against no load {_odds(self.probability)}); identify "
            "it with `wrenchsight payload`, or state it as tool in robot.yaml and pass --tool"
        )

    def metrics(self) -> dict[str, object]:
        """As metrics.json holds them under `load`."""
        return {
            "told": self.is_shown,
            "mass_kg": self.load.mass,
            "mass_sd_kg": self.mass_sd,
            "com_m": self.load.com,
            "com_sd_m": self.load.sd.com,
            "steady": self.is_steady,
            "begin_s": self.begin,
            "begin_sd_s": None if self.begin is None else self.begin_sd,
            "probability": self.probability,
        }


def _odds(probability: dict[str, float]) -> str:
    against = probability["none"] + probability["drift"]
    odds = (probability["load"] + probability["both"]) / max(against, _LEAST_PROBABILITY)
    return "over 1e6:1" if odds > 1e6 else f"{odds:.3g}:1"


def weigh(
    log: LoadRows,
    law: CoulombViscous,
    prior: LoadPrior,
) -> LoadOrDrift | None:
    """Compares load, drift, both and none; None for a log with too few rows.

    Args:
        log: the model's residual, with a load's and the model's own columns.
        law: the friction coefficients behind the rows.
    """
    if len(log.rows.t) < MIN_ROWS:
        return None
    return _weighed(log, law, prior, row=0, row_log_odds=0.0)


def weigh_begin(
    log: LoadRows,
    law: CoulombViscous,
    prior: LoadPrior,
) -> LoadOrDrift | None:
    """As `weigh`, for a load that is taken up at some row, MIN_ROWS or more from both ends.

    The row is looked for in passes of PLACES_PER_PASS rows, each between the neighbours of the
    likeliest row before. Of a long log the first passes use every stride-th row, until that many
    lie between the neighbours. The last pass has successive rows; others add nothing to the
    evidence. None also where a load is less likely than none.

    Args:
        log, law, prior: as `weigh`.
    """
    count = len(log.rows.t)
    first_row, last_row = MIN_ROWS, count - MIN_ROWS
    if last_row <= first_row:
        return None
    begin, end = first_row, last_row
    stride = -(-count // FIRST_PASS_ROWS)
    while True:
        places = np.unique(np.linspace(begin, end, PLACES_PER_PASS).round().astype(int))
        if end - begin <= PLACES_PER_PASS * stride:
            stride = 1
        evidence = _begin_evidence(log, law, prior, places, stride)
        likeliest = int(np.argmax(evidence))
        if evidence[likeliest] < 0.0:
            return None
        begin = int(places[max(likeliest - 1, 0)])
        end = int(places[min(likeliest + 1, len(places) - 1)])
        if end - begin <= 2:  # the places were successive rows: nothing is left between them
            break
    weight = np.exp(evidence - evidence[likeliest])
    t = log.rows.t[places]
    mean = float(weight @ t / weight.sum())
    sd = float(np.sqrt(weight @ (t - mean) ** 2 / weight.sum()))
    row = int(places[likeliest])
    row_log_odds = np.log(weight.sum()) - np.log(last_row - first_row + 1)
    weighed = _weighed(loaded_from(log, row), law, prior, row=row, row_log_odds=float(row_log_odds))
    return replace(weighed, begin=float(log.rows.t[row]), begin_sd=sd)


def _weighed(
    log: LoadRows,
    law: CoulombViscous,
    prior: LoadPrior,
    *,
    row: int,
    row_log_odds: float,
) -> LoadOrDrift:
    """Weighs nothing, a load, drifted friction, and both, with a load from `row` on.

    Args:
        log: rows of the log; their columns of the load are zero before `row` (`loaded_from`).
        law: the friction coefficients behind the rows.
        prior: of the load; `mass` is the sd of its mass before the log, kg.
        row: index of the load's first row.
        row_log_odds: logarithm of the mean evidence of all rows that the load may begin at, over
            that of `row`; 0 where it may begin at no other.
    """
    load = estimate_load(log, law, prior)
    # Prior sds of mass, and of moments and inertia about any place of a body as heavy as the fit's.
    # Entry 0, the mass, is not the fit's but the arm's.
    load_sd = vague_spread(max(abs(load.mass), load.sd.mass))
    load_sd[0] = prior.mass
    # By hypothesis: "none", "load", "drift" and "both", a priori equally likely.
    log_evidence = _evidence(log, law, load_sd)
    for name in ("load", "both"):
        log_evidence[name] += row_log_odds
    largest = max(log_evidence.values())
    weights = {name: float(np.exp(value - largest)) for name, value in log_evidence.items()}
    total = sum(weights.values())
    mass_sd = load.sd.mass
    if load.is_present:  # else none is shown, whatever the spread between joints
        mass_sd = mass_sd_across_joints(log, law, prior, load)
    return LoadOrDrift(
        load=load,
        mass_sd=mass_sd,
        probability={name: weight / total for name, weight in weights.items()},
        is_steady=_is_steady(log, law, prior, row),
    )


def loaded_from(log: LoadRows, row: int) -> LoadRows:
    """The rows with a load from a row on."""
    load = log.load.copy()
    load[:row] = 0.0
    return replace(log, load=load)


def without_load(log: LoadRows, load: LoadEstimate) -> LoadRows:
    """The rows with the load's torque subtracted from the residual."""
    residual = log.rows.residual - log.load @ load.parameters
    return replace(log, rows=replace(log.rows, residual=residual))


def _begin_evidence(
    log: LoadRows,
    law: CoulombViscous,
    prior: LoadPrior,
    places: Array,
    stride: int,
) -> Array:
    """Log evidence (K,) of a load that is taken up at each of K rows, against no load.

    The K loads share the whitened rows. Their columns are the ten of the load from places[0] on,
    then those of the load from places[1] on, and so on; behind all loads stand the columns of every
    fit (drift, model, residual). A fit takes one load's ten, or none, and the latter.

    Args:
        log: m rows, of which log.load is (m, n, 10).
        law: the friction coefficients behind the rows.
        prior: of the load.
        places: (K,) indices of rows of `log`, of the begin of a load.
        stride: of the rows that are used; their covariance is that of what is left.
    """
    used_rows = np.arange(len(log.rows.t))[::stride]  # their indices in `log`, as `places` has them
    used = log[::stride]
    is_loaded = used_rows[:, None] >= places  # (rows, K)
    load_sd = vague_spread(prior.mass)  # (10,)
    num_loads, num_parameters = len(places), len(load_sd)

    def loads_columns(joint: int) -> Array:
        """(rows, 10 K) of a joint: the ten of the first load, then those of the next."""
        columns = is_loaded[:, :, None] * used.load[:, joint, None]  # (rows, K, 10)
        return columns.reshape(len(used_rows), num_loads * num_parameters)

    blocks, common_sd = _whitened_columns(used, law, loads_columns)
    common_columns = np.arange(num_loads * num_parameters, blocks[0].shape[1])

    def evidence(columns: NDArray[np.int64], prior_sd: Array) -> float:
        """Log evidence of a fit with some of the columns; the last one is the residual."""
        rows = [block[:, columns] for block in blocks]
        return fit_with_prior(rows, prior_sd, np.zeros(len(prior_sd))).log_evidence

    without_load = evidence(common_columns, common_sd)
    prior_sd = np.concatenate([load_sd, common_sd])
    with_load = [
        evidence(np.r_[k * num_parameters : (k + 1) * num_parameters, common_columns], prior_sd)
        for k in range(num_loads)
    ]
    return np.array(with_load) - without_load


def _whitened_columns(
    log: LoadRows, law: CoulombViscous, load_columns: Callable[[int], Array]
) -> tuple[list[Array], Array]:
    """Whitened rows of each joint, and the prior's sds of the columns that every fit may use.

    Args:
        log: m rows.
        law: the friction coefficients behind the rows.
        load_columns: gives of a joint's index the (m, L) torque per parameter of one load or more.

    Returns:
        n arrays (m, L + 3 n + c + 1), one a joint, with the columns of load, drift (3 a joint),
        model (c) and residual; and the sds (3 n + c,) of drift and model. The load's are the
        caller's.
    """
    blocks = [log.whitened(j, load_columns(j)) for j in range(log.rows.num_joints)]
    drift_sd = FrictionDrift().deviation(log.rows, law)
    return blocks, np.concatenate([drift_sd.ravel(), log.model_sd])


def _evidence(log: LoadRows, law: CoulombViscous, load_sd: Array) -> dict[str, float]:
    """Log evidence of the four, by name; load_sd (10,) of the load in the flange's frame."""
    n, num_model = log.rows.num_joints, log.model.shape[2]
    blocks, common_sd = _whitened_columns(log, law, lambda j: log.load[:, j])
    sd = np.concatenate([load_sd, common_sd])
    evidence = {}
    for loaded in (False, True):
        for drifted in (False, True):
            # Columns of load, drift and model; the model's are unknown in all four.
            is_used = np.repeat([loaded, drifted, True], [len(load_sd), NUM_DRIFTS * n, num_model])
            prior_sd = sd[is_used]
            if not is_used.any():  # none of the three: a column that the prior holds at zero
                is_used[0], prior_sd = True, np.full(1, _HELD_SD)
            columns = np.append(np.flatnonzero(is_used), -1)  # the residual is the last
            rows = [block[:, columns] for block in blocks]
            fit = fit_with_prior(rows, prior_sd, np.zeros(len(prior_sd)))
            evidence[_CAUSE_NAMES.get((loaded, drifted), "both")] = fit.log_evidence
    return evidence


def _is_steady(log: LoadRows, law: CoulombViscous, prior: LoadPrior, row: int) -> bool:
    """Whether both halves of the rows from `row` on show the same mass."""
    middle = (row + len(log.rows.t)) // 2
    masses, variances = [], []
    for part in (slice(row, middle), slice(middle, None)):
        half = estimate_load(log[part], law, prior)
        masses.append(half.mass)
        # Gains and errors of the arm's model are the same in both.
        variances.append(half.covariance[0, 0])
    return bool(abs(masses[0] - masses[1]) < MAX_MASS_DIFFERENCE * np.sqrt(sum(variances)))
