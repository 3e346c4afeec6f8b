"""The CAN bus between `emcb_200u_driver` and the machine, through python-can."""

from dataclasses import dataclass, field
from typing import Any

import can

from pipeline.errors import InputError


@dataclass
class CanBusConfig:
    """Arguments of `can.Bus`.

    Attributes:
        interface: python-can's name: `socketcan` or that of the adapter; `udp_multicast` connects processes of one host
            without hardware (`virtual` connects only threads of one process).
        channel: channel of the interface.
        options: further arguments.
    """

    interface: str
    channel: str
    options: dict[str, Any] = field(default_factory=dict)


def open_bus(config: CanBusConfig) -> can.BusABC:
    """Open the bus.

    Raises:
        InputError: the bus is missing, or python-can cannot drive it.
    """
    try:
        return can.Bus(interface=config.interface, channel=config.channel, **config.options)
    except (can.CanError, OSError, ImportError, ValueError, TypeError) as error:
        raise InputError(
            f"can.interface={config.interface} can.channel={config.channel}: {error}; see python-can's interfaces"
        ) from error
