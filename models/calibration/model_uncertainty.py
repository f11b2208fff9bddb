"""Model uncertainty: the inertial parameters of an arm's model that have an error, and its sd."""

import numpy as np

from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.identification.torque_regression import parameter_names
from wrenchsight.models.numerics.arrays import Array

# The sds in model.yaml assume independent rows. With twice these sds, the loads that are estimated
# from unloaded logs of the UR10e agree with zero within their standard errors.
MODEL_SD_FACTOR = 2.0


def uncertain_parameters(model: IdentifiedModel) -> tuple[list[int], Array]:
    """Columns of the links' regressor (of 10 n), and the sd (c,) of each one's parameter.

    A combination of parameters goes by its leading one, whose column stands for all of it.
    """
    n = len(model.joint_names)
    names = {name: k for k, name in enumerate(parameter_names(model.joint_names, None))}
    table = model.base_parameters
    places, deviations = [], []
    for name, sd in zip(table.names, table.standard_deviations, strict=True):
        place = names.get(name.split(" ")[0], len(names))
        if place < 10 * n:
            places.append(place)
            deviations.append(MODEL_SD_FACTOR * sd)
    return places, np.array(deviations)
