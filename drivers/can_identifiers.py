"""Which identifier each message of one node has on the bus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.address import CanAddress
from drivers.errors import CyclerConnectionError

STANDARD_IDS, EXTENDED_IDS = 0x7FF, 0x1FFFFFFF


@dataclass(frozen=True, slots=True)
class CanIdentifiers:
    """Identifiers of a node's messages; `extended` says that they have 29 bits.

    Attributes
    ----------
    sends : mapping of str to int
        Identifier of each message of the bench.
    receives : mapping of int to str
        Message of the device under each identifier.
    """

    sends: Mapping[str, int]
    receives: Mapping[int, str]
    extended: bool


def identifiers_of(
    address: CanAddress, sends: Mapping[str, int], receives: Mapping[str, int], node_step: int
) -> CanIdentifiers:
    """Shift the identifiers of node 0 to those of a node.

    Parameters
    ----------
    address : CanAddress
        Names the node.
    sends, receives : mapping of str to int
        Identifiers of node 0 by message name, for the messages of each direction.
    node_step : int
        Added to identifiers per node number.

    Raises
    ------
    CyclerConnectionError
        If an identifier becomes too large.
    """
    shift = node_step * address.node
    sent = {name: identifier + shift for name, identifier in sends.items()}
    received = {identifier + shift: name for name, identifier in receives.items()}
    highest = max([*sent.values(), *received], default=0)
    plain = max([*sends.values(), *receives.values()], default=0) <= STANDARD_IDS
    if highest > (STANDARD_IDS if plain else EXTENDED_IDS):
        raise CyclerConnectionError(f"{address}: node {address.node} needs identifier 0x{highest:X}; too large")
    return CanIdentifiers(sent, received, not plain)
