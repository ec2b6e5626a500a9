"""A simulated cycler on a CAN bus: frames in and out, and the seam by which faults come in."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace

from simulators.can_bus import CanAction, CanBusSettings, CanPort, free_udp_port
from simulators.can_device import Answer, CanDevice
from simulators.python_can import can

__all__ = ["CanNode", "OnFrame"]

SENT_REMEMBERED = 256
OnFrame = Callable[[str, Mapping[str, float]], CanAction | None]


class CanNode:
    """Serves one device on a bus.

    Parameters
    ----------
    device : CanDevice
    settings : CanBusSettings
    on_frame : Callable, optional
        Seam for faults: gets name and raw values of each frame for this node, and returns a `CanAction`, or None to
        let it pass. May be set or replaced while the node runs.
    """

    def __init__(self, device: CanDevice, settings: CanBusSettings, on_frame: OnFrame | None = None) -> None:
        self.device = device
        self.on_frame = on_frame
        if settings.interface == "udp_multicast" and settings.port == 0:
            settings = replace(settings, port=free_udp_port())
        self.settings = settings
        device.node = settings.node
        self._shift = device.map.node_step * settings.node
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=SENT_REMEMBERED)
        self._port: CanPort | None = None

    @property
    def address(self) -> str:
        """The URL by which a bench finds this node."""
        s = self.settings
        port = f":{s.port}" if s.interface == "udp_multicast" else ""
        return f"can://{s.interface}/{s.channel}{port}?node={s.node}"

    async def start(self) -> str:
        """Join the bus and return the address.

        Raises
        ------
        OSError, can.CanError
            If the bus cannot be joined.
        """
        self._port = CanPort(self.settings, self.device.map.fd, self._received)
        return self.address

    async def close(self) -> None:
        """Leave the bus."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _received(self, message: can.Message) -> None:
        if message.is_error_frame or message.is_remote_frame:
            return
        layout = self.device.requests.layout_of(message.arbitration_id - self._shift, extended=message.is_extended_id)
        if layout is None or not self.device.requests.takes(layout, len(message.data)):
            return
        if (message.arbitration_id, bytes(message.data)) in self._sent:
            self._sent.remove((message.arbitration_id, bytes(message.data)))
            return  # multicast hands back what this node has sent under a shared identifier
        raws = layout.decode_raw(bytes(message.data).ljust(layout.length, b"\0"))
        action = (self.on_frame(layout.name, raws) if self.on_frame else None) or CanAction()
        if action.bus_off and self._port is not None:
            self._port.send_bus_off()
            return
        if action.echo and self._port is not None:
            self._port.send(message.arbitration_id, bytes(message.data), extended=message.is_extended_id)
        if action.refuse is not None:
            self._send(self.device.refused(action.refuse), action)
        if not action.execute:
            return
        self.device.heard()
        answer = self.device.answer(layout.name, raws, len(message.data))
        if not action.reply:
            return
        if action.delay_s > 0.0:
            asyncio.get_running_loop().call_later(action.delay_s, self._send, answer, action)
        else:
            self._send(answer, action)

    def _send(self, answer: Answer, action: CanAction) -> None:
        for name, data in answer:
            view = self.device.map.views.get(name)
            data = data if view is None else data[: view.length]
            changed = data if action.change is None else action.change(name, data)
            if changed is not None and self._port is not None:
                layout = self.device.layouts[name]
                if name in self.device.map.shared and self.settings.interface == "udp_multicast":
                    self._sent.append((layout.id + self._shift + action.shift, changed))
                self._port.send(layout.id + self._shift + action.shift, changed, extended=layout.extended)
