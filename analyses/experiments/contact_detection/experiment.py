"""Supports docs/external-torque.md, "The 152 touches by the odds of the likeliest link".

Experiment `contact-detection`: contacts found, contacts missed, false alarms at a stated rate.

The model and the noise of its statistic come from the UR10e's three fitted runs. Judged are:

- false alarms in contact-free logs of other weeks and motions;
- pushes put into these logs, at E and off it (`contact_trials`);
- a log of hand collisions, and one of pushes on the arm at rest;
- a simulated arm that is pushed while it moves.

Further logs count for false alarms alone: motions of one joint at a time, static postures, a log of
seven weeks before, the fitted runs (each read by a model of the other two), and hours of simulated
twins of all these motions
(`wrenchsight.analyses.experiments.contact_detection.contact_free_twins`).

In sight when the statistic was settled: the fitted runs, 15harm50sec, 10harm and those of joints 1,
3 and 5; the stop that ends 7harm (the rule for jumps of motor torque); the pushes at rest (the rule
for rest); the stops of the logs of joints 1 and 2, simulated (the rule for a joint that stops).

Nobody labelled the collisions. COLLISION_TIMES are the stretches in which the current of joints 1
to 3 differs from that of `collision_free` at the same place of the path by far more than elsewhere.
"""

from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.data_sets.places import data_set_folder
from wrenchsight.analyses.experiments.contact_detection.contact_free_twins import (
    alarms_of_twins,
    model_of_twins,
)
from wrenchsight.analyses.experiments.contact_detection.touched_links import (
    link_metrics,
    odds_figure,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.simulated_identification import (
    identify_simulated_arm,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_trials import (
    COLLISION_LOG,
    COLLISION_TIMES,
    FALSE_ALARM_RATE,
    FREE_MOTION_LOGS,
    NUM_ROUNDS,
    OLDER_LOGS,
    REST_LOGS,
    SINGLE_JOINT_LOGS,
    TIME_STEP,
    Tally,
    TrialLog,
    false_alarm_metrics,
    jacobian_on_link,
    onsets,
    put_in,
    samples_of,
    spans_of,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    FITTED_LOGS,
    FOLDER,
    log_file,
    presliding_arm,
)
from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.simulate.fast_runs import run_free
from wrenchsight.analyses.methods.simulate.simulated_logs import (
    ROBOT,
    TRACKING_CONFIG,
    stored_excitation,
)
from wrenchsight.analyses.output.figures import SERIES, Figure, new_figure
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.control.wrench_script import WrenchStep
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

PUSHES = "ur10e_pushes"
TWIN_DAYS = 3
FALSE_ALARM_RATES = (0.1, 1.0, 10.0, 60.0, 360.0)  # for the threshold
PUSH_FORCES = (5.0, 10.0, 20.0, 30.0, 60.0)  # N
PUSH_TIMES = (0.1, 0.5, 2.0)  # s
SIMULATED_FORCES = (10.0, 30.0)  # N
SIMULATED_DURATION = 0.5  # s
PUSH_STARTS = (2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0)  # s
SIMULATED_STEP = 1e-3  # s
NO_CONTACTS = {"contacts": 0, "missed": 0, "delay_median_s": None, "delay_max_s": None}
JUDGED = "push_30n_500ms_at_e"
_AFTER_CONTACT = 1.0  # s after a labelled contact in which an alarm is still its own


def run(context: ExperimentContext) -> ExperimentResult:
    """Identifies, reads every log, puts pushes in, and counts.

    Pushes are put into the logs of FREE_MOTION_LOGS alone; false alarms are counted in all logs,
    the fitted ones included (each read by a model of the others).

    Metrics: `levels`; false alarms by log and `contact_free`; pushes by `push_key` and by link;
    `threshold_..._per_hour`; `collision_wrist` and `push_pose_1`, whose contacts are labelled;
    `simulated_...`; `link_contact`.
    """
    robot, model = presliding_arm(context, 0.2)
    rounds = 1 if context.quick else NUM_ROUNDS
    recordings = {
        name: read_recording(log_file(context.data, Path(file).stem), robot=robot)
        for name, file in (FREE_MOTION_LOGS | SINGLE_JOINT_LOGS | OLDER_LOGS | REST_LOGS).items()
    }
    all_logs = {name: TrialLog(recording, robot, model) for name, recording in recordings.items()}
    pushed_logs = {name: all_logs[name] for name in FREE_MOTION_LOGS}
    ur10e = data_set_folder(FOLDER, context.data)
    fitted = [read_recording(ur10e / name, robot=robot) for name in FITTED_LOGS]
    all_logs |= _held_out(fitted, robot, context)
    metrics: dict[str, Any] = {"levels": _levels(pushed_logs)}
    context.progress(0.35, "contact-free logs")
    metrics |= _free(all_logs)
    metrics |= _push_metrics(pushed_logs, rounds, context.part(0.4, 0.7))
    for rate in FALSE_ALARM_RATES:
        metrics[f"threshold_{rate:g}_per_hour"] = _at_rate(all_logs, pushed_logs, rate, rounds)
    context.progress(0.7, "hand collisions")
    metrics["collision_wrist"] = _labelled(
        log_file(context.data, Path(COLLISION_LOG).stem), COLLISION_TIMES, robot, model
    )
    push_folder = data_set_folder(PUSHES, context.data)
    pushes = np.genfromtxt(push_folder / "pushes.csv", delimiter=",", names=True)
    spans = tuple((float(row["t_start"]), float(row["t_end"])) for row in pushes)
    metrics["push_pose_1"] = _labelled(push_folder / "push_pose_1.csv", spans, robot, model)
    context.progress(0.72, "simulated days")
    moving = {name: entry for name, entry in recordings.items() if name not in REST_LOGS}
    metrics |= _twins(fitted, moving, robot, context)
    context.progress(0.75, "simulated pushes")
    metrics |= _simulated()
    context.progress(0.95, "touches of a Panda, link by link")
    metrics["link_contact"] = link_metrics(context.data)
    return ExperimentResult(
        metrics=metrics,
        figures=[
            (
                "contact-detection",
                _figure(metrics),
                "Pushes missed by size; false alarms counted against those stated.",
            ),
            (
                "link-odds",
                odds_figure(metrics["link_contact"]),
                "Labelled touches of a Panda: odds of the likeliest link against how often it is "
                "the touched one; numbers are touches of recordings.",
            ),
        ],
        comparison=_comparison(),
        notes=NOTES,
    )


OFF_E = (2, 3, 4)  # a force on link 5, by the next joint's axis, is one at E
# Links, in turn, on which pushes act; none: at E
PUSHED_LINKS: dict[str, tuple[int, ...]] = {"at_e": (), "off_e": OFF_E}


def push_key(size: float, duration: float, place: str) -> str:
    """Key of the metrics of pushes of `size` N for `duration` s at one of PUSHED_LINKS."""
    return f"push_{size:g}n_{1e3 * duration:g}ms_{place}"


def _levels(logs: dict[str, TrialLog]) -> dict[str, float]:
    levels = next(iter(logs.values())).detector(FALSE_ALARM_RATE).levels
    return dict(levels._asdict())


def _free(logs: dict[str, TrialLog]) -> dict[str, Any]:
    """False alarms of contact-free logs, by log and together."""
    result: dict[str, Any] = {}
    alarms, hours = 0, 0.0
    for name, log in logs.items():
        detection = log.detect(log.detector(FALSE_ALARM_RATE))
        begins = onsets(detection.contact)
        result[name] = {
            **NO_CONTACTS,
            **false_alarm_metrics(len(begins), log.hours),
            "at_s": log.t[begins],
            "largest_statistic": float(detection.statistic.max()),
            "contact_pct": 100.0 * float(detection.contact.mean()),
        }
        alarms += len(begins)
        hours += log.hours
    return {**result, "contact_free": {**NO_CONTACTS, **false_alarm_metrics(alarms, hours)}}


def _held_out(
    fitted: list[Recording], robot: Robot, context: ExperimentContext
) -> dict[str, TrialLog]:
    """False alarms of the fitted runs, each read by the model of the other two."""
    logs = {}
    for k, entry in enumerate(fitted):
        context.progress(0.2 + 0.05 * k, "identifying without one run")
        others = fitted[:k] + fitted[k + 1 :]
        model = identify(others, robot, [], IdentificationConfig(friction="presliding")).model
        logs[Path(FITTED_LOGS[k]).stem] = TrialLog(entry, robot, model)
    return logs


def _twins(
    fitted: list[Recording], moving: dict[str, Recording], robot: Robot, context: ExperimentContext
) -> dict[str, Any]:
    """False alarms in simulated hours of the same motions."""
    days = 1 if context.quick else TWIN_DAYS
    model = model_of_twins(fitted, robot)
    alarms = alarms_of_twins(moving, robot, model, FALSE_ALARM_RATES[1:], days)
    result: dict[str, Any] = {
        f"at_{rate:g}_per_hour": {
            **false_alarm_metrics(count, alarms.hours),
            "expected": rate * alarms.hours,
        }
        for rate, count in alarms.by_rate.items()
    }
    by_log_key = f"by_log_at_{FALSE_ALARM_RATE:g}_per_hour"
    return {"simulated_days": {**result, by_log_key: alarms.by_log}}


def _push_metrics(
    logs: dict[str, TrialLog], rounds: int, progress: ProgressCallback
) -> dict[str, Any]:
    """Pushes of every size, duration and place, by `push_key`; and of 30 N by each link off E."""
    metrics: dict[str, Any] = {}
    kinds_of_push = [  # N, s, key of PUSHED_LINKS
        (size, duration, place)
        for size in PUSH_FORCES
        for duration in PUSH_TIMES
        for place in PUSHED_LINKS
    ]
    for k, (size, duration, place) in enumerate(kinds_of_push):
        progress(k / len(kinds_of_push), f"pushes of {size:g} N")
        tally = _pushed(logs, size, duration, PUSHED_LINKS[place], FALSE_ALARM_RATE, rounds)
        metrics[push_key(size, duration, place)] = tally.metrics()
    for link in OFF_E:
        tally = _pushed(
            logs, size=30.0, duration=0.5, links=(link,), rate=FALSE_ALARM_RATE, rounds=rounds
        )
        metrics[f"link_{link}_30n"] = tally.metrics()
    return metrics


def _pushed(
    logs: dict[str, TrialLog],
    size: float,
    duration: float,
    links: tuple[int, ...],
    rate: float,
    rounds: int,
) -> Tally:
    """Puts pushes into logs of free motion and looks for them.

    Args:
        size: N.
        duration: s.
        links: by turns the link that they act on, 1 to n; empty: at E.
        rate: false alarms an hour of the detector.
        rounds: how often each log is pushed, elsewhere and in other directions each time.
    """
    tally = Tally()
    for number, log in enumerate(logs.values()):
        detector = log.detector(rate)
        for turn in range(rounds):
            # The same directions for every size, so that sizes are compared push by push.
            rng = np.random.default_rng((number, turn))
            pushes = spans_of(log.v, duration, turn)  # first sample, and the one after the last
            link = links[(number + turn) % len(links)] if links else None
            J = log.J[:, 3:] if link is None else jacobian_on_link(log.J, link)
            detection = log.detect(detector, put_in(pushes, J, size, rng))
            for begin, end in pushes:
                tally.add(detection, begin, end, TIME_STEP, link)
    return tally


def _at_rate(
    every: dict[str, TrialLog], logs: dict[str, TrialLog], rate: float, rounds: int
) -> dict[str, Any]:
    """False alarms and pushes of 30 N and 10 N for half a second, at another threshold."""
    result = {name: len(log.alarms(rate)) for name, log in every.items()}
    hours = sum(log.hours for log in every.values())
    alarms = {
        **false_alarm_metrics(sum(result.values()), hours),
        "expected": rate * hours,
        "by_log": result,
    }
    for size in (10.0, 30.0):
        pushed = _pushed(logs, size, 0.5, PUSHED_LINKS["at_e"], rate, rounds).metrics()
        alarms[f"missed_pct_{size:g}n"] = pushed["missed_pct"]
        for key in ("delay_median_s", "delay_p95_s", "within_50ms_pct"):
            alarms[f"{key}_{size:g}n"] = pushed[key]
    return alarms


def _labelled(
    file: Path,
    spans: tuple[tuple[float, float], ...],
    robot: Robot,
    model: IdentifiedModel,
) -> dict[str, Any]:
    """A log that holds contacts, whose links are not known; delays are from the labels.

    False alarms are those that begin apart from the labelled contacts: not within one, nor within
    _AFTER_CONTACT after it. Where the arm is free, what is valid and how large a force it reads is
    stated as well. Lists with `_each` have an entry a contact that was detected, false ones too;
    the tally's own counts of links and misfits are left out, as no label tells a link.

    Args:
        file: the log; a recording.yaml beside it describes its columns, where there is one.
        spans: s, begin and end of the labelled contacts, by the log's clock.
    """
    description = file.with_name("recording.yaml")
    recording = read_recording(file, description if description.exists() else None, robot)
    log = TrialLog(recording, robot, model)
    detection = log.detect(log.detector(FALSE_ALARM_RATE))
    tally = Tally()
    is_free = np.ones(len(log.t), bool)
    for begin, end in samples_of(spans, log.t):
        tally.add(detection, begin, end, TIME_STEP, link=None)
        is_free[begin : end + round(_AFTER_CONTACT / TIME_STEP)] = False
    contacts = stretches(detection.contact)  # that were detected
    begins = onsets(detection.contact)  # their first samples
    false_begins = begins[is_free[begins]]
    counted = tally.metrics()
    # The readings themselves: `detect` only judges them.
    batch = log.estimator.run(log.estimator.initial_state(), log.q, log.v, log.current)
    false_force = np.abs(batch.wrench[is_free & batch.valid, 3:])
    return {
        **{key: counted[key] for key in counted if not key.startswith(("link", "misfit"))},
        "misfit_pct_each": [100.0 * float(detection.misfit[rows].mean()) for rows in contacts],
        # The link named most often, 1 to n; 0: none.
        "link_each": [int(np.bincount(detection.link[rows]).argmax()) for rows in contacts],
        **false_alarm_metrics(len(false_begins), float(is_free.sum()) * TIME_STEP / 3600.0),
        "found_at_s": log.t[begins],
        "false_alarms_at_s": log.t[false_begins],
        "valid_between_pct": 100.0 * float(batch.valid[is_free].mean()),
        "invalid_between": invalid_pct(batch.invalid[is_free]),
        "largest_valid_between_n": false_force.max(axis=0) if len(false_force) else np.zeros(3),
        "largest_statistic": float(detection.statistic.max()),
    }


def _pushed_at_E(robot: Robot, force: float) -> Recording:
    """A log of the simulated arm, pushed at E along its second excitation.

    Args:
        force: N, of each push, for SIMULATED_DURATION in a random direction.
    """
    rng = np.random.default_rng(17)
    directions = rng.normal(size=(len(PUSH_STARTS), 3))
    forces = [(force * d / np.linalg.norm(d)).tolist() for d in directions]
    trajectory = stored_excitation(robot, 2).joint_trajectory(2)
    scenario = Scenario(
        robot=robot.name,
        duration=trajectory.duration,
        seed=23,
        controller=TRACKING_CONFIG,
        wrench=[
            WrenchStep(start, SIMULATED_DURATION, push)
            for start, push in zip(PUSH_STARTS, forces, strict=True)
        ],
    )
    t, signals = run_free(scenario, robot, IdentifiedModel.nominal(robot), trajectory)
    return Recording(
        t=t, q=signals["q"], v=signals["v"], current=signals["current"], source="pushed"
    )


def _simulated() -> dict[str, Any]:
    """The simulated arm is pushed at E along its second excitation, and once left alone."""
    robot = Robot.load(ROBOT)
    config = IdentificationConfig(cutoff=7.5, friction="presliding")
    result, logs = identify_simulated_arm(robot, config=config)
    model = result.model
    free = TrialLog(logs[1].recording, robot, model, SIMULATED_STEP)
    alarms = free.alarms(FALSE_ALARM_RATE)
    outcome: dict[str, Any] = {
        "simulated_free": {**NO_CONTACTS, **false_alarm_metrics(len(alarms), free.hours)}
    }
    for size in SIMULATED_FORCES:
        log = TrialLog(_pushed_at_E(robot, size), robot, model, SIMULATED_STEP)
        detection = log.detect(log.detector(FALSE_ALARM_RATE))
        tally = Tally()
        num_samples = round(SIMULATED_DURATION / SIMULATED_STEP)  # of a push
        for start in PUSH_STARTS:
            begin = round(start / SIMULATED_STEP)
            tally.add(detection, begin, begin + num_samples, SIMULATED_STEP, None)
        outcome[f"simulated_{size:g}n_{1e3 * SIMULATED_DURATION:g}ms"] = tally.metrics()
    return outcome


def _comparison() -> list[ComparisonRow]:
    sample_remark = "includes up to one sample of 10 ms before the first that shows the push"
    rate_remark = "minutes of data at one alarm an hour could contradict the rate, not confirm it"
    rows = (
        ("30 N for .5 s put in, missed", f"{JUDGED}.missed_pct", 0.0, ""),
        ("their delay, median", f"{JUDGED}.delay_median_s", 0.05, sample_remark),
        ("found within 50 ms", f"{JUDGED}.within_50ms_pct", 100.0, ""),
        ("hand collisions, missed", "collision_wrist.missed", 0.0, ""),
        ("contact-free logs, false alarms", "contact_free.false_alarms", 0.0, rate_remark),
    )
    return [ComparisonRow(*row, "wanted") for row in rows]


def _figure(metrics: dict[str, Any]) -> Figure:
    figure, ((pushes, alarms),) = new_figure(1, 2, height=3.4)
    for k, duration in enumerate(PUSH_TIMES):
        for place, style in zip(PUSHED_LINKS, ("-", "--"), strict=True):
            missed = [
                metrics[push_key(size, duration, place)]["missed_pct"] for size in PUSH_FORCES
            ]
            label = f"{duration:g} s, {place.replace('_e', ' E')}"
            pushes.plot(PUSH_FORCES, missed, style, marker="o", ms=3, color=SERIES[k], label=label)
    pushes.set_xlabel("force [N]")
    pushes.set_ylabel("missed [%]")
    counted = [metrics[f"threshold_{rate:g}_per_hour"] for rate in FALSE_ALARM_RATES]
    alarms.loglog(FALSE_ALARM_RATES, FALSE_ALARM_RATES, color=SERIES[6], lw=0.8, label="as stated")
    for key, marker, label in (("", "o", "counted"), ("_upper", "v", "most that agrees (95 %)")):
        result = [entry[f"false_alarms_per_hour{key}"] or np.nan for entry in counted]
        alarms.loglog(FALSE_ALARM_RATES, result, marker, label=label)
    alarms.set_xlabel("stated false alarms per hour")
    alarms.set_ylabel(f"in {60 * metrics['contact_free']['hours']:.1f} free minutes, per h")
    for panel in (pushes, alarms):
        panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


NOTES = (
    f"At {FALSE_ALARM_RATE:g} false alarm an hour: <contact_free.false_alarms:.0f> in "
    "<contact_free.hours:60 .1f> contact-free minutes, which agrees with up to "
    "<contact_free.false_alarms_per_hour_upper:.0f> an hour.",
    f"Pushes of 30 N for 0.5 s at E while moving: <{JUDGED}.missed:.0f> of <{JUDGED}.contacts:.0f> "
    f"missed, delay <{JUDGED}.delay_median_s:1e3 .0f> ms in the median, "
    f"<{JUDGED}.delay_p95_s:1e3 .0f> ms in 95 %, <{JUDGED}.delay_max_s:1e3 .0f> ms at most.",
    "False alarms at other stated rates: "
    + "; ".join(
        f"<threshold_{rate:g}_per_hour.false_alarms:.0f> "
        f"(<threshold_{rate:g}_per_hour.expected:.1f> expected) at {rate:g} an hour"
        for rate in FALSE_ALARM_RATES
    )
    + "; simulated: "
    + "; ".join(
        f"<simulated_days.at_{rate:g}_per_hour.false_alarms:.0f> "
        f"(<simulated_days.at_{rate:g}_per_hour.expected:.1f> expected) at {rate:g}"
        for rate in FALSE_ALARM_RATES[1:]
    )
    + ".",
    "Pushes of 30 N for 0.5 s off E recognised as off E: "
    + "; ".join(f"link {link} <link_{link}_30n.misfit_pct:.0f> %" for link in OFF_E)
    + ".",
    "Missed: <collision_wrist.missed:.0f> of <collision_wrist.contacts:.0f> hand collisions, "
    "<push_pose_1.missed:.0f> of <push_pose_1.contacts:.0f> pushes at rest; false alarms "
    "<collision_wrist.false_alarms:.0f> and <push_pose_1.false_alarms:.0f>.",
    "Touches of a Panda: <link_contact.missed:.0f> missed, <link_contact.false_alarms:.0f> false; "
    "the touched link is named in <link_contact.named_pct:.0f> %. Where the likeliest link is "
    "stated with 85 % and more (<link_contact.sure.stated_pct:.0f> % in the mean) it is the "
    "touched one in <link_contact.sure.right_pct:.0f> % of <link_contact.sure.touches:.0f> touches "
    "of <link_contact.sure.recordings:.0f> recordings; over all touches what is stated is off by "
    "<link_contact.calibration_error_pct:.0f> %.",
)


EXPERIMENT = Experiment(
    name="contact-detection",
    title="Contact detection: missed contacts and false alarms",
    section="recordings of a UR10e",
    run=run,
    needs=("ur10e", "ur10e_more", "ur10e_pushes", "link_contact"),
    order=157,
    seconds=300,
)
