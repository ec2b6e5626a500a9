"""Runs freed of what comes and goes in them, or grows in them, which no model can have."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import TimeSeries
from models.diagnosis.diagnosis import network_memory
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.reference.record import Record
from models.effects import Effect
from models.effects.view import View
from models.network.local_model_network import LocalModelNetwork
from models.readouts.counted_on import Counting, passed_before_Ah


@dataclass(frozen=True)
class Logs:
    """Runs as a network reads them, with its error on them."""

    runs: list[TimeSeries]
    record: Record

    def placed(self, order: list[int]) -> Logs:
        """The same in another order."""
        record = self.record
        runs, soc, error_V = ([each[k] for k in order] for each in (record.runs, record.soc, record.error_V))
        return Logs([self.runs[k] for k in order], replace(record, runs=runs, soc=soc, error_V=error_V))


def freed(
    chosen: Effect, values: dict[str, Value], network: LocalModelNetwork, train: Logs, judged: Logs
) -> tuple[list[TimeSeries], list[TimeSeries], float]:
    """Training runs and those that judge without what a fault made of their voltage.

    A run that was counted on from another one begins with what had grown by its end.

    Parameters
    ----------
    chosen, values : the effect, which has a `fault_V`, and its parameters
    network : that knew the rig without the fault
    train, judged : in time's order

    Returns
    -------
    The runs, and the charge in Ah that had passed, either way, before the first that judges.
    """
    records = (train.record, judged.record)
    every = [run for record in records for run in record.runs]
    soc = [each for record in records for each in record.soc]
    passed_Ah = passed_before_Ah(Counting(every, soc, network.cell))
    n = len(train.runs)
    learned = _freed(chosen, values, network, train, passed_Ah[:n])
    return learned, _freed(chosen, values, network, judged, passed_Ah[n:]), passed_Ah[n]


def _freed(
    chosen: Effect, values: dict[str, Value], network: LocalModelNetwork, logs: Logs, passed_Ah: list[float]
) -> list[TimeSeries]:
    assert chosen.fault_V is not None
    record = logs.record
    cell, plain = network_memory(network, record).cell, {key: each.value for key, each in values.items()}
    out = []
    for run, grid, soc, before_Ah in zip(logs.runs, record.runs, record.soc, passed_Ah, strict=True):
        fault_V = chosen.fault_V(View(cell, grid, soc, np.arange(len(grid)), before_Ah), plain)
        began_s = float(run.time_s[0]) - float(grid.time_s[0])
        out.append(replace(run, voltage_V=run.voltage_V - np.interp(run.time_s - began_s, grid.time_s, fault_V)))
    return out
