"""What a world measures is what its experiments measure alone, drawn and with nothing shared."""

from importlib import import_module

import pytest

from wrenchsight.analyses.campaign.world_run import (
    CampaignSettings,
    WorldTask,
    numbers_in,
    run_world,
)
from wrenchsight.analyses.output.outputs import plain_metrics
from wrenchsight.analyses.study.experiment import ExperimentContext
from wrenchsight.analyses.study.fingerprint import software_hash
from wrenchsight.analyses.study.registry import REGISTRY
from wrenchsight.models.truth.worlds import draw_world

NAMES = ("identification", "friction", "combined", "repeat-cycle")


@pytest.mark.slow
def test_numbers_are_those_of_a_study_in_the_same_world(tmp_path, monkeypatch):
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")
    modules = {name: REGISTRY.entries()[name].module for name in NAMES}
    everywhere = tmp_path / "everywhere"
    settings = CampaignSettings(data=tmp_path, quick=True)
    for number in (3, 4):  # the second finds what all worlds share
        software = {name: software_hash(module) for name, module in modules.items()}
        outcome = run_world(WorldTask(settings, number, modules, software, everywhere=everywhere))
        assert not outcome.failures
    world = draw_world(0, 4)
    for name, module in modules.items():
        out = tmp_path / name
        out.mkdir()
        context = ExperimentContext(
            out=out,
            data=tmp_path,
            seed=world.seed,
            quick=True,
            world=world.robot,
            hand=world.hand,
        )
        result = import_module(module).EXPERIMENT.run(context)
        numbers = numbers_in(plain_metrics(result.metrics))
        # What is in the diagram is a study's alone.
        of_world = {key: x for key, x in numbers.items() if not key.startswith("in_diagram.")}
        assert of_world == outcome.values[name]
