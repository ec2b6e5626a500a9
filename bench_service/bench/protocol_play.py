"""A protocol as the loop plays it: samples of a cycler into the engine, its counters into rows for the recorder."""

import math

from bench_service.protocol.counters import Counters
from bench_service.protocol.engine import Engine
from bench_service.protocol.laws import Seen
from bench_service.protocol.program import Program
from bench_service.protocol.state import Standing, StepEnd
from drivers.cycler import Reading

# What the loop needs to know of the step that plays, for people.
StepView = dict[str, int | float | str | None]
_NEARLY = 0.5  # of a period: the sample that is nearest to the time of a record


class ProtocolPlay:
    """Set-points of a protocol, one per tick, from what is measured.

    Parameters
    ----------
    program : Program
    dt_s : float
        Period of the ticks.
    standing : Standing or None
        Where to go on.
    expected_s : float or None
        How long it may take from there, for the progress.
    device_holds : bool
        Whether the device can hold a voltage.

    Attributes
    ----------
    skipped_points : int
        None: a protocol's steps last at least one period.
    """

    skipped_points = 0
    closed_loop = True

    def __init__(
        self,
        program: Program,
        dt_s: float,
        standing: Standing | None = None,
        expected_s: float | None = None,
        *,
        device_holds: bool = False,
    ) -> None:
        self.dt_s = dt_s
        self._engine = Engine(program, dt_s, standing, device_holds=device_holds)
        self._expected_s = expected_s
        self._began_s = 0.0 if standing is None else standing.total.time_s + standing.step.time_s
        self._time_s: float | None = None
        self._stored: tuple[float, float, float] | None = None
        self.due: bool | None = None

    @property
    def hold_V(self) -> float | None:
        """Voltage that the device is to hold."""
        return self._engine.hold_V

    @property
    def chamber_degC(self) -> float | None:
        """Set point of the temperature chamber."""
        return self._engine.chamber_degC

    @property
    def step_count(self) -> int:
        """Step that the last sample belongs to, counted as they are played, from 1."""
        return self._engine.step_count

    @property
    def cycle_count(self) -> int:
        """Cycle that the last sample belongs to, from 1."""
        return self._engine.cycle_count

    @property
    def stopped(self) -> str | None:
        """Why the protocol could not go on."""
        return self._engine.stopped

    @property
    def view(self) -> StepView:
        """What plays now."""
        step = self._engine.standing.step
        return {
            "step_count": self._engine.standing.step_count,
            "cycle_count": self._engine.standing.cycle_count,
            "step_index": self._engine.step_index,
            "step_name": self._engine.step_name,
            "step_time_s": step.time_s,
            "step_charge_Ah": step.net_Ah,
            "step_energy_Wh": step.charged_Wh - step.discharged_Wh,
        }

    def progress(self, tick: int) -> float:
        """Return the share that is done, as far as that can be foreseen; below 1 until it is over."""
        if not self._expected_s:
            return 0.0
        return min(0.99, (self._began_s + tick * self.dt_s) / (self._began_s + self._expected_s))

    def skip(self) -> None:
        """End the step that plays."""
        self._engine.skip()

    def wait(self, time_s: float) -> None:
        """Pass over time in which somebody holds the run."""
        self._time_s, self.due = time_s, None
        self._engine.pause()

    def follow(self, tick: int, reading: Reading, time_s: float, soc: float | None) -> float | None:
        """Return the set-point until the next tick, in A; None where the protocol has come to its end."""
        interval_s = 0.0 if self._time_s is None else max(0.0, time_s - self._time_s)
        self._time_s = time_s
        seen = Seen(
            reading.voltage_V, reading.current_A, reading.temperature_degC, soc, interval_s, reading.ambient_degC
        )
        setpoint_A = self._engine.advance(seen)
        self.due = True if setpoint_A is None else self._is_due(reading, time_s)
        return setpoint_A

    def close(self) -> None:
        """The run ends: note what the step that plays has moved."""
        self._engine.close()

    def take_rows(self, time_s: float) -> list[tuple[float, ...]]:
        """Return rows of the stream ``steps`` for the steps that have ended."""
        ended, self._engine.ended = self._engine.ended, []
        return [_row(time_s, each) for each in ended]

    def _is_due(self, reading: Reading, time_s: float) -> bool | None:
        """Whether a sample is to be stored; None: as the run's sampling time says."""
        rule = self._engine.record
        if self._engine.ended:
            stored = True
        elif rule is None or (rule.time_s is None and rule.voltage_V is None and rule.current_A is None):
            return None
        elif self._stored is None:
            stored = True
        else:
            past_s, past_V, past_A = self._stored
            stored = time_s - past_s >= (rule.time_s or math.inf) - _NEARLY * self.dt_s
            stored = stored or abs(reading.voltage_V - past_V) >= (rule.voltage_V or math.inf)
            stored = stored or abs(reading.current_A - past_A) >= (rule.current_A or math.inf)
        if stored:
            self._stored = (time_s, reading.voltage_V, reading.current_A)
        return stored


def _row(time_s: float, end: StepEnd) -> tuple[float, ...]:
    moved: Counters = end.moved
    mean_V = moved.voltage_Vs / moved.time_s if moved.time_s > 0 else end.last.voltage_V
    return (
        time_s,
        end.step_count,
        end.step_index,
        end.cycle_count,
        end.at,
        int(end.ended_by),
        moved.time_s,
        moved.charged_Ah,
        moved.discharged_Ah,
        moved.charged_Wh,
        moved.discharged_Wh,
        mean_V,
        end.last.voltage_V,
        end.last.current_A,
        end.last.temperature_degC,
        math.nan if end.last.soc is None else end.last.soc,
    )
