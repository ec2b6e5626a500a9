"""A simulated cycler on a CAN bus, from the same map and DBC file as the driver, with a codec of its own.

What a message that comes in means is taken from the map's commands: a signal whose value there is one argument plays
that argument's part, and a signal with a fixed number selects the command.
"""

import asyncio
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace

import can

from drivers.register_map import CanMap, Flag, Send
from simulators.can_bus import CanAction, CanBusSettings, CanPort, free_udp_port
from simulators.can_dbc import Layout, read_dbc
from simulators.clocks import SimulatedClock
from simulators.cycler import Cycler, StateRefusedError, ValueRefusedError

__all__ = ["CanDevice", "CanNode", "OnFrame"]

SENT_REMEMBERED = 256
OnFrame = Callable[[str, Mapping[str, float]], CanAction | None]
# Alarms of the simulated cycler under the names that some devices have for them.
_OTHER_NAMES = {
    "low_side_voltage": frozenset(("over_voltage", "under_voltage")),
    "low_side_current": frozenset(("over_current",)),
    "communication": frozenset(("watchdog", "client_gone")),
    "over_current": frozenset(("over_current",)),
    "temperature": frozenset(("over_temperature", "under_temperature")),
    "alarm": frozenset(
        ("over_voltage", "under_voltage", "over_current", "over_temperature", "under_temperature", "watchdog",
         "client_gone", "internal")
    ),
}  # fmt: skip
Answer = list[tuple[str, bytes]]
_CURRENTS = ("set_current", "limit_current_high", "limit_current_low")


