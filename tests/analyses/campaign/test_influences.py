"""Which draws move a figure: worlds whose figures depend on their draws in a known way."""

import numpy as np
import pytest
from scipy.stats import false_discovery_control, spearmanr

from wrenchsight.analyses.campaign.influences import (
    MAX_NAMED_PARAMETERS,
    SIGNIFICANCE_LEVEL,
    holm,
    influences,
    influences_text,
)

WORLDS = 200


def drawn(seed, count=12):
    """`count` parameters from .5 to 1.5, and a seed."""
    generator = np.random.default_rng(seed)
    names = [f"p{k}" for k in range(count)]
    draws = {name: generator.uniform(0.5, 1.5, WORLDS) for name in names}
    return draws | {"individual": generator.integers(2**31, size=WORLDS).astype(float)}, generator


def test_influences_are_found_in_order_and_with_their_sign():
    draws, generator = drawn(0)
    figure = 3.0 * draws["p3"] - 1.5 * draws["p7"] + 0.3 * generator.standard_normal(WORLDS)
    result = influences(figure, draws, 6.0)
    assert [item.parameter for item in result] == ["p3", "p7"]
    assert result[0].rank_correlation > 0.7
    assert result[1].rank_correlation < -0.3
    assert result[0].rank_correlation == spearmanr(draws["p3"], figure).statistic
    # Of twelve: the seed is of no order.
    p = 12 * spearmanr(draws["p3"], figure).pvalue
    assert result[0].p == pytest.approx(p, rel=1e-9, abs=0.0)
    assert influences(draws["individual"], draws, 6.0) == ()
    turned = influences(-figure, draws, 6.0)
    assert [item.parameter for item in turned] == ["p3", "p7"]  # by size, whatever the sign
    assert turned[0].rank_correlation == pytest.approx(-result[0].rank_correlation)


def test_the_line_leads_to_the_article_s_figure_also_beyond_what_was_drawn():
    draws, generator = drawn(1)
    figure = 2.0 + 4.0 * draws["p0"] + 0.05 * generator.standard_normal(WORLDS)
    inside, beyond, too_far, impossible = (
        influences(figure, draws, article)[0] for article in (5.0, 9.0, 13.0, 1.0)
    )
    assert inside.reaches_article_at == pytest.approx(0.75, abs=0.02)
    assert not inside.extrapolated
    assert beyond.reaches_article_at == pytest.approx(1.75, abs=0.02)
    assert beyond.extrapolated
    assert "extrapolated: drawn 0.5" in str(beyond)
    assert too_far.reaches_article_at is None  # at 2.75, more than a range of 1 beyond 1.5
    assert impossible.reaches_article_at is None  # below zero
    assert influences(figure, draws, None)[0].reaches_article_at is None
    # Moved, but by little of all that moves it: a line through that says nothing.
    noisy = figure + 4.0 * generator.standard_normal(WORLDS)
    (weak,) = influences(noisy, draws, 5.0)
    assert weak.parameter == "p0"
    assert weak.reaches_article_at is None


def test_chance_is_named_as_seldom_as_stated():
    """Figures that nothing moves: in at most SIGNIFICANCE_LEVEL of the cases is anything named."""
    named = 0
    for seed in range(200):
        draws, generator = drawn(100 + seed)
        named += bool(influences(generator.standard_normal(WORLDS), draws, 0.0))
    # 200 cases at .05: 10, and 3.1 standard deviations of a binomial more. Uncorrected: 92.
    assert named <= 200 * SIGNIFICANCE_LEVEL + 3.1 * np.sqrt(
        200 * SIGNIFICANCE_LEVEL * (1.0 - SIGNIFICANCE_LEVEL)
    )
    assert influences_text(()) == "no drawn parameter is seen to move it"
    assert influences_text(None) == ""


def test_errors_either_way_count_by_their_size():
    draws, generator = drawn(2, 3)
    draws["payload"] = generator.uniform(0.9, 1.1, WORLDS)
    figure = np.abs(draws["payload"] - 1.0) + 0.01 * generator.standard_normal(WORLDS)
    assert [item.parameter for item in influences(figure, draws, 0.0)] == ["|payload - 1|"]


def test_only_the_strongest_influences_and_none_of_a_constant_parameter():
    draws, _ = drawn(3, 5)
    figure = sum(draws[f"p{k}"] for k in range(5))
    draws["fixed"] = np.ones(WORLDS)
    assert len(influences(figure, draws, 1.0)) == MAX_NAMED_PARAMETERS
    assert influences(np.ones(WORLDS), draws, 1.0) == ()


def test_holm_s_rule_on_the_numbers_of_a_textbook():
    p = np.array([0.01, 0.04, 0.03, 0.005])
    np.testing.assert_allclose(holm(p), [0.03, 0.06, 0.06, 0.02])
    # Never less strict than what bounds the share of false ones.
    random = np.random.default_rng(4).random(30) ** 4
    assert np.all(holm(random) >= false_discovery_control(random) - 1e-15)
