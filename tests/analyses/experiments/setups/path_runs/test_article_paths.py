"""The path that is found here: what it is asked for."""

from types import SimpleNamespace

import pytest

from wrenchsight.analyses.experiments.setups.path_runs import article_paths
from wrenchsight.models.robot.robot import Robot


@pytest.mark.parametrize("informed", [False, True])
def test_only_the_path_of_least_force_sd_keeps_off_the_limits(
    monkeypatch: pytest.MonkeyPatch, sts: Robot, informed: bool
) -> None:
    """Its optimum lies on a joint's limit; between points the arm would pass it."""

    class AskedError(Exception):
        pass

    def place(task, _source, _robot, request):
        assert request.objective == ("force-sd" if informed else "jcn")
        bounds = task.bounds(sts)
        inside = sts.position_upper - bounds.q_upper
        assert (inside > 0.01).all() if informed else (inside == 0.0).all()
        raise AskedError

    monkeypatch.setattr(article_paths, "place", place)
    monkeypatch.setattr(article_paths, "shared", lambda _n, _a, compute, **_: compute())
    with pytest.raises(AskedError):
        article_paths.found_path(sts, 0, SimpleNamespace() if informed else None)
