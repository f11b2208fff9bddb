"""What an identification says of itself."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.identify.identification_report import (
    filter_text,
    inconsistent_links_text,
    law_lines,
    residual_text,
)
from wrenchsight.analyses.methods.identify.law_choice import best_law
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit, joined_fits

ERRORS = {
    "coulomb-viscous": np.array([1.75, 0.3]),
    "presliding": np.array([0.9, 0.2]),
    "stribeck": np.array([1.1, 0.25]),
}


def test_every_law_has_its_line_and_the_chosen_one_is_first() -> None:
    title, *lines, _ = law_lines(ERRORS, "stribeck", "held out")
    assert "held out RMSE" in title
    assert [line.split()[0] for line in lines] == ["stribeck", "presliding", "coulomb-viscous"]
    assert [line.split()[-1] for line in lines] == ["chosen", "lost", "lost"]
    assert lines[1].split()[1:3] == ["0.900", "0.200"]


def test_the_figure_that_decided_is_shown_where_all_joints_speak_against_the_chosen_law() -> None:
    beyond = {
        "stribeck": (np.array([1.0, 0.2]),),
        "presliding": (np.array([4.0, 0.9]),),
        "coulomb-viscous": (np.array([1.8, 0.4]),),
    }
    assert best_law(ERRORS, beyond) == "stribeck"
    title, *lines, last = law_lines(ERRORS, "stribeck", "fitted", beyond)
    # (1.1 * .25)^(1/6) (1 * .2)^(2/6) and so on, by hand.
    assert [float(line.split()[-2]) for line in lines] == pytest.approx(
        [0.472, 0.805, 1.152], abs=6e-4
    )
    assert "score" in title
    assert "fastest and slowest" in last


def test_links_that_cannot_exist_are_one_line_with_the_remedy() -> None:
    assert inconsistent_links_text([], 6) is None
    some = inconsistent_links_text(["elbow", "wrist"], 6)
    assert some is not None
    assert "elbow, wrist" in some
    assert "--consistent" in some
    every = inconsistent_links_text(["a", "b"], 2)
    assert every is not None
    assert "every link" in every
    assert "\n" not in every


def test_the_filter_is_named_as_it_was() -> None:
    text = filter_text(IdentificationConfig(cutoff=7.5, filter_order=3))
    assert "7.5 Hz" in text
    assert "order 3" in text
    assert "predicted" not in filter_text(IdentificationConfig(filter_regressor=False))


def test_the_residual_is_a_mean_and_an_sd() -> None:
    rng = np.random.default_rng(0)
    measured = rng.normal(size=(400, 2))
    fits = [
        TorqueFit(str(k), np.arange(200.0), part, part - [0.5, -0.25] + 0.1 * noise)
        for k, (part, noise) in enumerate(
            zip(np.split(measured, 2), np.split(rng.normal(size=(400, 2)), 2), strict=True)
        )
    ]
    pair = joined_fits(fits, "held out")
    np.testing.assert_allclose(pair.bias, [0.5, -0.25], atol=0.02)  # 400 samples of sd .1: .005
    np.testing.assert_allclose(pair.residual_sd, 0.1, rtol=0.1)
    np.testing.assert_allclose(pair.rmse**2, pair.bias**2 + pair.residual_sd**2)
    assert residual_text(np.array([0.5, -0.25]), np.array([0.1, 0.2])) == (
        "+0.50 ± 0.1, -0.25 ± 0.2"
    )


def test_residuals_have_two_digits_and_no_negative_zero() -> None:
    text = residual_text(np.array([-0.001, 1.234, -12.6]), np.array([0.19, 0.84, 33.0]))
    assert text == "0 ± 0.19, +1.23 ± 0.84, -13 ± 33"
