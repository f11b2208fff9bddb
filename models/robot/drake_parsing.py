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
    (instance,) = add_models(plant, text, kind)
    return instance


def add_models(plant: MultibodyPlant, text: str, kind: str) -> list[ModelInstanceIndex]:
    """Adds all models of a text, those within others, too; arguments as of `add_model`.

    Raises:
        RuntimeError: Drake cannot read it.
    """
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        return list(Parser(plant).AddModelsFromString(text, kind))
    finally:
        logger.setLevel(level)
