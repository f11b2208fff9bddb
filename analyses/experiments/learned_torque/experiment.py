"""Experiment `learned-torque`: a recurrent network in the place of a model, or on top of one.

A network learns the torque of contact-free motion from the last half second of q and v; the
residual is read as contact (`recurrent_network`). It is compared with an identified model that has
the friction law of `identify --friction best`, and put on top of it (`hybrid`).
`torque_predictors` filters and reads all alike; `arms` states which log is fitted and which judged.

ur10e          fitted on the three runs, judged on every other contact-free motion and two loads
ur10e_weeks    fitted on these and all free motion of the weeks before (the network alone also where
               one joint moves at a time: ten minutes and more), judged on the week after
ur10e_same_motion  fitted on the three runs and the motion without its load, judged with it,
               as far as it was trained
ur10e_contact  another UR10e against a force sensor
lara8          each of a LARA 8's logs predicted from the others, a sensor's loads taken off
amount         a quarter, half and all of the three runs, and all weeks, over the week after
range          the first of these, where q and v lie within what the three runs have, and beyond

`<method>.held_out_rmse_nm` pools the motions of other weeks; `zero` predicts no torque at all. The
Panda's recordings hold no motion without contact. Sizes and training were settled by leaving each
of the three runs out in turn; the friction law's form was chosen long ago, with 14harm50sec and
ptp_10_points in sight.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from wrenchsight.analyses.data_sets.places import find_data_set
from wrenchsight.analyses.experiments.learned_torque.arms import (
    AMOUNTS,
    FREE,
    LATER,
    REPEATED,
    SAME_WEEK,
    THREE,
    WEEKS,
    Ur10e,
    contact_errors,
    lara8_errors,
)
from wrenchsight.analyses.experiments.setups.torque_networks.torque_predictors import (
    ALONE,
    HELD_OUT,
    METHODS,
    ON_MODEL,
    Errors,
    Judged,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.log_figures import bar_rows
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    LOADED,
    LOADED_LOGS,
)
from wrenchsight.analyses.methods.identify.torque_fit import rms
from wrenchsight.analyses.output.figures import Figure
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)

ByMethod = Mapping[str, Errors]
LOAD: Final = LOADED.removesuffix(".csv")
CONTACT: Final = "ur10e_contact"  # the set, which its metrics go by as well
LAW_FROM: Final = 0.9  # times the model's error, from which on the hybrid would be a law
LABELS: Final = {"model": "model", "network": "network alone", "hybrid": "network on the model"}


def run(context: ExperimentContext) -> ExperimentResult:
    """Trains every predictor, and judges it on what it was not trained on."""

    arm = Ur10e(context.data, context.seed, context.quick, context.part(0.0, 0.7))
    three, all_weeks = arm.predictors[THREE], arm.predictors[WEEKS]
    free = {name: arm.free(name, THREE) for name in FREE}
    errors = {name: three.errors(judged) for name, judged in free.items()}
    loads = {name: three.errors(arm.loaded(name, THREE)) for name in LOADED_LOGS}
    later = {name: all_weeks.errors(arm.free(name, WEEKS)) for name in LATER}
    later[LOAD] = all_weeks.errors(arm.loaded(LOAD, WEEKS))
    again = arm.loaded(LOAD, REPEATED)
    again = again.narrowed(np.arange(len(again.rows)) < (0.95 - HELD_OUT) * len(again.rows))
    repeated = arm.predictors[REPEATED].errors(again)  # of what was trained without the load
    others = [name for name in free if name != SAME_WEEK]
    torque = [free[name].log.motion.torque[free[name].rows] for name in others]
    context.progress(0.75, "in contact")
    has_contact = find_data_set(CONTACT, context.data) is not None
    contact = contact_errors(context.data, arm) if has_contact else {}
    context.progress(0.85, "LARA 8")
    lara8 = lara8_errors(context.data, context.seed, context.quick)
    metrics: dict[str, Any] = {
        **_held_out([errors[name] for name in others]),
        "zero": {"held_out_rmse_nm": rms(np.concatenate(torque))},
        "ur10e": _metrics(errors | loads),
        "ur10e_weeks": _metrics(later),
        "ur10e_same_motion": _metrics({LOAD: repeated}),
        **({CONTACT: _metrics(contact)} if has_contact else {}),
        "lara8": _metrics(lara8) | {"all": _held_out(list(lara8.values()))},
        "amount": {
            amount: {"fitted_s": arm.seconds[amount]}
            | _held_out([arm.predictors[amount].errors(arm.free(name, amount)) for name in LATER])
            for amount in (*AMOUNTS, WEEKS)
        },
        "range": _by_range(arm, [free[name] for name in others]),
    }
    caption = (
        "Torque error by the motion (s) that was fitted, and over samples within and beyond its "
        "range: geometric mean of the joints."
    )
    return ExperimentResult(
        metrics=metrics,
        figures=[("errors", _figure(metrics), caption)],
        comparison=[row for row in _comparison() if has_contact or CONTACT not in row.key],
        notes=[note for note in NOTES if has_contact or CONTACT not in note],
        configuration={
            "alone": asdict(ALONE),
            "on_model": asdict(ON_MODEL),
            "fitted_s": arm.seconds,
            "other_weeks": others,
        },
    )


def _metrics(errors: Mapping[str, ByMethod]) -> dict[str, Any]:
    return {name: {m: error.metrics() for m, error in log.items()} for name, log in errors.items()}


def _held_out(parts: Sequence[ByMethod]) -> dict[str, dict[str, Any]]:
    """By method, of several logs together."""
    pooled = {method: Errors.pooled([part[method] for part in parts]) for method in METHODS}
    reference = rms(pooled["model"].torque)
    return {
        method: {
            "held_out_rmse_nm": rms(error.torque),
            "held_out_rmse_n": rms(error.force),
            "times_model": _mean_ratio(rms(error.torque), reference),
        }
        for method, error in pooled.items()
    }


def _mean_ratio(errors: Any, reference: Any) -> float:
    """Geometric mean over the joints."""
    return float(np.exp(np.mean(np.log(np.asarray(errors) / np.asarray(reference)))))


def _by_range(arm: Ur10e, logs: Sequence[Judged]) -> dict[str, Any]:
    metrics: dict[str, Any] = {}
    for key, within in (("inside", True), ("beyond", False)):
        parts = [judged.narrowed(arm.inside(judged) == within) for judged in logs]
        errors = [arm.predictors[THREE].errors(part) for part in parts]
        samples = sum(int(part.rows.sum()) for part in parts)
        metrics[key] = {"samples": samples} | _held_out(errors)
    return metrics


def _figure(metrics: Mapping[str, Any]) -> Figure:
    groups = metrics["amount"] | metrics["range"]
    names = [
        f"{name.replace('_', ' ')}, {group.get('fitted_s', group.get('samples')):.0f}"
        for name, group in groups.items()
    ]
    series = {
        label: [_mean_ratio(group[method]["held_out_rmse_nm"], 1.0) for group in groups.values()]
        for method, label in LABELS.items()
    }
    figure = bar_rows({"torque RMSE [N m]": series}, names)
    figure.axes[0].set_yscale("log")
    return figure


def _comparison() -> list[ComparisonRow]:
    rows = [
        ComparisonRow(
            f"Torque RMSE over motions of other weeks, {words}, joints 1 to 6",
            f"{method}.held_out_rmse_nm",
        )
        for method, words in LABELS.items()
    ]
    rows.append(
        ComparisonRow(
            "Torque error over motions of other weeks, a network on the model over the model alone",
            "hybrid.times_model",
            LAW_FROM,
            "the model's residual does not repeat in other motions",
            "wanted of a law",
        )
    )
    rows += [
        ComparisonRow(
            f"Force along the tool while it slides, {words}: RMSE",
            f"{CONTACT}.slide.{method}.rmse_n.0",
        )
        for method, words in LABELS.items()
    ]
    return rows


def _each(key: str, form: str) -> str:
    return ", ".join(f"<{key.replace('*', m)}:{form}> ({LABELS[m]})" for m in METHODS)


NOTES: Final = (
    "Torque over motions of other weeks, joints 1 to 6, fitted on two minutes: "
    f"{_each('*.held_out_rmse_nm', '.2f')} N m; no torque at all <zero.held_out_rmse_nm:.1f>. "
    "Times the model's error: network alone <network.times_model:.1f>, on the model "
    f"<hybrid.times_model:.3f>. Below {LAW_FROM:g} it would be a law of `identify --friction`.",
    "Over the week after, fitted on all weeks before (the network alone on "
    f"<amount.{WEEKS}.fitted_s:.0f> s): {_each(f'amount.{WEEKS}.*.held_out_rmse_nm', '.2f')} N m; "
    f"on <amount.quarter.fitted_s:.0f> s: {_each('amount.quarter.*.held_out_rmse_nm', '.2f')} N m.",
    "Samples whose position and velocity the three runs hold, joint by joint: "
    f"{_each('range.inside.*.held_out_rmse_nm', '.2f')} N m; the others: "
    f"{_each('range.beyond.*.held_out_rmse_nm', '.2f')} N m.",
    f"Force at a load of 2.805 kg, x y z: {_each(f'ur10e.{LOAD}.*.rmse_n', '.1f')} N. With the "
    "same motion, without the load and of the same day, among what was fitted, over its first "
    "four fifths: "
    f"{_each(f'ur10e_same_motion.{LOAD}.*.rmse_n', '.1f')} N.",
    "Force along the tool against the sensor, first hold, slide, second hold: "
    + "; ".join(
        f"{LABELS[m]} "
        + " ".join(f"<{CONTACT}.{i}.{m}.rmse_n.0:.1f>" for i in ("hold1", "slide", "hold2"))
        for m in METHODS
    )
    + " N. No observer, no prior; the runs' air motion of .6 s is too short to train on.",
    "LARA 8, each log from the others, some 12 s: "
    f"{_each('lara8.all.*.held_out_rmse_nm', '.1f')} N m. The Panda's recordings hold no motion "
    "without contact.",
)


EXPERIMENT = Experiment(
    name="learned-torque",
    title="Recurrent network instead of the model, and on top of it",
    section="recordings of a UR10e and of a NEURA LARA 8",
    run=run,
    needs=("ur10e", "ur10e_more", "neura_lara8", "neura_lara8_urdf"),
    uses=("ur10e_contact",),
    order=158,
    seconds=180.0,
)
