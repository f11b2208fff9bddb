"""The experiment `jcn-map`."""

from pathlib import Path

from wrenchsight.analyses.experiments.jcn_map.experiment import EXPERIMENT
from wrenchsight.analyses.study.experiment import ExperimentContext


def test_the_experiment_is_repeatable(tmp_path: Path) -> None:
    results = []
    for name in ("a", "b"):
        out = tmp_path / name
        out.mkdir()
        results.append(EXPERIMENT.run(ExperimentContext(out, tmp_path, quick=True)))
    assert results[0].metrics == results[1].metrics
    assert "93.9 %" in results[0].notes[0]
    for figure in (*results[0].figures, *results[0].recordings):
        assert (tmp_path / "a" / figure.path).is_file()
