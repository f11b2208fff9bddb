"""Contacts of a log: one by one, however the log is cut into chunks."""

import numpy as np
import pytest

from wrenchsight.analyses.methods.estimate.contact_episodes import (
    MAX_LISTED_CONTACTS,
    Contact,
    ContactEpisodes,
)
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.detection.link_odds import PlaceOdds

T = 0.01
ROWS = 400


def detection(contacts, misfits=(), links=()):
    contact, misfit = np.zeros(ROWS, bool), np.zeros(ROWS, bool)
    link = np.zeros(ROWS, np.int8)
    for begin, end in contacts:
        contact[begin:end] = True
    for (begin, end), number in zip(misfits, links, strict=True):
        misfit[begin:end], link[begin:end] = True, number
    statistic = np.where(contact, 2.0 + np.arange(ROWS) / ROWS, 0.3)
    at_rest = np.arange(ROWS) < 40
    return Detection(statistic, contact, misfit, link, at_rest, np.zeros(ROWS, bool))


def gathered(detections, edges, t0=0.0):
    episodes = ContactEpisodes(6)
    t = t0 + T * np.arange(ROWS)
    force = np.zeros((ROWS, 3))
    force[:, 2] = np.arange(ROWS)
    valid = np.arange(ROWS) % 2 == 0
    for begin, end in zip((0, *edges), (*edges, ROWS), strict=True):
        part = Detection._make(column[begin:end] for column in detections)
        episodes.add(t[begin:end], part, force[begin:end], valid[begin:end])
    episodes.finish()
    return episodes


DETECTIONS = detection(
    [(40, 50), (100, 250), (390, 400)], [(45, 50), (110, 130), (130, 140)], [0, 3, 5]
)


@pytest.mark.parametrize("edges", [(), (50,), (40, 45, 50, 100), (120, 130, 250), (51, 399), (0,)])
def test_contacts_do_not_depend_on_the_chunks(edges):
    episodes = gathered(DETECTIONS, edges)
    assert [(c.begin, c.end) for c in episodes.contacts] == [
        (pytest.approx(0.40), pytest.approx(0.49)),
        (pytest.approx(1.00), pytest.approx(2.49)),
        (pytest.approx(3.90), pytest.approx(3.99)),
    ]
    assert [c.link for c in episodes.contacts] == [0, 3, 0]
    assert [c.misfit for c in episodes.contacts] == [0.5, 0.2, 0.0]
    assert [c.force for c in episodes.contacts] == [48.0, 248.0, 398.0]
    metrics = episodes.metrics(1.0)
    assert metrics["count"] == 3
    assert metrics["contact_pct"] == pytest.approx(100.0 * 170 / ROWS)
    assert metrics["rest_pct"] == pytest.approx(10.0)
    assert metrics["contacts"][1]["link"] == 3
    assert metrics["contacts"][2]["link"] is None


def test_the_lines_say_when_how_much_and_where():
    assert gathered(DETECTIONS, ()).lines() == [
        "contact at t = 0.40 s for 0.09 s, up to 48 N, not at E",
        "contact at t = 1.00 s for 1.49 s, up to 248 N, not at E: link 3",
        "contact at t = 3.90 s for 0.09 s, up to 398 N",
    ]
    since_1970 = gathered(DETECTIONS, (), 1.7e9).lines()
    assert since_1970[0].startswith("contact at t = 0.40 s")
    assert gathered(detection([]), ()).lines() == ["no contact found"]


@pytest.mark.parametrize("edges", [(), (120,), (105, 110, 140)])
def test_a_contact_that_goes_on_within_half_a_second_is_one(edges):
    """Of .1 s, less than .5 s without, and .6 s; then one of its own .5 s after."""
    detections = detection([(100, 110), (155, 216), (270, 280)], [(100, 105), (160, 206)], [2, 4])
    joined, later = gathered(detections, edges).contacts
    assert (joined.begin, joined.end) == (pytest.approx(1.0), pytest.approx(2.15))
    assert (joined.misfit, joined.link, joined.force) == (pytest.approx(51 / 71), 4, 214.0)
    assert later.begin == pytest.approx(2.7)


def test_a_contact_without_a_valid_force_says_so():
    episodes = ContactEpisodes(6)
    nothing = np.zeros(ROWS, bool)
    episodes.add(T * np.arange(ROWS), detection([(10, 20)]), np.ones((ROWS, 3)), nothing)
    episodes.finish()
    assert episodes.lines() == ["contact at t = 0.10 s for 0.09 s, no valid force"]


def test_contacts_beyond_those_listed_are_counted():
    episodes = ContactEpisodes(6)
    detections = detection([(k, k + 1) for k in range(0, ROWS, 2)])
    for k in range(10):
        t = 1.0 * (ROWS * k + np.arange(ROWS))
        episodes.add(t, detections, np.zeros((ROWS, 3)), np.ones(ROWS, bool))
    episodes.finish()
    assert episodes.num_contacts == 10 * ROWS // 2
    assert len(episodes.metrics(1.0)["contacts"]) == MAX_LISTED_CONTACTS
    assert episodes.lines()[-1] == f"{10 * ROWS // 2 - 8} further contacts: see metrics.json"


def test_places_are_named_likeliest_first_and_e_with_the_link_that_carries_it() -> None:
    place = PlaceOdds(np.array([0.0, 0.0, 0.02, 0.03, 0.1, 0.47, 0.2]), 0.18)
    time = "contact at t = 1.00 s for 0.50 s, up to 12 N, "
    touched = Contact(1.0, 1.5, 3.0, 12.0, 0.0, 0, place)
    assert touched.sentence(0.0) == (
        time + "on link 6 (47 %), or at E or on link 7 (38 %), or on link 5 (10 %)"
    )
    assert touched.metrics()["not_at_e"] is False
    on_link = Contact(1.0, 1.5, 3.0, 12.0, 0.8, 6, place)
    assert on_link.sentence(0.0) == (
        time + "not at E: on link 6 (47 %), or on link 7 (38 %), or on link 5 (10 %)"
    )
    assert on_link.metrics()["not_at_e"] is True


@pytest.mark.parametrize(
    ("duration", "text"),
    [(0.0, "less than 0.01 s"), (0.006, "0.01 s")],
)
def test_a_contact_of_a_single_sample_does_not_last_for_no_time(duration, text):
    contact = Contact(2.0, 2.0 + duration, statistic=1.2, force=None, misfit=0.0, link=0)
    assert contact.sentence(0.0) == f"contact at t = 2.00 s for {text}, no valid force"
