"""Shapes, colours and collision filters of a URDF: left out where Drake would not accept them.

Drake aborts the process at a box without a size, and refuses a whole robot because of a colour. An
arm whose pictures are damaged can still be read.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection
from pathlib import Path

LARGEST_SHAPE = 1e3  # m; also the largest factor that a mesh may be scaled by
_SHAPE_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "ellipsoid": {"a": 1, "b": 1, "c": 1},
}
_FILTER, _MEMBER = "drake:collision_filter_group", "drake:member"
_IGNORED = "drake:ignored_collision_filter_group"


def size_fault(shape: ET.Element) -> str:
    """The reason why a shape's size is impossible, in a few words; '' if it is not."""
    name = shape.tag.removeprefix("drake:")
    if name == "mesh":
        scale = _numbers(shape.get("scale", "1 1 1"))
        if len(scale) not in (1, 3) or not all(1e-9 < abs(x) <= LARGEST_SHAPE for x in scale):
            return "impossible scale"
        return ""
    for key, count in _SHAPE_SIZES.get(name, {}).items():
        values = _numbers(shape.get(key, ""))
        if len(values) != count or not all(0.0 < x <= LARGEST_SHAPE for x in values):
            return f"{name} without a size"
    return ""


def hull_fault(path: Path) -> str:
    """The reason why Drake can make no convex hull of a collision mesh; '' if it can."""
    from pydrake.geometry import Convex

    try:
        Convex(str(path)).GetConvexHull()
    except (RuntimeError, ValueError):
        return f"{path.suffix.lower()}, has no convex hull"
    return ""


def settle_colours(root: ET.Element, links: Collection[ET.Element]) -> None:
    """Gives each visual its material. A name without a colour, or with two, is no error."""
    colours: dict[str, list[float]] = {}
    for material in root.findall("material"):
        colours.setdefault(material.get("name", ""), _colour(material))
        root.remove(material)
    visuals = [visual for link in links for visual in link.findall("visual")]
    for visual in visuals:
        for material in visual.findall("material"):
            name = material.get("name", "")
            colours[name] = colours.get(name) or _colour(material)
    for number, visual in enumerate(visuals):
        materials = visual.findall("material")
        for material in materials:
            visual.remove(material)
        if not materials:
            continue
        colour = _colour(materials[0]) or colours.get(materials[0].get("name", ""), [])
        if colour:
            new_material = ET.SubElement(visual, "material", name=f"colour_{number}")
            ET.SubElement(new_material, "color", rgba=" ".join(repr(x) for x in colour))


def settle_filters(root: ET.Element, links: Collection[str]) -> None:
    """Keeps the collision filter groups that name links of the arm and groups that exist."""
    groups = root.findall(_FILTER)
    valid_groups: list[ET.Element] = []
    names: set[str] = set()
    for group in groups:
        name = group.get("name", "")
        for child in list(group):
            is_member = child.tag == _MEMBER and child.get("link") in links
            if not is_member and child.tag != _IGNORED:
                group.remove(child)
        if name and name not in names and group.find(_MEMBER) is not None:
            names.add(name)
            valid_groups.append(group)
        else:
            root.remove(group)
    for group in valid_groups:
        for child in group.findall(_IGNORED):
            if child.get("name") not in names:
                group.remove(child)


def _colour(material: ET.Element) -> list[float]:
    """Red, green, blue, alpha, 0 to 1; [] without a valid colour."""
    element = material.find("color")
    values = _numbers("" if element is None else element.get("rgba", ""))
    return values if len(values) == 4 and all(0.0 <= x <= 1.0 for x in values) else []


def _numbers(text: str) -> list[float]:
    """The numbers of a text; [] where a word is not a finite number."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return []
    return values if all(math.isfinite(value) for value in values) else []
