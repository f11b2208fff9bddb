"""Drake's parser without its warnings.

Drake warns of each tag and attribute that it does not read, line by line of a text that no user
has written (<literal-string>.urdf:196). What counts of it, such as a shape that is lost, the
robot's own notices say.
"""

import logging

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex


def add_model(plant: MultibodyPlant, text: str, kind: str) -> ModelInstanceIndex:
    """Adds the one model of a text.

    Args:
        kind: urdf or sdf.

    Raises:
        RuntimeError, ValueError: Drake cannot read it, or it holds no model or several.
    """
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        (instance,) = Parser(plant).AddModelsFromString(text, kind)
    finally:
        logger.setLevel(level)
    return instance
