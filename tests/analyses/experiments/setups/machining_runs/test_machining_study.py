"""What the studies of machining run, and with what: the runs themselves are made up."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.analyses.experiments.grinding import experiment as grinding
from wrenchsight.analyses.experiments.polishing import experiment as polishing
from wrenchsight.analyses.experiments.setups.machining_runs import machining_study as module
from wrenchsight.analyses.experiments.setups.machining_runs.machining import (
    FEED_TIMES,
    FEEDBACKS,
    OURS,
    READINGS,
    feed_key,
)
from wrenchsight.analyses.methods.simulate.air_pass import LearntCorrection
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.analyses.study.wording import filled
from wrenchsight.diagrams.scenario import load_scenario

EXPERIMENTS = (polishing.EXPERIMENT, grinding.EXPERIMENT)


def figures_of(feed):
    """As `feed_metrics` names them; every number is the feed."""
    ways = {"correlation": feed}
    return {
        name: {"correlation": feed, "rmse_n": feed, "within_ways": ways} for name in READINGS
    } | {
        "regulation": {name: {"rms_n": feed, "median_n": feed} for name in FEEDBACKS},
        "valid_share": {name: {"steady": feed} for name in FEEDBACKS},
        "band": _band_of(feed, ("steady", "ends", "turns", "all")),
        "band_of_valid": _band_of(feed, ("steady", "turns")),  # no valid reading at the ends
    }


def _band_of(feed, parts):
    return {
        feedback: {part: {"x": share, "y": 2.0 * share, "z": 3.0 * share} for part in parts}
        for feedback, share in (("sensor", feed), ("estimate", 10.0 * feed))
    }


@pytest.fixture
def studied(monkeypatch, tmp_path):
    """Runs an experiment with another arm in the place of the simulated one.

    Returns the result, the runs asked for one by one, and the shares told. A plan, a lesson and a
    run stand for the feed that they were made for.
    """

    def study(experiment, steady=True, **given):
        runs, corrections, shares = [], [], []

        def learnt(scenario, robot, model, plan, seed):
            assert model == "the model of ours" and plan == scenario.machining.one_way
            corrections.append(seed)
            return LearntCorrection(plan, plan)

        def ran(scenario, models, plan, air_pass, reads, page, progress):
            progress(0.5, "half")
            # Both feedbacks of a feed are given its plan and its correction.
            assert plan == air_pass == reads == scenario.machining.one_way
            runs.append((scenario, page))
            return SimpleNamespace(steady=np.full(3, steady), fault=0, feed=plan)

        def measured(task, runs_by_feedback, readings):
            assert (
                list(runs_by_feedback) == list(FEEDBACKS)
                and readings == runs_by_feedback["sensor"].feed
            )
            return figures_of(readings)

        def drawn(task, shown, without, metrics):
            assert list(shown) == list(without) == list(FEED_TIMES)
            return ["figures"]

        arm = SimpleNamespace(models={OURS: "the model of ours"}, robot="the arm")
        monkeypatch.setattr(module, "identify_arm", lambda *_: arm)
        monkeypatch.setattr(
            module, "make_machining_path", lambda scenario, robot: scenario.machining.one_way
        )
        monkeypatch.setattr(module, "learn_air_passes", learnt)
        monkeypatch.setattr(module, "run_machining", ran)
        monkeypatch.setattr(module, "read_all", lambda run, models: run.feed)
        monkeypatch.setattr(module, "feed_metrics", measured)
        monkeypatch.setattr(
            module, "sources", lambda models, runs_by_feedback: list(runs_by_feedback)
        )
        monkeypatch.setattr(module, "machining_figures", drawn)
        monkeypatch.setattr(
            module,
            "machining_notes",
            lambda task: [f"<{feed_key(FEED_TIMES[-1])}.ours.rmse_n:>"],
        )
        options = {"progress": lambda share, step: shares.append(share)}
        result = experiment.run(ExperimentContext(tmp_path, tmp_path, **options | given))
        assert len(corrections) == len(runs) / 2
        return result, runs, shares

    return study


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_the_fastest_feed_alone_is_run_with_a_sensor_and_without(studied, experiment):
    """And its figures stand where they stand in a run of all feeds, the others' being NaN."""
    result, runs, shares = studied(experiment, fastest_feed=True, seed=7)
    assert [one.machining.one_way for one, _ in runs] == [min(FEED_TIMES)] * 2 == [15.0] * 2
    assert result.configuration["feeds_s"] == (15.0,)
    assert [feed_key(feed) in result.metrics for feed in FEED_TIMES] == [True, False, False]
    assert result.metrics["sources"] == [15.0]
    for row in result.comparison:
        value = result.metrics
        for part in row.key.split("."):
            value = value[part]
        np.testing.assert_array_equal(value, [15.0, np.nan, np.nan], err_msg=row.key)
    # Sentences and figures are of all feeds.
    np.testing.assert_array_equal(
        result.metrics["band_without_sensor"]["turns"], [150.0, np.nan, np.nan]
    )
    assert filled(result.notes, result.metrics) == [] and result.figures == ()
    # Half of the first of two runs, half of the second; between them the models and the figures.
    assert [s for s in shares if 0.1 < s < 0.95] == pytest.approx([0.1 + 0.2125, 0.1 + 0.6375])


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_feed_is_run_with_a_sensor_and_without(studied, experiment):
    result, runs, shares = studied(experiment)
    assert [one.machining.one_way for one, _ in runs] == [15.0, 15.0, 30.0, 30.0, 60.0, 60.0]
    assert result.configuration["feeds_s"] == FEED_TIMES
    np.testing.assert_array_equal(result.metrics["ours"]["rmse_n"], FEED_TIMES)
    for key, factor in (("band", 1.0), ("band_without_sensor", 10.0)):
        for part in ("steady", "ends", "turns", "all"):
            least = factor * np.array(FEED_TIMES)
            np.testing.assert_array_equal(result.metrics[key][part], least, err_msg=part)
    valid = result.metrics["band_of_valid_without_sensor"]
    np.testing.assert_array_equal(valid["steady"], 10.0 * np.array(FEED_TIMES))
    np.testing.assert_array_equal(valid["ends"], np.nan)
    assert filled(result.notes, result.metrics) == [format(max(FEED_TIMES))]
    assert result.figures == ["figures"]
    assert shares == sorted(shares) and shares[-1] <= 1.0
    # The picture is of the fastest feed without a sensor.
    assert [page is not None for _, page in runs] == [False, True, False, False, False, False]


def test_a_quick_study_s_ways_are_as_much_shorter(studied):
    _, runs, _ = studied(polishing.EXPERIMENT, quick=True, draws=False, fastest_feed=True)
    assert [one.machining.one_way for one, _ in runs] == pytest.approx([1.0, 1.0])
    assert all(page is None for _, page in runs)


def test_another_seed_is_other_noise_and_another_process(studied):
    task = polishing.TASK
    for seed in (0, 7):
        _, runs, _ = studied(polishing.EXPERIMENT, seed=seed, fastest_feed=True)
        for (run, _), name in zip(runs, (task.scenario, task.sensorless), strict=True):
            bundled = load_scenario(name)
            assert run.seed == bundled.seed + seed
            process, usual = run.machining.process, bundled.machining.process
            assert process.variations.seed == usual.variations.seed + seed
            assert run.force_torque_sensor == bundled.force_torque_sensor


def test_a_pass_that_ends_before_its_feed_is_steady_is_an_error(studied):
    with pytest.raises(RuntimeError, match="sensor feedback, 15 s: the pass ended early"):
        studied(polishing.EXPERIMENT, steady=False, fastest_feed=True)
