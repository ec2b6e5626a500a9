"""What a step has moved, counted from sample to sample.

The current of a sample has flowed since the sample before (its set-point was given there), and so has its voltage:
charge is the sum of ``I * dt``, energy that of ``V * I * dt``.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, fields


class Ending(enum.IntEnum):
    """Why a step ended; the column ``ended_by`` of the stream ``steps``."""

    RUN_ENDED = 0  # with the run, whatever ended that; the step may be taken up again
    VOLTAGE = 1
    CURRENT = 2
    TIME = 3
    CHARGE = 4
    SOC = 5
    TEMPERATURE = 6
    SLOPE = 7
    PROFILE = 8
    SKIPPED = 9
    LIMIT = 10
    CYCLE = 11
    SOAKED = 12


ENDINGS = {
    "voltage_V": Ending.VOLTAGE,
    "current_A": Ending.CURRENT,
    "time_s": Ending.TIME,
    "charge_Ah": Ending.CHARGE,
    "soc": Ending.SOC,
    "temperature_degC": Ending.TEMPERATURE,
    "dV_dt_V_per_s": Ending.SLOPE,
    "cycle": Ending.CYCLE,
}


@dataclass(slots=True)
class Counters:
    """Sums of one step, or of a run; not negative but for `time_s`'s sake."""

    time_s: float = 0.0
    charged_Ah: float = 0.0
    discharged_Ah: float = 0.0
    charged_Wh: float = 0.0
    discharged_Wh: float = 0.0
    voltage_Vs: float = field(default=0.0)

    def count(self, voltage_V: float, current_A: float, interval_s: float) -> None:
        """Count one sample."""
        self.time_s += interval_s
        self.voltage_Vs += voltage_V * interval_s
        hours = interval_s / 3600.0
        if current_A > 0:
            self.charged_Ah += current_A * hours
            self.charged_Wh += voltage_V * current_A * hours
        else:
            self.discharged_Ah -= current_A * hours
            self.discharged_Wh -= voltage_V * current_A * hours

    def plus(self, other: Counters) -> Counters:
        """Return the sums of both."""
        return Counters(*(getattr(self, each.name) + getattr(other, each.name) for each in fields(Counters)))

    @property
    def net_Ah(self) -> float:
        """Charge that has gone in."""
        return self.charged_Ah - self.discharged_Ah
