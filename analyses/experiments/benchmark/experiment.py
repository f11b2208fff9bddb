"""Supports README, "of five methods are in the documentation".

Experiment `benchmark`: force estimation without a sensor, task by task, every method alike.

    torque      motor torque of motion that no method was fitted on
    load        force of a known payload on a moving arm
    contact     contact force along the tool, sliding and at rest, against a sensor
    detection   contacts put into free motion, hand collisions, false alarms
    touches     touches of an arm at rest, from the joint torque that it reports
    link        the link that is touched
    wrench      force from such torque, against a sensor

Methods: `arm` states what each is; `study --method` adds others (`entrants`). Metrics are
`<task>.<method>.<measure>`, with `<measure>_low` and `_high` for the least and the largest of logs,
runs, pieces, recordings or configurations, `_mean` and `_count`; of a share that is counted, for
the least and the largest that agree with the count at 95 %. A method that does not enter a task has
no key there; one that failed has `failed`.

No constant of any method was settled here. In sight of `ours` when it was settled elsewhere: see
the experiments `ur10e-trust`, `ur10e-contact`, `contact-detection`, and `docs/your-log.md`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from wrenchsight.analyses.experiments.benchmark.arm import LAWS, Ur10eArm
from wrenchsight.analyses.experiments.benchmark.contact_task import ContactTask
from wrenchsight.analyses.experiments.benchmark.data_sets import TASKS, missing
from wrenchsight.analyses.experiments.benchmark.detection_task import DetectionTask
from wrenchsight.analyses.experiments.benchmark.entrants import Entrant, FaultError
from wrenchsight.analyses.experiments.benchmark.load_task import LoadTask
from wrenchsight.analyses.experiments.benchmark.page import comparison, tables
from wrenchsight.analyses.experiments.benchmark.torque_task import TorqueTask
from wrenchsight.analyses.experiments.benchmark.touch_task import TouchTasks
from wrenchsight.analyses.experiments.benchmark.wrench_task import WrenchTask
from wrenchsight.analyses.study.experiment import Experiment, ExperimentContext, ExperimentResult

# Of a method of others: its metrics in a task; None: it does not enter that task.
Enter = Callable[[Entrant], Mapping[str, Any] | None]


def run(context: ExperimentContext) -> ExperimentResult:
    """Measures every method in every task whose recordings are there."""
    absent = {task: missing(context.data, task) for task in TASKS}
    metrics: dict[str, Any] = {}
    entered = _measured(context, [task for task in TASKS if not absent[task]], metrics)
    entrants = [Entrant(entry) for entry in context.methods]
    failures: dict[str, None] = {}
    for k, entrant in enumerate(entrants):
        for task, enter in entered.items():
            context.progress(0.85 + 0.1 * k / len(entrants), f"{entrant.name}, {task}")
            failures |= dict.fromkeys(_enter(entrant, task, enter, metrics))
    names = [entrant.name for entrant in entrants]
    return ExperimentResult(
        metrics=metrics,
        comparison=comparison(metrics, names),
        notes=NOTES,
        tables=tables(metrics, names, absent),
        failures=list(failures),
        configuration={
            "friction_laws": dict(LAWS),
            "methods": {entry.name: entry.place for entry in context.methods},
        },
    )


def _measured(
    context: ExperimentContext, tasks: Sequence[str], metrics: dict[str, Any]
) -> dict[str, Enter]:
    """Measures the benchmark's own methods in the tasks, and makes the tasks ready for others.

    Args:
        tasks: those of TASKS whose recordings are there; "link" stands for "touches" as well.
        metrics: the caller's, to which the scores are added, by task and method.

    Returns:
        By task, the function with which a method of others enters it, "link" for "touches" too.
    """
    entered: dict[str, Enter] = {}
    if "wrench" in tasks:
        context.progress(0.0, "force from joint torque")
        wrench = WrenchTask(context.data)
        metrics["wrench"], entered["wrench"] = wrench.built_in(), wrench.of
    if "link" in tasks:
        context.progress(0.03, "touches")
        touched = TouchTasks(context.data)
        metrics.update(touched.built_in())  # tasks "touches" and "link"
        entered["link"] = touched.of
    if not {"torque", "load", "contact", "detection"} & set(tasks):  # those of the UR10e
        return entered
    arm = Ur10eArm(context.data, context.part(0.05, 0.3))
    if "torque" in tasks:
        context.progress(0.3, "torque of held-out motion")
        torque = TorqueTask(arm)
        metrics["torque"], entered["torque"] = torque.built_in(), torque.of
    if "load" in tasks:
        context.progress(0.4, "force of a known load")
        load = LoadTask(arm)
        metrics["load"], entered["load"] = load.built_in(), load.of
    if "detection" in tasks:
        detection = DetectionTask(arm, context.quick)
        metrics["detection"] = detection.built_in(context.part(0.45, 0.6))
        entered["detection"] = detection.of
    if "contact" in tasks:
        contact = ContactTask(arm, context.quick, context.part(0.6, 0.7))
        metrics["contact"] = contact.built_in(context.part(0.7, 0.85))
        entered["contact"] = contact.of
    return entered


def _enter(entrant: Entrant, task: str, enter: Enter, metrics: dict[str, Any]) -> list[str]:
    """Puts a method's figures into a task's; what failed, a sentence."""
    joint = ("touches", "link") if task == "link" else (task,)
    try:
        figures = enter(entrant)
    except FaultError as fault:
        for joint_task in joint:
            metrics[joint_task][entrant.name] = {"failed": str(fault)}
        return [f"method {entrant.name} failed in task {task}: {fault}"]
    if figures is not None:
        for joint_task in joint:
            metrics[joint_task][entrant.name] = figures[joint_task] if task == "link" else figures
    return []


NOTES = (
    "Torque of held-out motion, RMSE, median of logs: <torque.ours.rmse_nm:.2f> N m (ours), "
    "<torque.article.rmse_nm:.2f> (article), "
    "<torque.plain_tools.rmse_nm:.2f> (plain tools), <torque.plain.rmse_nm:.2f> (target currents).",
    "Force of a known load, RMSE, median of pieces of 5 s: <load.ours.rmse_n:.1f> N (ours), "
    "<load.kalman.rmse_n:.1f> (Kalman), "
    "<load.article.rmse_n:.1f> (article), <load.plain_tools.rmse_n:.1f> (plain tools), "
    "<load.plain.rmse_n:.1f> (target currents).",
    "Contact force, RMSE in slides and at rest, mean of runs: <contact.ours.slide_rmse_n_mean:.1f> "
    "and <contact.ours.rest_rmse_n_mean:.1f> N (ours), <contact.kalman.slide_rmse_n_mean:.1f> and "
    "<contact.kalman.rest_rmse_n_mean:.1f> (Kalman), <contact.article.slide_rmse_n_mean:.1f> and "
    "<contact.article.rest_rmse_n_mean:.1f> (article), <contact.plain.slide_rmse_n_mean:.1f> and "
    "<contact.plain.rest_rmse_n_mean:.1f> (target currents).",
    "Pushes of 30 N missed: <detection.ours.pushes_missed_pct:.1f> % at "
    "<detection.ours.false_alarms:.0f> false alarms (ours), "
    "<detection.plain_tools.pushes_missed_pct:.1f> % at "
    "<detection.plain_tools.false_alarms:.0f> (plain tools).",
    "Labelled link among those named: <link.ours.named_pct_mean:.1f> % (ours), "
    "<link.plain.named_pct_mean:.1f> % (last loaded joint).",
    "Force from reported joint torque, RMSE, mean of configurations: "
    "<wrench.ours.rmse_n_mean:.2f> N (ours), <wrench.article.rmse_n_mean:.2f> (article), "
    "<wrench.plain_tools.rmse_n_mean:.2f> (plain tools).",
)


EXPERIMENT = Experiment(
    name="benchmark",
    title="A benchmark of force estimation without a sensor",
    section="recordings of two UR10e and two Panda",
    run=run,
    uses=("ur10e", "ur10e_more", "ur10e_contact", "panda_ati_gamma", "link_contact"),
    takes_methods=True,
    order=195,
    seconds=80,
)
