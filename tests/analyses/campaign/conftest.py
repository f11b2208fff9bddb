"""A toy experiment that worlds can run anywhere: each run leaves a mark in a folder."""

import pytest

from wrenchsight.analyses.campaign.campaign import run_campaign
from wrenchsight.analyses.campaign.world_run import CampaignSettings

_MODULE = '''
import os, signal, time
from pathlib import Path
import numpy as np
from wrenchsight.analyses.study.experiment import (
    ComparisonRow, Experiment, ExperimentContext, ExperimentResult
)
from wrenchsight.analyses.study.shared_results import shared

FOLDER = Path({folder!r})


def count(what):
    with (FOLDER / what).open("a") as file:
        file.write("x")


def run(context: ExperimentContext) -> ExperimentResult:
    drawn = context.world(Fake())
    arm = shared("arm", (context.seed,), lambda: count("identified") or context.seed)
    path = shared("path", (), lambda: count("found") or 7.0, everywhere=True)
{body}
    count("ran_{name}")
    random = np.random.default_rng(context.seed)
    noise = random.normal(size=3) @ random.normal(size=(3, 3))
    if context.draws:
        (context.out / "drawn.txt").write_text("a figure")
    return ExperimentResult(
        metrics=dict(
            optimised=dict(rmse_n=1.0 + random.random()),
            ours=dict(rmse_n=1.0, nothing=float("nan")),
            rmse_nm=noise,
            coulomb=drawn.config,
            words="not a number",
            arm=arm,
            path=path,
        ),
        comparison=[
            ComparisonRow("RMSE, with", "optimised.rmse_n", 1.5, ours="ours.rmse_n"),
            ComparisonRow("Torque RMSE", "rmse_nm", (0.1, 0.2, 0.3)),
        ],
    )


class Fake:
    """In the place of a robot: a world makes another of it."""

    name = "sts_sre4_600"
    num_joints = 1
    source = Path("nowhere/robot.yaml")

    def __init__(self, config=None):
        from wrenchsight.models.robot.truth_config import JointFrictionConfig, SimulatedTruthConfig
        self.truth = SimulatedTruthConfig(JointFrictionConfig(stiction=[2.0], coulomb=[1.0]))
        self._config = config

    @property
    def config(self):
        from types import SimpleNamespace
        return self._config or SimpleNamespace(simulated_truth=self.truth)

    def with_truth(self, truth):
        return Fake(truth.friction.coulomb[0])


EXPERIMENT = Experiment("{name}", "The {name} experiment", "4.3", run)
'''


@pytest.fixture
def experiment(tmp_path, add_module):
    """Returns a function that registers an experiment of which each world counts its runs."""
    return lambda name, body="": add_module(
        name, _MODULE.format(name=name, body=body, folder=str(tmp_path))
    )


@pytest.fixture
def campaign(tmp_path):
    def campaign(*names, worlds=3, jobs=2, folder="campaign", **settings):
        return run_campaign(
            CampaignSettings(list(names), worlds, jobs=jobs, **settings), tmp_path / folder
        )

    return campaign


@pytest.fixture
def counted(tmp_path):
    """Returns a function that says how often something was done."""

    def counted(what):
        path = tmp_path / what
        return len(path.read_text()) if path.exists() else 0

    return counted
