"""The experiment `jcn-map`."""

from wrenchsight.analyses.experiments.jcn_map.experiment import EXPERIMENT


def test_the_experiment_is_repeatable(run_experiment):
    first, second = (run_experiment(EXPERIMENT, quick=True) for _ in range(2))
    assert first.metrics == second.metrics
    assert "93.9 %" in first.notes[0]
