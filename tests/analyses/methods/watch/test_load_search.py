"""What the search for a load says of a stream that begins anew while a look runs."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.analyses.methods.watch.load_search import LOOK_TIMES, LoadSearch
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveEstimator
from wrenchsight.models.live.samples import Sample

WAIT = 60.0  # s, after which a test fails


@pytest.fixture
def running(ur10e, monkeypatch, request):
    """A search one of whose looks, the first if a test names no other, runs in its thread until
    `may_end`, and then shows `load`.
    """
    place = getattr(request, "param", 0)
    model = IdentifiedModel.nominal(ur10e)
    search = LoadSearch(ur10e, model, in_background=True)
    began, may_end = threading.Event(), threading.Event()
    load = object()

    def judge(*arguments):
        began.set()
        assert may_end.wait(WAIT)
        return load

    monkeypatch.setattr(search, "_judge", judge)

    def estimator():
        live = LiveEstimator(ur10e, model)
        for k in range(500):
            live.take(Sample(0.01 * k, 0.01 * k, ur10e.home, np.zeros(6), np.zeros(6)))
        return live.estimator

    first = estimator()
    del search._looks[: LOOK_TIMES.index(LOOK_TIMES[place])]
    for t in (0.0, 0.2, 0.4):
        search.add_sample(Sample(t, t, ur10e.home, np.zeros(6), np.zeros(6)))
    search.look(LOOK_TIMES[place], first)
    assert began.wait(WAIT)
    yield SimpleNamespace(
        search=search, may_end=may_end, load=load, estimator=first, another=estimator
    )
    may_end.set()


def ended(running):
    """What the search says when the look that runs has ended."""
    look = running.search._running
    running.may_end.set()
    if look is not None:
        look.result(WAIT)
    else:
        running.search._pool.submit(int).result(WAIT)  # its only thread is free again
    return running.search.result()


def test_a_load_is_told_once(running):
    assert running.search.result() is None
    assert ended(running) is running.load
    assert running.search.result() is None
    assert running.search.is_over


@pytest.mark.parametrize("running", [0, -1], indirect=True)
def test_no_load_of_the_stream_before_a_restart_is_told(running):
    running.search.restart()
    assert ended(running) is None
    assert not running.search.is_over  # it looks for a load of the stream that begins


@pytest.mark.parametrize("running", [0, -1], indirect=True)
def test_no_load_of_the_stream_before_a_gap_is_told(running, ur10e):
    running.search.add_sample(Sample(9.0, 9.0, ur10e.home, np.zeros(6), np.zeros(6)))
    assert ended(running) is None
    assert not running.search.is_over


def test_no_load_of_readings_that_began_anew_is_told(running):
    running.search.look(LOOK_TIMES[0] + 1.0, running.another())
    assert ended(running) is None
    assert not running.search.is_over
