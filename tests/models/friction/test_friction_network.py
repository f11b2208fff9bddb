"""The 1-10-1 network against torch, bad weights."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from wrenchsight.models.friction.friction_network import FrictionNetworks


def networks(n: int = 3, h: int = 10, seed: int = 4) -> FrictionNetworks:
    rng = np.random.default_rng(seed)
    return FrictionNetworks(
        W1=rng.normal(size=(n, h)) * 3.0,
        b1=rng.normal(size=(n, h)),
        W2=rng.normal(size=(n, h)) * 5.0,
        b2=rng.normal(size=n),
        v_scale=rng.uniform(0.01, 0.2, size=n),
    )


def test_agrees_with_torch() -> None:
    nets = networks()
    v = np.random.default_rng(5).normal(size=(200, 3)) * 0.1
    for i in range(3):
        oracle = torch.nn.Sequential(
            torch.nn.Linear(1, 10), torch.nn.Tanh(), torch.nn.Linear(10, 1)
        ).double()
        with torch.no_grad():
            oracle[0].weight.copy_(torch.from_numpy(nets.W1[i, :, None]))
            oracle[0].bias.copy_(torch.from_numpy(nets.b1[i]))
            oracle[2].weight.copy_(torch.from_numpy(nets.W2[i, None, :]))
            oracle[2].bias.copy_(torch.from_numpy(nets.b2[i : i + 1]))
            expected = oracle(torch.from_numpy(v[:, i : i + 1] / nets.v_scale[i])).numpy()[:, 0]
        # Ten products of size 5 with an error of 1e-16 each.
        np.testing.assert_allclose(nets.evaluate(v)[:, i], expected, atol=1e-13)


def test_single_sample_is_a_row_of_the_log() -> None:
    nets = networks()
    v = np.array([[0.01, -0.02, 0.0], [0.3, 0.2, -0.1]])
    np.testing.assert_array_equal(nets.evaluate(v)[1], nets.evaluate(v[1]))


def test_bad_weights_are_refused() -> None:
    good = networks()
    for key, value, message in (
        ("b1", [[0.0]], "b1 must have shape"),
        ("b2", [0.0, np.nan, 0.0], "b2 has a value"),
        ("v_scale", [1.0, 0.0, 1.0], "v_scale must be positive"),
        ("W1", [1.0, 2.0], "joints, neurons"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(good, **{key: value})
