"""The outputs of a block that computes all of them at once."""

from typing import Protocol

from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer


class JoinedOutputs(Protocol):
    """A block with outputs of `systems.declarations.declare_outputs`.

    Attributes:
        output_sizes: of the parts of the port `all`, by name, in their order.
    """

    output_sizes: dict[str, int]

    def get_name(self) -> str:
        """Its name in the diagram."""

    def GetOutputPort(self, port_name: str) -> OutputPort:
        """A port by its name."""


def split_outputs(builder: DiagramBuilder, block: JoinedOutputs) -> dict[str, OutputPort]:
    """The outputs of a block by name, split up by Drake: one call into Python for all of them."""
    sizes = block.output_sizes
    parts = Demultiplexer(list(sizes.values()))
    builder.AddNamedSystem(f"{block.get_name()}_outputs", parts)
    builder.Connect(block.GetOutputPort("all"), parts.get_input_port())
    return {name: parts.get_output_port(k) for k, name in enumerate(sizes)}
