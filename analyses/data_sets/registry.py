"""The sets of recordings that the experiments use: robot, licence, source and files of each.

What can be fetched is in `sources.csv` beside this file, one published file a line: where it
belongs, repository, commit and path there, licence, bytes and SHA-256. To add a set: an entry in
DATA_SETS, and its lines in `sources.csv`, or a folder in `examples/recordings` where its licence
allows that.
"""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from wrenchsight.models.files.input_error import InputError

_SOURCES: Final = Path(__file__).with_name("sources.csv")


@dataclass(frozen=True)
class KnownFile:
    """A file of a set whose content is known."""

    name: str  # in the set's folder
    num_bytes: int
    sha256: str


@dataclass(frozen=True)
class PublishedFile(KnownFile):
    """A file of a set as its authors published it."""

    repository: str  # owner/name on github.com
    commit: str
    path: str  # in the repository

    @property
    def address(self) -> str:
        """The file's path below a mirror, and below the public host of raw files."""
        return f"{self.repository}/{self.commit}/{self.path}"


@dataclass(frozen=True)
class DataSet:
    """A set of recordings: a folder of files that belong together.

    Attributes:
        name: name of the folder, and on the command line.
        contents: which motion, which sensors; one line.
        source: where it is published.
        megabytes: megabytes of its files.
        advice: what to do where the set is not there and cannot be fetched.
        converted: files that `conversion` makes of the published ones.
        part_of: the set whose given folder may hold the converted files as well.
    """

    name: str
    robot: str
    contents: str
    licence: str
    source: str
    paper: str
    megabytes: float
    advice: str = ""
    converted: tuple[KnownFile, ...] = ()
    part_of: str = ""

    @property
    def published(self) -> tuple[PublishedFile, ...]:
        """The files that `data fetch` gets; none where it cannot."""
        return _published().get(self.name, ())

    @property
    def files(self) -> tuple[KnownFile, ...]:
        """The files of the set in the user's cache, once it was fetched."""
        return (*self.published, *self.converted)


_UR10E = "github.com/shamilmamedov/dynamic_calibration"
_MAMEDOV = (
    "Mamedov, Mikhel: Practical Aspects of Model-Based Collision Detection, Front. Robot. AI 7 "
    "(2020), doi 10.3389/frobt.2020.571574"
)
_IN_REPOSITORY = (
    "it comes with the repository: clone it, and run there or give `--data` its folder "
    "examples/recordings"
)

