"""Drake reads a text, and says nothing of what it does not read there."""

import logging

import pytest
from pydrake.multibody.plant import MultibodyPlant

from wrenchsight.models.robot.drake_parsing import add_model

_ODD = '<robot name="a"><link name="b" type="laser"/></robot>'


def test_tags_that_drake_does_not_read_are_no_lines(caplog: pytest.LogCaptureFixture) -> None:
    logger = logging.getLogger("drake")
    before = logger.level
    plant = MultibodyPlant(0.0)
    instance = add_model(plant, _ODD, "urdf")
    assert plant.GetModelInstanceName(instance) == "a"
    assert not caplog.records
    assert logger.level == before


def test_what_it_cannot_read_is_an_error_and_the_log_is_as_before() -> None:
    logger = logging.getLogger("drake")
    before = logger.level
    with pytest.raises((RuntimeError, ValueError)):
        add_model(MultibodyPlant(0.0), "<robot>", "urdf")
    assert logger.level == before
