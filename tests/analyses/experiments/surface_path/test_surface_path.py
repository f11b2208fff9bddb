"""The experiment `surface-path`: the article's figures on the bundled blade."""


def test_the_experiment_reaches_its_figures(metrics):
    assert metrics["samples"] >= 100
    assert metrics["samples_lower"] == metrics["samples"]
    assert metrics["reduction_mean_pct"] >= 100.0 / 3.0
    assert metrics["optimised"]["mean_jcn"] <= metrics["local"]["mean_jcn"]
    assert metrics["optimised"]["mean_jcn"] <= metrics["grid"]["mean_jcn"]
    assert metrics["optimised"]["mean_jcn"] <= metrics["constant_angle"]["best_mean_jcn"]
    assert metrics["optimised"]["position_error_m"] < 1e-6
    assert metrics["optimised"]["normal_error_rad"] < 1e-6
