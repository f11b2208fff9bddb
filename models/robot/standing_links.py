"""What stands around an arm: the links of its machine that its base does not carry.

A torso's arm may hit the machine's own base. Such links stand still, each by its pose in the base
link's frame; of them only the collision shapes count, and only where distances are kept.
"""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping

from pydrake.math import RigidTransform, RollPitchYaw


def standing_links(
    base: str,
    standing: Collection[str],
    links: Mapping[str, ET.Element],
    joints: Mapping[str, tuple[str, str, RigidTransform]],
) -> dict[str, tuple[ET.Element, ET.Element]]:
    """The links that have collision shapes, each with the fixed joint that places it.

    Args:
        base: the link whose frame is W.
        standing: names of the links that it does not carry.
        links: of the whole machine, by name.
        joints: parent, child and pose of the child in the parent, by name; a tree.
    """
    parent = {child: (above, pose) for above, child, pose in joints.values()}

    def in_root(name: str) -> RigidTransform:
        pose = RigidTransform()
        while name in parent:
            name, step = parent[name]
            pose = step @ pose
        return pose

    X_BR = in_root(base).inverse()
    found: dict[str, tuple[ET.Element, ET.Element]] = {}
    for name in standing:
        shapes = links[name].findall("collision")
        if not shapes:
            continue
        link = ET.Element("link", name=name)
        link.extend(shapes)
        pose = X_BR @ in_root(name)
        joint = ET.Element("joint", name=f"{name} stands", type="fixed")
        ET.SubElement(joint, "parent", link=base)
        ET.SubElement(joint, "child", link=name)
        xyz, rpy = pose.translation(), RollPitchYaw(pose.rotation()).vector()
        ET.SubElement(
            joint,
            "origin",
            xyz=" ".join(repr(float(x)) for x in xyz),
            rpy=" ".join(repr(float(x)) for x in rpy),
        )
        found[name] = (link, joint)
    return found
