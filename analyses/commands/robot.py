"""The command `robot`: a robot.yaml from a URDF, and what stands in one."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchsight.analyses.output.console import new_table, notes, show
from wrenchsight.analyses.output.marked_page import refuse_unmarked, write_marked
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.models.robot.robot import Robot

ORDER = 5
_FORM = "urdf"  # that `robot export` writes where none is given


def command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="URDF | show | export",
            help="A URDF, SDF, MJCF or xacro; or `show`, `export`.",
        ),
    ],
    robot: Annotated[
        str | None,
        typer.Argument(metavar="[ROBOT]", help="After `show` or `export`: a name or a robot.yaml."),
    ] = None,
    base: Annotated[str | None, typer.Option(help="Link whose frame is W; else the root.")] = None,
    flange: Annotated[
        str | None, typer.Option(help="Link that carries the tool; else the end of the only arm.")
    ] = None,
    xacro_arg: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME:=VALUE", help="An argument of a xacro file; may be repeated."),
    ] = None,
    trust_xacro: Annotated[
        bool, typer.Option("--trust-xacro", help="Let a xacro file run: it is its author's code.")
    ] = False,
    model: Annotated[
        Path | None, typer.Option(help="With `export`: the model.yaml of `identify`.")
    ] = None,
    to: Annotated[str, typer.Option(help="With `export`: urdf or mjcf (MuJoCo).")] = _FORM,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The robot.yaml (robot.yaml); with `show` the page (arm.html), with `export` the "
            "file (NAME.urdf, NAME.xml)."
        ),
    ] = None,
) -> None:
    """Draft a robot.yaml from a URDF, draw a robot (`show`) or write an identified one (`export`).

    `robot show ROBOT` prints and draws it; `robot export [ROBOT] --model MODEL --to mjcf` writes
    inertias, rotors and friction of a model as a file for simulators.
    """
    of_export = {"--model": model is not None, "--to": to != _FORM}
    of_draft = {
        "--base": base is not None,
        "--flange": flange is not None,
        "--xacro-arg": bool(xacro_arg),
        "--trust-xacro": trust_xacro,
    }
    if source != "export":
        _refuse(of_export, "`robot export`")
    if source in ("export", "show"):
        _refuse(of_draft, "`robot URDF`")
    if source == "export":
        _export(robot, model, to, out)
        return
    if source == "show":
        if robot is None:
            raise InputError("robot show", "", "names no robot", "give a name or a robot.yaml")
        _show(robot, out or Path("arm.html"))
        return
    if robot is not None:
        raise InputError(robot, "", "is one argument too many", "write `robot URDF`")
    from wrenchsight.analyses.methods.robot.draft_text import FILL_IN
    from wrenchsight.analyses.methods.robot.robot_draft import XacroTrust, draft_robot

    path = out or Path("robot.yaml")
    xacro = XacroTrust(is_trusted=trust_xacro, arguments=_arguments(xacro_arg or []))
    draft = draft_robot(Path(source), path, base=base, flange=flange, xacro=xacro)
    _print(draft.robot)
    show(*notes(draft.notes))
    # The draft assumes friction from the inertias: without these, or masses, it states none.
    truth = draft.robot.config.simulated_truth
    has_friction = truth.friction.coulomb.size > 0
    note = (
        "friction, rotors, noise and resolution of the simulated arm are assumed: see "
        "simulated_truth and drives in the file"
        if has_friction
        else "the URDF has no inertias: the simulated arm has no friction; state it in "
        "simulated_truth"
    )
    if truth.link_masses:
        note = f"the URDF's missing masses are assumed in simulations alone; {note}"
    show(f"note: {note}", f"robot: {path}; look for {FILL_IN}: {', '.join(draft.places)}")


def _refuse(given: dict[str, bool], form: str) -> None:
    """Raises InputError for the first option that is given and belongs to another form."""
    for option, is_given in given.items():
        if is_given:
            raise InputError(
                "robot", option, f"belongs to {form}", f"write {form}, or leave it out"
            )


def _arguments(words: list[str]) -> dict[str, str]:
    """Arguments of a xacro file by name."""
    pairs = [word.partition(":=") for word in words]
    for word, (name, sign, _) in zip(words, pairs, strict=True):
        if not (name and sign):
            raise InputError("--xacro-arg", "", f"is {word!r}", "write NAME:=VALUE")
    return {name: value for name, _, value in pairs}


def _export(robot: str | None, model: Path | None, form: str, out: Path | None) -> None:
    from wrenchsight.analyses.methods.robot.robot_export import export_robot

    if model is None:
        problem = "is missing: what is exported is an identified arm"
        raise InputError("robot export", "--model", problem, "give the model.yaml of `identify`")
    exported = export_robot(model, form, out, robot)
    friction = exported.friction
    table = new_table(
        "joint", "rotor\n[kg m^2]", "Coulomb\n[N m]", "viscous\n[N m s/rad]", "law's rest\n[N m]"
    )
    columns = (exported.rotors, friction.coulomb, friction.viscous)
    for j, name in enumerate(exported.robot.joint_names):
        table.add_row(name, *(f"{values[j]:.3g}" for values in columns), f"{friction.error[j]:.2f}")
    show(
        table,
        "note: law's rest is the largest part of the identified friction, sliding without load, "
        "that Coulomb and viscous friction leave out; memory and dependence on load are left out, "
        "too",
    )
    if form == "urdf":
        show("note: Drake reads damping and rotors of this file, and no Coulomb friction")
    if exported.robot.is_coupled:
        show(
            "note: motors move several joints each, for which the file has no element: rotors and "
            "friction are those of a joint that moves alone; left out are rotors of up to "
            f"{exported.uncoupled:.3g} kg m^2 between joints, and friction by others' motion"
        )
    show(f"{form}: {exported.path}")


def _show(name: str, out: Path) -> None:
    from pydrake.geometry import Meshcat

    from wrenchsight.diagrams.pages.arm_picture import ArmPicture
    from wrenchsight.models.robot.robot import Robot

    refuse_unmarked(out)
    # Drake prints Meshcat's address, which is gone before anyone could open it. A mesh that it
    # cannot read is in the robot's notices.
    logging.getLogger("drake").setLevel(logging.ERROR)
    robot = Robot.load(name)
    _print(robot)
    meshcat = Meshcat()
    ArmPicture(robot, meshcat).show(robot.home)
    write_marked(out, meshcat.StaticHtml())
    show(f"picture at home: {out}")


def _print(robot: "Robot") -> None:
    table = new_table("joint", "from", "to", "speed", "effort", "N m/A", "rotor\n[kg m^2]", "home")
    columns = (
        robot.position_lower,
        robot.position_upper,
        robot.velocity_limit,
        robot.effort_limit,
        robot.torque_per_ampere,
        robot.reflected_inertia,
        robot.home,
    )
    for j, name in enumerate(robot.joint_names):
        cells = [f"{values[j]:.4g}" for values in columns]
        table.add_row(name, *cells)
    mass = float(robot.chain.inertial_parameters[:, 0].sum())
    lost_shapes = (f"collision shape lost: {link}" for link in robot.unusable_collisions)
    show(
        table,
        f"{robot.name}: {robot.num_joints} joints from {robot.config.base_link} to "
        f"{robot.config.flange}, {mass:.3g} kg moving, payload {robot.payload:g} kg, condition "
        f"number at home {float(robot.chain.condition_number(robot.home)):.3g}",
        *notes((*robot.notices, *lost_shapes)),
    )
