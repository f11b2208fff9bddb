"""Notes that state a result say it from the figures they are given, whatever these are.

findings.json holds the figures that the notes read, of a shortened study. A second set turns them
round: what was less is more. `linear-path` reads results, not figures alone: its own test runs it.
"""

import json
import re
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.experiments.bandwidth import experiment as bandwidth
from wrenchsight.analyses.experiments.combined import experiment as combined
from wrenchsight.analyses.experiments.constant_wrench import experiment as constant_wrench
from wrenchsight.analyses.experiments.friction import experiment as friction
from wrenchsight.analyses.experiments.friction_laws import experiment as friction_laws
from wrenchsight.analyses.experiments.grinding import experiment as grinding
from wrenchsight.analyses.experiments.identification import experiment as identification
from wrenchsight.analyses.experiments.jcn_map import experiment as jcn_map
from wrenchsight.analyses.experiments.metrics_compare import experiment as metrics_compare
from wrenchsight.analyses.experiments.panda_wrench import experiment as panda_wrench
from wrenchsight.analyses.experiments.polishing import experiment as polishing
from wrenchsight.analyses.experiments.repeat_cycle import experiment as repeat_cycle
from wrenchsight.analyses.experiments.repeat_cycle_push import experiment as repeat_cycle_push
from wrenchsight.analyses.experiments.setups.machining_runs import machining_study
from wrenchsight.analyses.experiments.surface_path import experiment as surface_path
from wrenchsight.analyses.experiments.ur10e_identification import experiment as ur10e_identification
from wrenchsight.analyses.experiments.ur10e_payload import experiment as ur10e_payload
from wrenchsight.analyses.methods.planning.jcn_map_settings import SliceConfig

_KNOWN = panda_wrench.Knowledge(20.0, 1.0, 0.01 * np.eye(7))
FINDINGS = {
    "bandwidth": lambda m: bandwidth.findings(m, 0.5),
    "combined": combined.findings,
    "constant-wrench": constant_wrench.findings,
    "friction": friction.findings,
    "friction-laws": friction_laws.findings,
    "grinding": lambda m: machining_study.findings(grinding.TASK, m),
    "identification": lambda m: identification.findings(m, 2),
    "jcn-map": lambda m: jcn_map.findings(m, SliceConfig()),
    "metrics-compare": lambda m: metrics_compare.findings(m, (20.0, 1.0)),
    "panda-wrench": lambda m: panda_wrench.findings(m, _KNOWN, _KNOWN),
    "polishing": lambda m: machining_study.findings(polishing.TASK, m),
    "repeat-cycle": repeat_cycle.findings,
    "repeat-cycle-push": lambda m: repeat_cycle_push.findings(m, {"initial": 1.0, "optimised": 3}),
    "surface-path": lambda m: surface_path.findings(m, 72),
    "ur10e-identification": ur10e_identification.findings,
    "ur10e-payload": ur10e_payload.findings,
}


@pytest.fixture
def figures():
    """The figures by experiment; each test may change its own."""
    path = Path(__file__).with_name("findings.json")
    return json.loads(path.read_text(encoding="utf-8"))


def _turned(value, place=""):
    """Reductions get the other sign, and all other numbers another size, each its own."""
    if isinstance(value, dict):
        return {key: _turned(one, key) for key, one in value.items()}
    if isinstance(value, list):
        return [_turned(one, place) for one in value]
    if isinstance(value, bool | int | str) or value is None:
        return value
    if place.startswith("reduction") or place.endswith("reduction_pct"):
        return -value
    return value * (0.4 + (sum(map(ord, place)) % 17) / 10.0)


@pytest.mark.parametrize("name", FINDINGS)
def test_notes_are_sentences_of_the_figures_they_are_given(figures, name):
    first, second = (FINDINGS[name](m) for m in (figures[name], _turned(figures[name])))
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        for text in (one, other):
            assert text[-1] in ".", text
            assert "nan" not in text
    assert first[0] != second[0]  # the first states what was found


@pytest.mark.parametrize("name", ["combined", "friction", "friction-laws", "repeat-cycle"])
def test_a_reduction_below_zero_is_more(figures, name):
    def words(metrics):
        text = FINDINGS[name](metrics)[0]
        return re.findall(r"[\d.]+ % (less|more)", text)

    first, second = words(figures[name]), words(_turned(figures[name]))
    assert first
    assert [{"less": "more", "more": "less"}[word] for word in first] == second


def test_what_a_variant_brings_is_compared_along_each_axis(figures):
    metrics = figures["combined"]
    presliding = metrics["presliding"]
    presliding |= {f"rmse_{axis}_n": 0.9 * metrics["bayesian"][f"rmse_{axis}_n"] for axis in "xy"}
    presliding["rmse_z_n"] = 1.01 * metrics["bayesian"]["rmse_z_n"]
    (note,) = (n for n in combined.findings(metrics) if "`presliding`" in n)
    assert "X errs less, Y errs less and Z errs as much" in note


def test_a_low_pass_is_worth_what_it_brings(figures):
    metrics = figures["repeat-cycle-push"]
    slow = deepcopy(metrics)
    slow["optimised_filtered"]["rmse_y_n"] = 0.5 * slow["optimised"]["rmse_y_n"]
    notes = ["".join(FINDINGS["repeat-cycle-push"](m)) for m in (metrics, slow)]
    assert "better without it" in notes[0]
    assert "the noise weighs more" in notes[1]


@pytest.mark.parametrize(("ratio", "word"), [(2.2, "too small"), (1.1, "honest"), (0.4, "large")])
def test_an_sd_is_judged_by_the_errors_beside_it(figures, ratio, word):
    metrics = figures["panda-wrench"]
    metrics["bayesian"]["error_over_stated_sd"] = [ratio] * 10
    assert any(
        f"{ratio:.1f} times the stated sd" in n and word in n
        for n in FINDINGS["panda-wrench"](metrics)
    )


def test_joints_are_sorted_by_what_their_noise_alone_would_give(figures):
    metrics = figures["repeat-cycle"]
    metrics["noise_alone"]["one_joint_alone"]["reduction_rmse_y_pct"] = [50.0] * 6
    text = "".join(repeat_cycle.findings(metrics))
    assert "above it (1, 2, 3, 4, 5 and 6) and below (none)" in text


def test_a_plane_out_of_reach_is_said(figures):
    metrics = figures["jcn-map"]
    metrics["slice"] = {"points": 441, "reached_pct": 0.0}
    assert "reaches no point" in FINDINGS["jcn-map"](metrics)[-1]