class CanDevice:
    """The messages of a cycler.

    Parameters
    ----------
    can_map : CanMap
    cycler : Cycler
    clock : SimulatedClock

    Attributes
    ----------
    no_such_item, wrong_state, out_of_range : int
        Codes by which the device says no.
    """

    no_such_item, wrong_state, out_of_range = 1, 2, 3

    def __init__(self, can_map: CanMap, cycler: Cycler, clock: SimulatedClock) -> None:
        self.map, self.cycler, self.clock = can_map, cycler, clock
        self.node = 0
        self._arguments = {n for c in can_map.commands.values() for e in c.send.values.values() for n in e.names}
        # A device without a heartbeat of its own is kept awake by any command.
        self._beats = "heartbeat" in self._arguments or "heartbeat" in can_map.commands
        if "remote" not in self._arguments:
            cycler.set_remote(True)  # a device that takes commands whenever they come
        self._voltage_limit_V = 0.0
        self.layouts = read_dbc(can_map.dbc)
        self.layouts |= {name: self.layouts[view.message] for name, view in can_map.views.items()}
        sends = [command.send for command in can_map.commands.values()] + [ask.send for ask in can_map.asks.values()]
        told = [self.layouts[send.message] for send in sends]
        self._told = {(layout.id, layout.extended): layout for layout in told}
        self._lengths = {(send.message, send.length or layout.length) for send, layout in zip(sends, told, strict=True)}
        s = cycler.settings
        self._constants = {
            "i_nom": s.nominal_current_A,
            "v_nom": s.nominal_voltage_V,
            "p_nom": s.nominal_current_A * s.nominal_voltage_V,
        }
        self._turn = -1.0 if can_map.positive_current == "discharge" else 1.0

    def poll(self) -> None:
        """Let simulated time catch up with the clock."""
        self.clock.poll(self.cycler)

    def heard(self) -> None:
        """Catch up, then note that a client has sent a message."""
        self.poll()
        self.clock.heard()

    def rest(self) -> None:
        """Switch the output off, as a device does that is being shut down."""
        self.cycler.set_output(False)

    def layout_of(self, identifier: int, *, extended: bool) -> Layout | None:
        """Return the message that the bench sends under an identifier of node 0."""
        return self._told.get((identifier, extended))

    def takes(self, layout: Layout, length: int) -> bool:
        """Whether a message of the bench may be so long."""
        return (layout.name, length) in self._lengths

    def answer(self, message: str, raws: Mapping[str, float], length: int) -> Answer:
        """Execute a message of the bench and return what the device answers."""
        values = {name: self._physical(message, name, raw) for name, raw in raws.items()}
        for ask in self.map.asks.values():
            arguments = self._match(ask.send, values) if self._fits(ask.send, message, length) else None
            if arguments is not None:
                return [(reply, self._message(reply, arguments)) for reply in ask.replies]
        for command in self.map.commands.values():
            arguments = self._match(command.send, values) if self._fits(command.send, message, length) else None
            if arguments is not None:
                code = self._execute(arguments)
                if command.name == "heartbeat" or not self._beats:
                    self.cycler.heartbeat()
                if code is not None:
                    return self.refused(code)
                told_at_once = command.echo and command.ask is None
                return [(command.echo, self._repeated(command.echo, raws))] if command.echo and told_at_once else []
        return self.refused(self.no_such_item)

    def _physical(self, message: str, name: str, raw: float) -> float:
        signal = self.layouts[message].signals[name]
        return raw if signal.floating else raw * signal.factor + signal.offset

    def _fits(self, send: Send, message: str, length: int) -> bool:
        return send.message == message and length == (send.length or self.layouts[message].length)

    def _match(self, send: Send, values: Mapping[str, float]) -> dict[str, float] | None:
        """Return the arguments that a message carries, None if its fixed numbers are others."""
        arguments: dict[str, float] = {}
        for signal, expression in send.values.items():
            names = expression.names - set(self._constants)
            at = dict(self._constants) | dict.fromkeys(names, 0.0)
            zero = expression.evaluate(at)
            if not names:
                if values[signal] != zero:
                    return None
                continue
            (name,) = names
            slope = expression.evaluate(at | {name: 1.0}) - zero
            arguments[name] = (values[signal] - zero) / slope
        return arguments

    def refused(self, code: int) -> Answer:
        """Return how the device says no; nothing where it cannot."""
        refusal = self.map.refusal
        if refusal is None:
            return []
        name = refusal.name
        view = self.map.views.get(name.message)
        fixed: Mapping[str, float] = {} if view is None else view.where
        return [(name.message, self.layouts[name.message].encode_raw({**fixed, name.signal: code}))]

    def _repeated(self, echo: str, raws: Mapping[str, float]) -> bytes:
        layout = self.layouts[echo]
        return layout.encode_raw({name: raw for name, raw in raws.items() if name in layout.signals})

    # --- what the bench tells ------------------------------------------------------------------------------
    def _execute(self, arguments: Mapping[str, float]) -> int | None:
        """Take over a command as a whole; return the code of a refusal."""
        told = {name: value * self._turn if name in _CURRENTS else value for name, value in arguments.items()}
        told.pop("direction", None)  # follows from the two set-points
        if "charge" in told or "discharge" in told:
            now_A = self.cycler.requested_A
            sides = told.pop("charge", max(now_A, 0.0)), told.pop("discharge", max(-now_A, 0.0))
            told["set_current"] = sides[0] - sides[1]
        if not all(math.isfinite(value) for value in told.values()):
            return self.out_of_range
        if "clear_alarms" not in self._arguments:
            self.cycler.alarms.clear()  # some devices forget an error with the next valid frame
        try:
            self._check(told)
        except ValueRefusedError:
            return self.out_of_range
        except StateRefusedError:
            return self.wrong_state
        for name in ("clear_alarms", "remote", "output", "set_current", "heartbeat"):
            if name in told:
                self._take(name, told[name])
        for name, value in told.items():
            if name not in ("clear_alarms", "remote", "output", "set_current", "heartbeat", "lock_step"):
                self._take(name, value)
        if "lock_step" in told:
            self.clock.move_to(int(told["lock_step"]), self.cycler)
        return None

    def _check(self, told: Mapping[str, float]) -> None:
        if "set_current" in told:
            self.cycler.check_set_point(told["set_current"])
        if "lock_step" in told:
            self.clock.check_tick(int(told["lock_step"]))
        if told.get("output"):
            alarms = bool(self.cycler.alarms) and not told.get("clear_alarms")
            self.cycler.check_output(remote=bool(told.get("remote", self.cycler.remote)), alarms=alarms)
        if told.get("ramp", 0.0) < 0.0 or told.get("watchdog", 1.0) <= 0.0 or told.get("lock_step_period", 1.0) <= 0.0:
            raise ValueRefusedError("a time or a ramp below zero")

    def _take(self, name: str, value: float) -> None:
        cycler = self.cycler
        if name == "clear_alarms" and value:
            cycler.alarms.clear()
        elif name == "remote":
            cycler.set_remote(bool(value))
        elif name == "output":
            cycler.set_output(bool(value))
        elif name == "set_current":
            cycler.set_current(value)
        elif name == "heartbeat":
            cycler.heartbeat()
        elif name == "voltage_limit":
            self._voltage_limit_V = value
        elif name == "watchdog":
            cycler.watchdog_s = value
            cycler.heartbeat()
        elif name == "lock_step_period":
            self.clock.set_period(value)
        elif name == "ramp":
            cycler.ramp_A_per_s = None if value in (0.0, self.map.unlimited_ramp) else value
        elif name.startswith("limit_"):
            cycler.set_limit(name.removeprefix("limit_"), value)

    # --- what the device tells -----------------------------------------------------------------------------
    def _message(self, name: str, arguments: Mapping[str, float]) -> bytes:
        layout, raws = self.layouts[name], self._held(name)
        token = self.map.token.get(name)
        if token is not None:
            raws[token] = arguments.get("token", 0.0)
        identity, equals = self.map.identity
        if identity.message == name:
            raws[identity.signal] = self._raw(name, identity.signal, equals[0] if equals else self.node)
        for constant, signal in self.map.constants.items():
            if signal.message == name:
                raws[signal.signal] = self._raw(name, signal.signal, self._constants[constant])
        for key, role in self.map.roles.items():
            if role.name.message == name:
                raws[role.name.signal] = self._role_raw(key)
            if role.negative is not None and role.negative.name.message == name and self._role_value(key) < 0.0:
                _raise_flag(raws, role.negative)
        status = self._status()
        for flags, names in ((self.map.status, status), (self.map.alarms, self.cycler.alarms)):
            for flag, where in flags.items():
                if where.name.message == name and (flag in names or _OTHER_NAMES.get(flag, frozenset()) & names):
                    _raise_flag(raws, where)
        return layout.encode_raw(raws)

    def _held(self, name: str) -> dict[str, float]:
        """What a message tells of the last command where that is asked for: what was taken, not what was sent."""
        cycler, raws = self.cycler, dict[str, float]()
        state = {
            "set_current": cycler.requested_A * self._turn,
            "output": float(cycler.output_on),
            "remote": float(cycler.remote),
            "watchdog": cycler.watchdog_s,
            "voltage_limit": self._voltage_limit_V,
            "charge": max(cycler.requested_A, 0.0),
            "discharge": max(-cycler.requested_A, 0.0),
            "direction": float(cycler.requested_A < 0.0),
        }
        state |= {
            f"limit_{key}": value * (self._turn if "current" in key else 1.0) for key, value in cycler.limits.items()
        }
        view = self.map.views.get(name)
        raws |= {} if view is None else {signal: float(value) for signal, value in view.where.items()}
        for command in self.map.commands.values():
            if not (name in self.map.shared and command.send.message == name) and command.echo != name:
                continue
            for signal, expression in command.send.values.items():
                if expression.names and expression.names <= state.keys() | self._constants.keys():
                    raws[signal] = self._raw(name, signal, expression.evaluate(self._constants | state))
        return raws

    def _status(self) -> frozenset[str]:
        status = self.cycler.status
        return status | {"lock_step"} if self.clock.lock_step else status

    def _raw(self, message: str, signal: str, value: float) -> float:
        found = self.layouts[message].signals[signal]
        return value if found.floating else (value - found.offset) / found.factor

    def _role_raw(self, key: str) -> float:
        role, value = self.map.roles[key], self._role_value(key)
        if math.isnan(value) and role.invalid:
            return min(role.invalid)
        scale = role.scale.evaluate(self._constants) if role.scale else 1.0
        if key in ("actual_current", "setpoint_in_force"):
            value *= self._turn
        if role.negative is not None:
            value = abs(value)
        return self._raw(role.name.message, role.name.signal, value / scale)

    def _role_value(self, key: str) -> float:
        cycler = self.cycler
        seen = cycler.measurement
        return {
            "sequence": float(cycler.sequence),
            "actual_voltage": seen.voltage_V,
            "actual_current": seen.current_A,
            "temperature": seen.temperature_degC,
            "ambient_temperature": seen.ambient_degC,
            "setpoint_in_force": cycler.set_point_A,
            "serial": float(cycler.settings.serial),
            "lock_step_available": float(self.clock.lock_step),
            "lock_step": float(self.clock.tick),
        }[key]


def _raise_flag(raws: dict[str, float], flag: Flag) -> None:
    """Put a flag into the raw values of its message."""
    signal = flag.name.signal
    raws[signal] = min(flag.values, default=1) if flag.bit is None else int(raws.get(signal, 0.0)) | 1 << flag.bit


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
        layout = self.device.layout_of(message.arbitration_id - self._shift, extended=message.is_extended_id)
        if layout is None or not self.device.takes(layout, len(message.data)):
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
