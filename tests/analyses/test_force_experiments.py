"""The four experiments of force estimation, each in a tiny run: whole results, repeatable ones.

Times are cut to a second and the identification to a known model: what is tested is what is made of
the runs. That the article's figures come out is what the studies themselves show.
"""

import json

import numpy as np
import pytest

from wrenchsight.analyses.experiments.combined import experiment as combined
from wrenchsight.analyses.experiments.friction import experiment as friction
from wrenchsight.analyses.experiments.repeat_cycle import experiment as repeat_cycle
from wrenchsight.analyses.experiments.repeat_cycle_push import experiment as repeat_cycle_push
from wrenchsight.analyses.experiments.setups.path_runs import (
    path_study,
    repeated_cycles,
)
from wrenchsight.analyses.experiments.setups.path_runs.task_runs import (
    run_task,
    task_path,
    task_scenario,
)
from wrenchsight.analyses.experiments.setups.simulated_arm.arm_models import LAWS, ArmModels
from wrenchsight.analyses.methods.simulate.simulation import known_model
from wrenchsight.analyses.output.outputs import json_text, plain_metrics
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.analyses.study.outcome import look_up
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.analyses.study.stored_result import write_result
from wrenchsight.models.identification.repetition_error import RepetitionError

MODULES = {
    module.EXPERIMENT.name: module
    for module in (repeat_cycle, repeat_cycle_push, friction, combined)
}


def known_arm(robot, seed=0, quick=False, progress=None, contact_noise=True):
    """Models without an identification: what a Coulomb-viscous law can know at best."""
    scenario = task_scenario("Combined", seed, one_way=1.0)
    model = known_model(robot, scenario)
    held_out = run_task(task_scenario("RepeatCycle", seed, one_way=0.3), robot).recording
    return ArmModels(robot, dict.fromkeys(LAWS, model), (held_out,))


def known_errors(robot, gains, *_):
    noise, n = robot.torque_per_ampere * robot.current_noise_sd, robot.num_joints
    return [RepetitionError(noise, np.eye(n), noise, np.zeros(n), gain) for gain in gains]


def run_small(name, out, monkeypatch):
    module = MODULES[name]
    if name.startswith("repeat-cycle"):
        monkeypatch.setattr(repeated_cycles, "ONE_WAY_QUICK", 0.8)
        monkeypatch.setattr(repeated_cycles, "task_path", known_path)
        monkeypatch.setattr(repeated_cycles, "repetition_errors", known_errors)
    else:
        monkeypatch.setattr(path_study, "ONE_WAY_QUICK", 0.8)
        monkeypatch.setattr(path_study, "identify_arm", known_arm)
        if name == "combined":
            monkeypatch.setattr(module, "task_path", known_path)
            optimised = known_path(None, "optimised")
            monkeypatch.setattr(module, "found_path", lambda *_, **__: optimised)
    return module.run(ExperimentContext(out=out, data=out, quick=True))


def known_path(robot, name):
    """No search for a path: its tests are elsewhere."""
    return task_path(robot, "optimised" if name == "found" else name)


# Pushed cycles share all but figures and notes with those that are not.
CASES = ["combined", "friction", "repeat-cycle"]
CASES.append(pytest.param("repeat-cycle-push", marks=pytest.mark.slow))


@pytest.fixture(scope="module", params=CASES)
def result(request, tmp_path_factory):
    out = tmp_path_factory.mktemp(request.param)
    with pytest.MonkeyPatch.context() as patch:
        metrics = run_small(request.param, out, patch)
        write_result(out, MODULES[request.param].EXPERIMENT, metrics, {}, {})
        return request.param, metrics, out


def test_the_study_knows_it_and_its_figures_exist(result):
    name, experiment_result, out = result
    assert REGISTRY.entries()[name].module == MODULES[name].__name__
    stored = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert stored["figures"]
    for figure in stored["figures"]:
        assert (out / figure["path"]).stat().st_size > 10_000
    assert all(note.strip() for note in experiment_result.notes)
    (recording,) = experiment_result.recordings
    assert (out / recording.path).read_text(encoding="utf-8").count("JCN") >= 3  # its legend


def test_every_row_of_the_comparison_is_a_finite_metric(result):
    _, experiment_result, _ = result
    metrics = plain_metrics(experiment_result.metrics)
    for row in experiment_result.comparison:
        assert np.isfinite(look_up(metrics, row.key)), row.key


def test_reductions_are_those_of_the_articles_two_variants(result):
    name, experiment_result, _ = result
    keys = (
        ("coulomb_viscous", "semi_parametric") if name == "friction" else ("initial", "optimised")
    )
    before, after = (experiment_result.metrics[key] for key in keys)
    for axis in "xyz":
        expected = 100.0 * (1.0 - after[f"rmse_{axis}_n"] / before[f"rmse_{axis}_n"])
        # The known model's laws are one: nothing falls there, and 0 is compared with 0.
        assert experiment_result.metrics[f"reduction_rmse_{axis}_pct"] == pytest.approx(
            expected, abs=1e-9
        )


def test_every_variant_states_how_often_its_bands_hold(result):
    name, experiment_result, _ = result
    for variant in MODULES[name].VARIANTS:
        variant_metrics = experiment_result.metrics[variant.key]
        for axis in "xyz":
            assert (
                0.0
                <= variant_metrics[f"share_in_68_band_{axis}"]
                <= variant_metrics[f"share_in_95_band_{axis}"]
                <= 1.0
            )
            assert (f"correlation_{axis}" in variant_metrics) == (name != "repeat-cycle")


def test_the_error_is_the_initial_paths_and_the_low_pass_takes_noise_away(result):
    name, experiment_result, _ = result
    if name == "repeat-cycle":
        metrics = experiment_result.metrics
        assert metrics["initial"]["max_error_y_n"] > metrics["optimised"]["max_error_y_n"]
        assert metrics["initial_filtered"]["rmse_y_n"] < metrics["initial"]["rmse_y_n"]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(result, tmp_path, monkeypatch):
    name, experiment_result, _ = result
    again = run_small(name, tmp_path, monkeypatch)
    assert json_text(plain_metrics(experiment_result.metrics)) == json_text(
        plain_metrics(again.metrics)
    )


def test_noise_by_time_law_grows_with_the_time_at_the_paths_ends(sts):
    table = repeat_cycle.noise_alone(sts, np.ones(6))
    order = ("ramps_of_half_a_percent", "ramps_of_a_tenth", "thirds", "uniform_acceleration")
    reductions = [table[name]["reduction_rmse_y_pct"] for name in order]
    assert sorted(reductions) == reductions
    # Independent errors: the joints' shares add up to all of it.
    assert sum(table["one_joint_alone"]["share_of_initial_variance_pct"]) == pytest.approx(100.0)
