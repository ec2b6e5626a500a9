"""A run as the API asks for it, and its form on the command link."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self, TypedDict

import numpy as np
from numpy.typing import NDArray

from bench_service.bench.limits import Limits
from bench_service.framing import Frame


class ObserverOrder(TypedDict):
    """An observer that is to run live: its model, as MODEL.json, and its settings.

    ``settings`` are `models.observer.ObserverSettings` as far as they differ from the model's own, and
    ``initial_soc`` where the observer does not start at the run's.
    """

    model: dict[str, Any]
    settings: dict[str, Any] | None


class BandOrder(TypedDict):
    """A model, as MODEL.json, whose band the voltage must not leave by `margin_V` for `for_s`.

    The band is that of a cell that has rested, with what was measured at it last: `temperature_degC`, `voltage_V`
    (None: unknown).
    """

    model: dict[str, Any]
    temperature_degC: float
    voltage_V: float | None
    margin_V: float
    for_s: float


class ProtocolOrder(TypedDict):
    """A protocol that is to be played: its document, where to go on (None: at the beginning), its likely length."""

    document: dict[str, Any]
    standing: dict[str, Any] | None
    expected_s: float | None


@dataclass(frozen=True, slots=True, eq=False)
class RunRequest:
    """One run.

    Parameters
    ----------
    run_id : str
    dt_s : float
        Sampling period.
    limits : Limits
    capacity_Ah : float
        For counting charge.
    time_s, current_A : numpy.ndarray, shape (n,)
        Profile with forward hold; the last row ends it. Positive current charges.
    initial_soc : float or None
        None: the state of charge is not known and its limits cannot be checked.
    observer : ObserverOrder or None
    settle_s : float
        Time after a change of the set-point in which measured and commanded current are not compared.
    stale_limit : int
        Stale readings in a row that are a fault.
    protocol : ProtocolOrder or None
        In place of a profile, whose arrays are then empty.
    finish_alone : bool
        Plays on to its end where the service is gone; False: rest.
    band : BandOrder or None
    unverified : bool
        The bench's hardware is not commissioned: every sample says so.
    """

    run_id: str
    dt_s: float
    limits: Limits
    capacity_Ah: float
    time_s: NDArray[np.float64]
    current_A: NDArray[np.float64]
    initial_soc: float | None = None
    observer: ObserverOrder | None = None
    settle_s: float = 0.0
    stale_limit: int = 3
    finish_alone: bool = False
    unverified: bool = False
    band: BandOrder | None = None
    protocol: ProtocolOrder | None = None

    def to_frame(self) -> Frame:
        """Return header and body of the ``start`` message."""
        header = {
            "op": "start",
            "run_id": self.run_id,
            "dt_s": self.dt_s,
            "limits": self.limits.to_json(),
            "initial_soc": self.initial_soc,
            "capacity_Ah": self.capacity_Ah,
            "observer": self.observer,
            "settle_s": self.settle_s,
            "stale_limit": self.stale_limit,
            "finish_alone": self.finish_alone,
            "unverified": self.unverified,
            "band": self.band,
            "protocol": self.protocol,
            "n": len(self.time_s),
        }
        body = np.asarray(self.time_s, "<f8").tobytes() + np.asarray(self.current_A, "<f8").tobytes()
        return header, body

    @classmethod
    def from_frame(cls, header: Mapping[str, Any], body: bytes) -> Self:
        """Read the ``start`` message.

        Raises
        ------
        ValueError
            A field is missing or has the wrong type, or the body is not `n` times and `n` currents.
        """
        try:
            n = int(header["n"])
            values = np.frombuffer(body, "<f8")
            if len(values) != 2 * n:
                raise ValueError(f"profile of {n} points needs {16 * n} bytes, got {len(body)}")
            soc = header["initial_soc"]
            return cls(
                run_id=str(header["run_id"]),
                dt_s=float(header["dt_s"]),
                limits=Limits.from_json(header["limits"]),
                capacity_Ah=float(header["capacity_Ah"]),
                time_s=values[:n],
                current_A=values[n:],
                initial_soc=None if soc is None else float(soc),
                observer=header["observer"],
                settle_s=float(header["settle_s"]),
                stale_limit=int(header["stale_limit"]),
                finish_alone=bool(header["finish_alone"]),
                unverified=bool(header["unverified"]),
                band=header["band"],
                protocol=header["protocol"],
            )
        except (KeyError, TypeError) as error:
            raise ValueError(f"start message: {error!r}") from error
