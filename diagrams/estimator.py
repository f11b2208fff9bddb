"""The wrench estimator as a Diagram, to be dropped into any other.

**Blocks of yours in the place of a stage.** `stages={"friction": MyFriction()}` of `make_estimator`
puts a block in the place of ours. Its input ports are connected by their names: q, v, current,
terms, tau_J, tau_f, tau_ext, tau_ext_valid, pole, sliding, torque_error, fault, and for `detection`
the outputs of `reconstruction`. Inputs of other names stay open. With a correction `reconstruction`
and `detection` get the corrected tau_ext and tau_ext_valid, and `friction` v_planned in the place
of v where the model's law is of the speed alone. A `reconstruction` with an input `corrected` (1,)
finds there whether the correction holds, and tau_ext_valid is the observer's alone. A block must
have the outputs of its stage:

    samples         q, v, current (n,), fault (1,); from inputs of those names
    terms           terms (abstract)
    motor           tau_J (n,)
    friction        tau_f (n,)
    observer        tau_ext (n,), valid (1,); it should feed through neither tau_J nor current
    torque_error    torque_error (ERROR_ROWS n,)
    reconstruction  wrench (6,), covariance (36,), condition_number, valid, invalid (1,)
    detection       contact (1,); the other signals of detection, if it has them

A friction of yours without a port `sliding` leaves the stiction band that of the model's law. An
observer of yours without a port `pole` (n,) 1/s is taken for one without lag. The torque error is
computed where a block has an input `torque_error`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
    PortDataType,
    System,
)
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer

from wrenchsight.diagrams.outputs import split_outputs
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig, ContactDetector
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserver
from wrenchsight.models.observers.observer import Observer
from wrenchsight.models.robot.arm import Arm
from wrenchsight.systems.contact_detection import DETECTION, ContactDetection
from wrenchsight.systems.external_torque_observer import ExternalTorqueObserver
from wrenchsight.systems.friction_law import FrictionLawSystem
from wrenchsight.systems.generalized_momentum_observer import GeneralizedMomentumObserver
from wrenchsight.systems.jacobian_wrench_reconstruction import JacobianWrenchReconstruction
from wrenchsight.systems.motor_current_torque_source import MotorCurrentTorqueSource
from wrenchsight.systems.presliding_friction import PreslidingFrictionSystem
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem
from wrenchsight.systems.sample_check import SampleCheckSystem
from wrenchsight.systems.semi_parametric_friction import SemiParametricFrictionSystem
from wrenchsight.systems.torque_correction import TorqueCorrection
from wrenchsight.systems.torque_error import TorqueErrorSystem
from wrenchsight.systems.wrench_estimator import WrenchEstimatorSystem


def make_estimator(
    robot: Arm,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig | None = None,
    name: str = "estimator",
    fused: bool = False,
    detection: ContactDetectionConfig | None = None,
    stages: Mapping[str, LeafSystem] | None = None,
    corrected: bool = False,
) -> Diagram:
    """Builds the estimator: from a controller's measurements to the wrench at the tool.

                   +-----------+ --> tau_ext
                   |           | --> wrench
      q       -->  |           | --> covariance
                   |           | --> condition_number
      v       -->  | estimator | --> valid
                   |           | --> invalid
      current -->  |           | --> terms
                   |           | --> fault
                   |           | --> tau_f
                   |           | --> tau_ext_valid
                   +-----------+ --> torque_error

    Inputs:   q                 (n,) rad (m for a prismatic joint)
              v                 (n,) rad/s (m/s)
              current           (n,) A, as the drives report it
    Outputs:  tau_ext           (n,) N m, positive along the motion it causes
              wrench            (6,) F_E_W = [mx my mz fx fy fz], N m and N: exerted by the
                                environment on the robot, at E, in axes of W
              covariance        (36,) of the wrench, row by row
              condition_number  (1,) of J in m and rad
              valid             (1,) 1 or 0
              invalid           (1,) the reasons why it is not valid, a sum of the codes of
                                `models.estimation.invalid`; 0 where it is valid
              terms             RigidBodyTerms (abstract) of the model, for other blocks
              fault             (1,) what is wrong with q and v of the tick, and with the current of
                                the one before: a sum of the codes of
                                `models.observers.sample_check`, or 0; such a sample is missing
              tau_f             (n,) N m, friction of the model, that was taken off
              tau_ext_valid     (1,) 1 where tau_ext belongs to the sample, and its correction holds
              torque_error      (ERROR_ROWS n,) of `systems.torque_error`; of a model that has
                                learnt one, or with `corrected`. Stages have it also where another
                                block than the reconstruction reads it

    The outputs at a tick t = k time_step are those of row k of `WrenchEstimator.run` over the same
    samples: they use q and v of that very tick and motor torque up to it. Between two ticks the
    outputs are those of the last one. With torque samples "held" no output feeds through from
    `current`, so that a controller may use the wrench. The estimator starts by itself at its first
    update.

    `terms` are those of q and v as they come, an impossible sample as well: the estimator leaves
    that out, and a controller must not be left without the arm's weight.

    Inside are `samples`, `terms`, `motor`, `friction`, `observer`, `reconstruction`, and if another
    block reads it `torque_error` (and demultiplexers). Their numeric parameters
    (torque_per_ampere; coulomb, viscous, offset, v_crit, or the slip elements of a law with memory;
    K_0; the prior's sds) are changed through their Contexts. Stated sd, lag and `valid` follow.

    With `fused` all of them are one block, `block`, with the same parameters
    (`systems.wrench_estimator.WrenchEstimatorSystem`): the same numbers.

    With `corrected` there are further inputs, all of them to be connected, for what is known of the
    model's error besides the model, as from an air pass (`models.machining.air_pass`):

              tau_correction    (n,) N m, added to the observed tau_ext; where it is not finite
                                nothing is added, and the reading is not valid
              correction_valid  (1,) 1 where a corrected reading may be valid, else 0
              correction_sd     (n,) N m, of the correction, beyond the model's torque error
              v_planned         (n,) rad/s, at which a friction law without memory is evaluated in
                                the place of v, and without regard to which joints rest; of such a
                                law alone

    With `detection` there is one block more, `detection`
    (`systems.contact_detection.ContactDetection`), and outputs (1,) each: contact_statistic,
    contact, misfit, link, rest, out_of_range.

    Args:
        robot: `Robot`, or `diagrams.arm_in_plant.ArmInPlant`, whose wrench is in the plant's World.
        model: inertias, friction and residual of this robot, and its torque error if it has learnt
            one.
        config: observer (whose time_step is the period of all blocks), prior and checks; None: the
            defaults of its class.
        name: of the diagram, and in messages.
        fused: whether it is one block instead of its stages.
        detection: configuration of the contact detector; None: there is none.
        stages: blocks of yours by the name of the stage, as the module's text says; of a staged
            estimator only. One for `detection` needs no configuration of the detector.
        corrected: whether there are inputs for a correction of tau_ext.

    Raises:
        InputError: the model belongs to another robot.
        ValueError: as `models.estimation.estimator.WrenchEstimator` and `ContactDetector`; a stage
            that there is none, or without a port that it needs; stages of a fused estimator; a
            correction of an observer that reads the wrench itself; a contact detector where the
            model has no torque error that was learnt from logs, which decides what is contact.
    """
    replacements = dict(stages or {})
    if fused and replacements:
        raise ValueError(f"{name}: a fused estimator has no stages to replace")
    _check_stages(name, replacements)
    # The stages as plain mathematics: the blocks wrap its parts, which fit each other.
    estimator = WrenchEstimator(robot, model, config)
    if corrected and _reads_wrench(estimator, replacements.get("observer")):
        raise ValueError(
            f"{name}: only an observer of joint torque can be corrected, not of wrench"
        )
    if detection is not None and "detection" not in replacements and not estimator.learnt:
        raise ValueError(
            f"{name}: no contact would be detected, as the model states no torque error that was "
            "learnt from logs (`identify`); leave detection out, or give a block of yours for the "
            'stage "detection"'
        )
    if fused:
        return _fused(estimator, name, detection, corrected)
    return _staged(estimator, name, detection, replacements, corrected)


_STAGE_OUTPUTS = {
    "samples": ("q", "v", "current", "fault"),
    "terms": ("terms",),
    "motor": ("tau_J",),
    "friction": ("tau_f",),
    "observer": ("tau_ext", "valid"),
    "torque_error": ("torque_error",),
    "reconstruction": ("wrench", "covariance", "condition_number", "valid", "invalid"),
    "detection": ("contact",),
}
"""What a block that takes the place of a stage must put out."""


def _check_stages(name: str, stages: Mapping[str, LeafSystem]) -> None:
    for stage, block in stages.items():
        if stage not in _STAGE_OUTPUTS:
            raise ValueError(f"{name}: no stage {stage!r}; there are {', '.join(_STAGE_OUTPUTS)}")
        kind = type(block).__name__
        if not isinstance(block, System):
            raise ValueError(f"{name}: stage {stage!r} must be a block, and is a {kind}")
        for port in _STAGE_OUTPUTS[stage]:
            if not block.HasOutputPort(port):
                raise ValueError(f"{name}: stage {stage!r} needs an output {port!r}: {kind}")
        for port in ("q", "v", "current") if stage == "samples" else ():
            if not block.HasInputPort(port):
                raise ValueError(f"{name}: stage {stage!r} needs an input {port!r}: {kind}")


def _reads_wrench(estimator: WrenchEstimator, users_observer: LeafSystem | None) -> bool:
    """Whether the observer that is used reads the wrench itself, and not from tau_ext.

    Args:
        users_observer: the user's block in the observer's place; None: the estimator's is used.
    """
    if users_observer is None:
        return estimator.observer.reads_wrench
    return _puts_out_wrench(users_observer)


def _puts_out_wrench(observer: LeafSystem) -> bool:
    """Whether a block is ours, of an observer that reads the wrench itself.

    The output `wrench` of a block that is not ours is not looked at.
    """
    return isinstance(observer, ExternalTorqueObserver) and observer.HasOutputPort("wrench")


class _Stages(NamedTuple):
    """The blocks of the estimator's stages, each ours or one in its place.

    Attributes:
        terms, motor, friction, observer, reconstruction: see `make_estimator`.
        torque_error: None where no block reads it.
    """

    terms: LeafSystem
    motor: LeafSystem
    friction: LeafSystem
    observer: LeafSystem
    reconstruction: LeafSystem
    torque_error: LeafSystem | None


class _Wiring(NamedTuple):
    """What is not the same in every staged estimator: made by `_wiring_of`.

    Attributes:
        is_corrected: there is a correction of tau_ext, with inputs of the diagram.
        has_planned_speed: friction reads an input v_planned of the diagram in the place of v. With
            a correction, as an air pass learns it with friction at the planned speed. Only a law of
            speed alone can: one with memory follows the measured motion, on the air pass as well.
        friction_knows_rest: our friction reads from the torque error which joints rest. A joint at
            rest has dry friction of any value within its stiction, which only an error that was
            learnt from logs knows. Not at the planned speed, which is taken as it is.
        reading_has_error: the reconstruction reads a torque error for each sample, and the pole of
            the observer: the error is learnt or the user's, or a correction adds its sd to it. Else
            ours has one covariance for all samples, and no lag.
        reading_remembers: our reconstruction has a memory. Only with a learnt error it judges lag
            and faults, by the samples before; else nothing depends on them.
        has_our_detector: our contact detector is added, which reads the torque error.
    """

    is_corrected: bool
    has_planned_speed: bool
    friction_knows_rest: bool
    reading_has_error: bool
    reading_remembers: bool
    has_our_detector: bool


def _wiring_of(
    estimator: WrenchEstimator,
    detection: ContactDetectionConfig | None,
    replacements: Mapping[str, LeafSystem],
    corrected: bool,
) -> _Wiring:
    """The wiring for this model, detector, correction and blocks of the user; as `_staged`."""
    is_learnt = estimator.learnt  # the model has a torque error that was learnt from logs
    has_planned_speed = corrected and estimator.friction.is_of_speed_alone
    return _Wiring(
        is_corrected=corrected,
        has_planned_speed=has_planned_speed,
        friction_knows_rest=is_learnt and not has_planned_speed,
        reading_has_error=is_learnt or corrected or "torque_error" in replacements,
        reading_remembers=is_learnt,
        has_our_detector=detection is not None and "detection" not in replacements,
    )


def _staged(
    estimator: WrenchEstimator,
    name: str,
    detection: ContactDetectionConfig | None,
    replacements: Mapping[str, LeafSystem],
    corrected: bool,
) -> Diagram:
    """The estimator as a block a stage.

    q, v, current --> samples --> terms, motor, friction, observer, torque_error
                                     --> (correction) --> reconstruction, (detection)

    Ports are exported in the order in which they are met: q, v and current first. `_Wiring` says
    what is not the same in every estimator: which optional inputs are connected or exported, and
    whether the reconstruction has a memory.

    Args:
        estimator: its parts are those of the blocks.
        replacements: the user's blocks, by the name of the stage that each takes the place of;
            checked (`_check_stages`).
        name, detection, corrected: as `make_estimator`.
    """
    wiring = _wiring_of(estimator, detection, replacements, corrected)
    builder = DiagramBuilder()
    stages = _add_stages(builder, estimator, replacements, wiring)
    # Ports by the names of the inputs that take them: `_connect_by_name` connects a block to those
    # that it has an input for, and leaves its other inputs open. tau_ext and tau_ext_valid are the
    # observer's own, not corrected.
    observed = _add_sample_check(builder, estimator, replacements.get("samples"))
    observed |= _stage_ports(builder, estimator, stages)
    _connect_by_name(builder, [stages.terms, stages.motor, stages.observer], observed)
    if stages.torque_error is not None:
        _connect_torque_error(builder, stages.torque_error, observed, wiring)
    _connect_friction(builder, stages.friction, observed, wiring)

    # What reconstruction and detection read: with a correction its tau_ext and tau_ext_valid stand
    # in the place of the observer's. All else is as observed.
    correction = _add_correction(builder, estimator.num_joints, observed) if corrected else {}
    to_be_read = observed | correction
    reading = _connect_reconstruction(
        builder,
        stages.reconstruction,
        to_be_read,
        observer_valid=observed["tau_ext_valid"],
        wiring=wiring,
    )
    # The output `terms` is of the model, at q and v as they come. Another block makes it, which at
    # each tick passes the stages' terms on where the check has left q and v as they are. A user's
    # terms, which may be of another model, it never gets.
    stage_terms = None if "terms" in replacements else observed["terms"]
    terms_as_read = _terms_as_read(builder, estimator, stage_terms)
    signals = to_be_read | reading
    _export_outputs(builder, signals, terms=terms_as_read)
    if "detection" in replacements:
        _add_users_detector(builder, replacements["detection"], signals)
    elif detection is not None:
        _add_detector(builder, ContactDetector.of(estimator, detection), signals)
    diagram = builder.Build()
    diagram.set_name(name)
    return diagram


def _export_outputs(
    builder: DiagramBuilder, sources: Mapping[str, OutputPort], terms: OutputPort
) -> None:
    """Exports the diagram's outputs, but for those of torque error and detection.

    `_connect_torque_error` and the functions that add a detector export these.

    Args:
        sources: ports by the names of the outputs. Their `terms`, of the samples that the estimator
            takes, are those of the stages and of the detector.
        terms: those of q and v as they come, which are the diagram's.
    """
    for signal in ("tau_ext", "tau_f", "tau_ext_valid", *_STAGE_OUTPUTS["reconstruction"]):
        builder.ExportOutput(sources[signal], signal)
    builder.ExportOutput(terms, "terms")
    builder.ExportOutput(sources["fault"], "fault")


def _connect_torque_error(
    builder: DiagramBuilder,
    torque_error: LeafSystem,
    sources: Mapping[str, OutputPort],
    wiring: _Wiring,
) -> None:
    """Connects the torque error and exports it, and the input of what a correction adds to it.

    A user's block without an input `added_sd` leaves the diagram without `correction_sd`.
    """
    _connect_by_name(builder, [torque_error], sources)
    if wiring.is_corrected and torque_error.HasInputPort("added_sd"):
        builder.ExportInput(torque_error.GetInputPort("added_sd"), "correction_sd")
    builder.ExportOutput(sources["torque_error"], "torque_error")


def _connect_friction(
    builder: DiagramBuilder,
    friction: LeafSystem,
    sources: Mapping[str, OutputPort],
    wiring: _Wiring,
) -> None:
    """Connects the friction; its speed is the measured one, or an input `v_planned`.

    A user's block without an input `v` leaves the diagram without `v_planned`.
    """
    sources_of_friction = dict(sources)
    if wiring.has_planned_speed and friction.HasInputPort("v"):
        builder.ExportInput(friction.GetInputPort("v"), "v_planned")
        del sources_of_friction["v"]
    _connect_by_name(builder, [friction], sources_of_friction)


def _connect_reconstruction(
    builder: DiagramBuilder,
    reconstruction: LeafSystem,
    signals: Mapping[str, OutputPort],
    observer_valid: OutputPort,
    wiring: _Wiring,
) -> dict[str, OutputPort]:
    """Connects the reconstruction; returns its outputs by name.

    Args:
        signals: ports by the names of the inputs that take them; with a correction tau_ext and
            tau_ext_valid are the corrected ones, and `corrected` says whether it holds.
        observer_valid: the observer's `valid`. A block that has an input `corrected` gets it as
            tau_ext_valid: so it finds which of the two is the reason against a reading.
    """
    sources = dict(signals)
    if reconstruction.HasInputPort("corrected"):
        sources["tau_ext_valid"] = observer_valid
    if not wiring.reading_has_error and isinstance(reconstruction, JacobianWrenchReconstruction):
        # `torque_error` may be there for another block, such as the detector: ours would read it.
        for signal in ("torque_error", "pole"):
            sources.pop(signal, None)
    _connect_by_name(builder, [reconstruction], sources)
    return _output_ports(builder, "reading", reconstruction, _STAGE_OUTPUTS["reconstruction"])


def _add_stages(
    builder: DiagramBuilder,
    estimator: WrenchEstimator,
    replacements: Mapping[str, LeafSystem],
    wiring: _Wiring,
) -> _Stages:
    """Adds the blocks of the stages by their names, unconnected.

    The check of the samples and the detector are none of them: `_add_sample_check` and
    `_add_detector` add these.

    Args:
        replacements: the user's blocks, by the name of the stage that each takes the place of. A
            torque_error among them is always added, and an output of the diagram.
        wiring: says here whether our friction reads from the torque error which joints rest,
            whether our reconstruction has a memory, and whether reconstruction or our detector
            reads the torque error.

    Returns:
        The blocks; torque_error is None where no block reads it.
    """
    period = estimator.observer.time_step

    def add(stage: str, make_ours: Callable[[], LeafSystem]) -> LeafSystem:
        """Adds the user's block of a stage, or else ours."""
        block = replacements[stage] if stage in replacements else make_ours()
        return builder.AddNamedSystem(stage, block)

    terms = add("terms", lambda: RigidBodyTermsSystem(estimator.chain))
    motor = add("motor", lambda: MotorCurrentTorqueSource.of(estimator.robot))
    friction = add(
        "friction",
        lambda: _friction_system(estimator.friction, period, wiring.friction_knows_rest),
    )
    observer = add("observer", lambda: _observer_system(estimator.observer))
    # Without memory the period is 0: a function of its inputs, without ticks.
    reading_period = period if wiring.reading_remembers else 0.0
    reconstruction = add(
        "reconstruction", lambda: JacobianWrenchReconstruction(estimator.reading, reading_period)
    )
    # Blocks that read the torque error if they have an input for it: a user's in any place. Ours
    # of reconstruction and detection are not among them, as `wiring` says what these read.
    possible_readers = [friction, observer, *replacements.values()]
    torque_error = None
    if _is_error_read(possible_readers, wiring):
        torque_error = add("torque_error", lambda: TorqueErrorSystem(estimator.error, period))
    return _Stages(
        terms=terms,
        motor=motor,
        friction=friction,
        observer=observer,
        reconstruction=reconstruction,
        torque_error=torque_error,
    )


def _is_error_read(possible_readers: Sequence[LeafSystem], wiring: _Wiring) -> bool:
    """Whether a block reads the torque error, so that its stage is needed.

    Args:
        possible_readers: friction, observer and the user's blocks, which read it where they have an
            input torque_error. Our kind of reconstruction always has one, which is connected with
            `wiring.reading_has_error` alone.
    """
    return (
        wiring.reading_has_error
        or wiring.has_our_detector
        or any(
            block.HasInputPort("torque_error")
            for block in possible_readers
            if not isinstance(block, JacobianWrenchReconstruction)
        )
    )


def _stage_ports(
    builder: DiagramBuilder, estimator: WrenchEstimator, stages: _Stages
) -> dict[str, OutputPort]:
    """The outputs of the stages up to the observer, by the names of the inputs that take them.

    Adds what splits the outputs of observer and torque error up, and constants for what a user's
    block does not put out.

    Returns:
        Ports of terms, tau_J, tau_f, sliding, pole, and those of `_observer_ports`; torque_error
        where there is such a stage.
    """
    ports = {
        "terms": stages.terms.GetOutputPort("terms"),
        "tau_J": stages.motor.GetOutputPort("tau_J"),
        "tau_f": stages.friction.GetOutputPort("tau_f"),
        "sliding": _sliding_port(builder, stages.friction, estimator.friction),
        "pole": _pole_port(builder, stages.observer, estimator.num_joints),
    }
    ports |= _observer_ports(builder, stages.observer)
    if stages.torque_error is not None:
        ports["torque_error"] = _torque_error_port(builder, stages.torque_error)
    return ports


def _observer_ports(builder: DiagramBuilder, observer: LeafSystem) -> dict[str, OutputPort]:
    """The observer's outputs, by the names of the inputs that take them.

    Returns:
        Ports of tau_ext; tau_ext_valid, its output `valid` (the plain name is the reading's); of
        one that reads the wrench itself also observed (42,), its output `wrench`: the wrench and
        its covariance, which our reconstruction passes on.
    """
    inputs_of_outputs = {"tau_ext": "tau_ext", "valid": "tau_ext_valid"}
    if _puts_out_wrench(observer):
        inputs_of_outputs["wrench"] = "observed"
    ports = _output_ports(builder, "observed", observer, list(inputs_of_outputs))
    return {inputs_of_outputs[output]: port for output, port in ports.items()}


def _torque_error_port(builder: DiagramBuilder, torque_error: LeafSystem) -> OutputPort:
    """The torque error; of our block split off by Drake, as in `_output_ports`."""
    if isinstance(torque_error, TorqueErrorSystem):
        return split_outputs(builder, torque_error)["torque_error"]
    return torque_error.GetOutputPort("torque_error")


def _add_correction(
    builder: DiagramBuilder, num_joints: int, sources: Mapping[str, OutputPort]
) -> dict[str, OutputPort]:
    """Adds the correction of an air pass, connects it and exports its inputs.

    Returns:
        Ports of tau_ext, tau_ext_valid (it belongs to the sample, and the correction holds) and
        corrected (the correction holds).
    """
    correction = builder.AddNamedSystem("correction", TorqueCorrection(num_joints))
    for signal in ("tau_correction", "correction_valid"):
        builder.ExportInput(correction.GetInputPort(signal), signal)
    _connect_by_name(builder, [correction], sources)
    signals = ("tau_ext", "tau_ext_valid", "corrected")
    return {signal: correction.GetOutputPort(signal) for signal in signals}


def _terms_as_read(
    builder: DiagramBuilder, estimator: WrenchEstimator, stage_terms: OutputPort | None
) -> OutputPort:
    """The model's terms at q and v as they come, for a controller.

    An impossible sample, which the estimator leaves out, must not leave the arm without its weight.

    Args:
        stage_terms: the model's terms at the samples that the check passed on, taken where these
            are q and v as they come, and so mostly not computed twice; None: computed at each tick.
    """
    block = builder.AddNamedSystem(
        "terms_as_read",
        RigidBodyTermsSystem(estimator.chain, reads_known=stage_terms is not None),
    )
    if stage_terms is not None:
        builder.Connect(stage_terms, block.GetInputPort("known"))
    for signal in ("q", "v"):
        builder.ConnectInput(signal, block.GetInputPort(signal))
    return block.GetOutputPort("terms")


def _output_ports(
    builder: DiagramBuilder, splitter_name: str, block: LeafSystem, outputs: Sequence[str]
) -> dict[str, OutputPort]:
    """Outputs of an observer or a reconstruction, by their names.

    Those of our blocks are joined in one port `reading` and split up by Drake: a port of its own
    for each signal is as many calls into Python at a tick.

    Args:
        splitter_name: of the system that splits them.
        outputs: names of the first parts of `reading`, in their order.
    """
    if not isinstance(block, ExternalTorqueObserver | JacobianWrenchReconstruction):
        return {output: block.GetOutputPort(output) for output in outputs}
    parts = builder.AddNamedSystem(splitter_name, Demultiplexer(block.reading_sizes))
    builder.Connect(block.GetOutputPort("reading"), parts.get_input_port())
    return {output: parts.get_output_port(k) for k, output in enumerate(outputs)}


def _sliding_port(builder: DiagramBuilder, friction: LeafSystem, law: FrictionLaw) -> OutputPort:
    """What the torque error needs of friction as it is now; of a block without it, the model's."""
    if friction.HasOutputPort("sliding"):
        return friction.GetOutputPort("sliding")
    model_sliding = ConstantVectorSource(SlidingLaw.of(law).flat)
    return builder.AddNamedSystem("model_sliding", model_sliding).get_output_port()


def _pole_port(builder: DiagramBuilder, observer: LeafSystem, num_joints: int) -> OutputPort:
    """The observer's pole; of a block that has none, -1: no lag."""
    if observer.HasOutputPort("pole"):
        return observer.GetOutputPort("pole")
    no_pole = ConstantVectorSource(np.full(num_joints, -1.0))
    return builder.AddNamedSystem("no_pole", no_pole).get_output_port()


def _connect_by_name(
    builder: DiagramBuilder, blocks: Sequence[LeafSystem], sources: Mapping[str, OutputPort]
) -> None:
    """Connects the inputs of blocks to the sources of their names; others are left open."""
    for block in blocks:
        for k in range(block.num_input_ports()):
            port = block.get_input_port(k)
            if port.get_name() in sources:
                builder.Connect(sources[port.get_name()], port)


def _friction_system(law: FrictionLaw, time_step: float, knows_rest: bool) -> FrictionLawSystem:
    """The block of a law, by its kind; `knows_rest` as FrictionLawSystem."""
    if isinstance(law, SemiParametricFriction):
        return SemiParametricFrictionSystem(law, knows_rest)
    if law.state_rows > 0:
        return PreslidingFrictionSystem(law, time_step, knows_rest)
    return FrictionLawSystem(law, knows_rest=knows_rest)


def _observer_system(observer: Observer) -> ExternalTorqueObserver:
    """The block of an observer, by its kind."""
    if isinstance(observer, MomentumObserver):
        return GeneralizedMomentumObserver(observer.config, observer.num_joints)
    return ExternalTorqueObserver(observer)


def _add_sample_check(
    builder: DiagramBuilder, estimator: WrenchEstimator, users_check: LeafSystem | None
) -> dict[str, OutputPort]:
    """Adds the check of the samples, and exports its inputs q, v and current as the diagram's.

    Args:
        users_check: the user's block in its place; None: ours.

    Returns:
        Ports of q, v and current as they are checked, and of fault.
    """
    if users_check is not None:
        builder.AddNamedSystem("samples", users_check)
        _export_sample_inputs(builder, users_check)
        return {signal: users_check.GetOutputPort(signal) for signal in _STAGE_OUTPUTS["samples"]}
    check = SampleCheckSystem(estimator.check, estimator.num_joints, estimator.observer.time_step)
    builder.AddNamedSystem("samples", check)
    _export_sample_inputs(builder, check)
    motion = builder.AddNamedSystem("motion", Demultiplexer(check.motion_sizes))
    builder.Connect(check.GetOutputPort("motion"), motion.get_input_port())
    fault, q, v = (motion.get_output_port(k) for k in range(3))
    return {"q": q, "v": v, "current": check.GetOutputPort("checked_current"), "fault": fault}


def _export_sample_inputs(builder: DiagramBuilder, check: LeafSystem) -> None:
    """Exports the inputs of a check of the samples as the diagram's, by their names."""
    for signal in ("q", "v", "current"):
        builder.ExportInput(check.GetInputPort(signal), signal)


def _add_users_detector(
    builder: DiagramBuilder, block: LeafSystem, sources: Mapping[str, OutputPort]
) -> None:
    """Adds a user's detector, and exports those of its outputs that ours would have."""
    detector = builder.AddNamedSystem("detection", block)
    _connect_by_name(builder, [detector], sources)
    for signal in DETECTION:
        if detector.HasOutputPort(signal):
            builder.ExportOutput(detector.GetOutputPort(signal), signal)


def _add_detector(
    builder: DiagramBuilder, detector: ContactDetector, sources: Mapping[str, OutputPort]
) -> None:
    """Adds the detector, and exports its output signal by signal."""
    detector_block = builder.AddNamedSystem("detection", ContactDetection(detector))
    _connect_by_name(builder, [detector_block], sources)
    parts = builder.AddNamedSystem("detected", Demultiplexer([1] * len(DETECTION)))
    builder.Connect(detector_block.GetOutputPort("detection"), parts.get_input_port())
    for k, signal in enumerate(DETECTION):
        builder.ExportOutput(parts.get_output_port(k), signal)


# Also what `_export_outputs` exports of a staged estimator: an output is added to both.
_FUSED_OUTPUTS = (
    "tau_ext",
    "wrench",
    "covariance",
    "condition_number",
    "valid",
    "invalid",
    "terms",
    "fault",
    "tau_f",
    "tau_ext_valid",
)


def _fused(
    estimator: WrenchEstimator,
    name: str,
    detection: ContactDetectionConfig | None,
    corrected: bool,
) -> Diagram:
    """The estimator as one block, with the outputs of the staged one (`_FUSED_OUTPUTS`).

    q, v, current --> block --> reading --> demultiplexer --> tau_ext, wrench, ... --> (detection)
                        +-----> terms, pole, sliding, tau_J ----------------------------^

    Args:
        estimator: of the block.
        name, detection, corrected: as `make_estimator`.
    """
    builder = DiagramBuilder()
    block = builder.AddNamedSystem("block", WrenchEstimatorSystem(estimator, corrected))
    for k in range(block.num_input_ports()):  # q, v, current, and those of a correction
        port = block.get_input_port(k)
        builder.ExportInput(port, port.get_name())
    # The block's port `reading` holds most signals one after another, those of `reading_sizes`; v
    # (as checked), tau_f and torque_error are always among them. Drake splits it up: a port of the
    # block for each is as many calls into Python at a tick.
    sizes = block.reading_sizes
    demultiplexer = builder.AddNamedSystem("reading", Demultiplexer(list(sizes.values())))
    builder.Connect(block.GetOutputPort("reading"), demultiplexer.get_input_port())
    ports = {signal: demultiplexer.get_output_port(k) for k, signal in enumerate(sizes)}
    for signal in ("terms", "pole", "sliding", "tau_J"):
        ports[signal] = block.GetOutputPort(signal)

    # `ports` also has v, pole, sliding and tau_J, which are the detector's alone.
    for signal in _FUSED_OUTPUTS:
        builder.ExportOutput(ports[signal], signal)
    # The torque error is an output where it was learnt from logs or a correction adds to it; else
    # it is one covariance for all samples.
    if estimator.learnt or corrected:
        builder.ExportOutput(ports["torque_error"], "torque_error")
    if detection is not None:
        # Connects its inputs to the ports of their names, and exports its outputs.
        _add_detector(builder, ContactDetector.of(estimator, detection), ports)
    diagram = builder.Build()
    diagram.set_name(name)
    return diagram


def check_ports(
    builder: DiagramBuilder, robot: Arm, sources: Mapping[str, OutputPort | None], name: str
) -> None:
    """Checks what an estimator is to be wired to, before a system is added.

    Args:
        builder: to which it will be added.
        robot: whose joints are the entries of each port.
        sources: by the estimator's inputs; None is left unconnected.
        name: of the estimator.

    Raises:
        ValueError: a port is not a vector with one entry per joint; `builder` has a system `name`.
    """
    if builder.HasSubsystemNamed(name):
        raise ValueError(f'{name}: the builder has a system of that name; pass another, name="..."')
    for signal, port in sources.items():
        if port is None:
            continue  # to be connected later, by the caller
        if not isinstance(port, OutputPort):
            kind = type(port).__name__
            raise ValueError(f"{name}: {signal} must be an output port, and is a {kind}")
        label = f"{port.get_system().get_name()}.{port.get_name()}"
        if port.get_data_type() != PortDataType.kVectorValued:
            raise ValueError(f"{name}: {signal} must be a vector, and {label} is abstract")
        if port.size() != robot.num_joints:
            raise ValueError(
                f"{name}: {signal} must have {robot.num_joints} entries, one a joint of "
                f"{robot.name}, and {label} has {port.size()}"
            )


def add_estimator_to_ports(
    builder: DiagramBuilder,
    robot: Arm,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig | None = None,
    *,
    q: OutputPort | None = None,
    v: OutputPort | None = None,
    current: OutputPort | None = None,
    name: str = "estimator",
    fused: bool = False,
    detection: ContactDetectionConfig | None = None,
    stages: Mapping[str, LeafSystem] | None = None,
    corrected: bool = False,
) -> Diagram:
    """Adds `make_estimator` to `builder` and wires its inputs to the ports that are given.

    `diagrams.estimator_in_plant.add_estimator` wires them to an arm in a MultibodyPlant.

    The inputs of a correction (`corrected`) stay unconnected: connect the estimator's
    tau_correction, correction_valid, correction_sd and, where it has one, v_planned afterwards.

    Args:
        builder: holds the systems of the given ports.
        robot, model, config, fused, detection, stages, corrected: as `make_estimator`.
        q, v, current: output ports of systems in `builder`, (n,) each; None is left unconnected.
        name: of the estimator in `builder`, which must have none of that name.

    Returns:
        the estimator, a subsystem of `builder`.

    Raises:
        InputError, ValueError: as `make_estimator`.
        ValueError: a port is not a vector with one entry per joint; `builder` has a system `name`.
    """
    sources = {"q": q, "v": v, "current": current}
    check_ports(builder, robot, sources, name)
    estimator = builder.AddSystem(
        make_estimator(
            robot,
            model,
            config,
            name=name,
            fused=fused,
            detection=detection,
            stages=stages,
            corrected=corrected,
        )
    )
    for signal, port in sources.items():
        if port is not None:
            builder.Connect(port, estimator.GetInputPort(signal))
    return estimator
