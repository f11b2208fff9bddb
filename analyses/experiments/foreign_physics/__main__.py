"""One log of a foreign arm, simulated and read: files to look at, in seconds.

    python -m wrenchsight.analyses.experiments.foreign_physics ur10e steps --out out/foreign

writes below `out/foreign/ur10e_0/` identification_0.parquet, identification_1.parquet, model.yaml
(robot.yaml too, where the arm is drafted), which are made once for a draw, and per case
`steps/`: log.parquet, truth.csv (force first, environment on robot at E in axes of W) and
estimate/, and prints the figures.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from wrenchsight.analyses.experiments.foreign_physics.arms import ARMS
from wrenchsight.analyses.experiments.foreign_physics.cases import CASES
from wrenchsight.analyses.experiments.foreign_physics.drawn_arm import DrawnArm
from wrenchsight.analyses.output.console import show
from wrenchsight.analyses.output.outputs import json_text, plain_metrics
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES


def main(
    arm: Annotated[str, typer.Argument(help=f"One of {', '.join(ARMS)}.")],
    cases: Annotated[list[str], typer.Argument(help=f"Any of {', '.join(CASES)}; or `all`.")],
    draw: Annotated[int, typer.Option(help="Seed of the true arm.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder.")] = Path("out/foreign"),
    read: Annotated[bool, typer.Option(help="Identify and estimate; else logs alone.")] = True,
    plain: Annotated[bool, typer.Option(help="Figures of plain tools beside.")] = False,
) -> None:
    """Simulate a drawn arm in MuJoCo and read its logs as the documentation says."""
    drawn = DrawnArm.identify(arm, draw, out / f"{arm}_{draw}", keeps=True)
    for case in CASES if cases == ["all"] else cases:
        folder = drawn.folder / case
        log = drawn.simulate(case)
        folder.mkdir(parents=True, exist_ok=True)
        truth = np.column_stack([log.recording.t, np.roll(log.wrench, 3, axis=1)])
        header = ",".join(["t", *(f"true_{axis}" for axis in WRENCH_AXES)])
        np.savetxt(folder / "truth.csv", truth, "%.6g", ",", header=header, comments="")
        if not read:
            drawn.write(case, log)
            continue
        reading = drawn.read(case, log)
        found = drawn.figures(case, log, reading, plain)
        show(f"{arm} {draw} {case}", json_text(plain_metrics(found)).strip())
        show(*([reading.refusal] if reading.refusal else reading.sentences))


if __name__ == "__main__":
    typer.run(main)