DATA_SETS: Final[dict[str, DataSet]] = {
    entry.name: entry
    for entry in (
        DataSet(
            name="ur10e",
            robot="Universal Robots UR10e",
            contents="motor currents in excitation motions, single joints and with a known payload",
            licence="none stated",
            source=_UR10E,
            paper=_MAMEDOV,
            megabytes=16.9,
        ),
        DataSet(
            name="ur10e_more",
            robot="Universal Robots UR10e",
            contents="the arm on other days, standing still, with another payload, hit by hand",
            licence="none stated",
            source=_UR10E,
            paper=_MAMEDOV,
            megabytes=7.9,
        ),
        DataSet(
            name="ur10e_pushes",
            robot="Universal Robots UR10e",
            contents="the same arm standing still, pushed four times by hand; no force sensor",
            licence="none stated",
            source=_UR10E,
            paper=_MAMEDOV,
            megabytes=0.4,
            converted=(
                KnownFile(
                    "push_pose_1.csv",
                    422841,
                    "c23861caa5ecc866a0532d46a745b7e02f9ca270ced545bfcc148e1b1f987013",
                ),
                KnownFile(
                    "recording.yaml",
                    653,
                    "e8b0e1c7e4be2ea16a87556ebcca1e13c76c2f604ae97ae38cf490a84a58b56c",
                ),
                KnownFile(
                    "pushes.csv",
                    87,
                    "dc9c134ac0ac67af06258c54125a6a4c4d2b3d062de61c9cab0f9a38e26e9442",
                ),
            ),
        ),
        DataSet(
            name="ur10e_contact",
            robot="Universal Robots UR10e",
            contents="a roller pressed on and along a workpiece, force sensor under the workpiece",
            licence="GPL-3.0",
            source="github.com/JKU-Linz-Institute-of-Robotics/ur10e_force_control_comparison",
            paper=(
                "Gadringer, Gattringer, Müller: Assessment of force control for surface finishing, "
                "Mech. Sci. 13 (2022), 361-370"
            ),
            megabytes=40.0,
            advice="ask the maintainers for it; docs/data.md says how it is made of the plots",
        ),
        DataSet(
            name="panda_ati_gamma",
            robot="Franka Emika Panda",
            contents="one load laid on a pad at ten postures, joint torque beside a force sensor",
            licence="Apache-2.0",
            source="github.com/rayangdn/virtual_tactile_pad",
            paper="",
            megabytes=15.0,
        ),
        DataSet(
            name="link_contact",
            robot="Franka Emika Panda",
            contents="touched link by link at rest, joint torque, labels of contact and link",
            licence="MIT",
            source="github.com/MindLabZHAW/tactileGestureDetection",
            paper=(
                "Rezayati et al.: Improving safety in physical human-robot collaboration via deep "
                "metric learning (2022), arXiv 2302.11933"
            ),
            megabytes=3.6,
            advice=_IN_REPOSITORY,
        ),
        DataSet(
            name="neura_lara8",
            robot="NEURA LARA 8",
            contents="motor torque with and without loads, force/torque sensor at the wrist",
            licence="BSD-3-Clause",
            source="github.com/allwinlucious/MasterThesis",
            paper="Lucious: master's thesis, RWTH Aachen (2024)",
            megabytes=3.3,
            advice=_IN_REPOSITORY,
        ),
        DataSet(
            name="neura_lara8_urdf",
            robot="NEURA LARA 8",
            contents="the maker's description of the arm: its masses; without it, fitted ones",
            licence="none stated",
            source="github.com/shirinshevidi/Lara8_ros_Rviz",
            paper="",
            megabytes=0.01,
            converted=(
                KnownFile(
                    "robot.urdf",
                    3912,
                    "a920a8095f98b30545e8191d20aa79bcb398330cc091fe64de5ad76eff8ca27c",
                ),
                KnownFile(
                    "robot.yaml",
                    1367,
                    "c794e7d08f79f59dd34f6ac29b2ad4d8a9d0c4104639461a9900e6d1ad7cb929",
                ),
            ),
            part_of="neura_lara8",
        ),
        DataSet(
            name="staubli_tx40",
            robot="Staubli TX40",
            contents="excitation of 9 s at full speed, motor torque, coupled wrist; no contact",
            licence="none stated",
            source="github.com/thanhndv212/figaroh-examples",
            paper="Nguyen et al.: FIGAROH (2023), hal-04234676",
            megabytes=2.9,
            advice="ask the maintainers for it; docs/data.md says how it is made",
        ),
    )
}


def data_set(name: str) -> DataSet:
    """The set of this name.

    Raises:
        InputError: there is none; the line lists the known ones.
    """
    if name not in DATA_SETS:
        remedy = f"known are {', '.join(DATA_SETS)}"
        raise InputError("data", "", f"no set of recordings is named {name!r}", remedy)
    return DATA_SETS[name]


@cache
def _published() -> dict[str, tuple[PublishedFile, ...]]:
    """The lines of `sources.csv` by set."""
    files: dict[str, tuple[PublishedFile, ...]] = {}
    with _SOURCES.open(encoding="utf-8", newline="") as table:
        for row in csv.DictReader(table):
            folder, _, name = row["file"].partition("/")
            file = PublishedFile(
                name=name,
                repository=row["repository"],
                commit=row["commit"],
                path=row["path"],
                num_bytes=int(row["bytes"]),
                sha256=row["sha256"],
            )
            files[folder] = (*files.get(folder, ()), file)
    return files
