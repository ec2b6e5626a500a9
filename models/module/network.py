"""The model of a module as data: the network of its mean cell, the module model that was chosen, and its document."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from models.data.errors import ModelError, StructureError
from models.data.metrics import Metrics
from models.data.resampling import GridRun
from models.data.seal import check_seal
from models.data.timeseries import FloatArray, TimeSeries
from models.module.models import ModuleModel
from models.network.cell_model import CellModel
from models.network.free_run import free_run_V, memory_s
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import AddedEffect, Domain, Json
from models.network.regression import CellContext

SCHEMA_VERSION = 1
KIND = "module_network"
_OF_CURRENT = ("current_A", "slow_current_A")


@dataclass(frozen=True)
class ModuleRecord:
    """What a module's model was made from and how well it did.

    Attributes
    ----------
    domain : ranges of the training data, the current that of the whole module
    effects : none; a correction of the cell's own log is not one of the module's
    usability, reservations : see `ModelRecord`
    train, validation : free-run figures of the module's voltage
    compared : the module models side by side, each with its error (`pipeline.module_fit`)
    groups, weak_group : what differs from group to group, and the one that ends a discharge first, in words; empty and
        None where no group was measured or none stands out
    own_cell : the cell's network was identified from the module's own runs
    """

    domain: Domain = field(default_factory=dict)
    effects: tuple[AddedEffect, ...] = ()
    usability: Json | None = None
    reservations: tuple[str, ...] = ()
    train: Metrics | None = None
    validation: Metrics | None = None
    compared: tuple[Json, ...] = ()
    groups: tuple[Json, ...] = ()
    weak_group: Json | None = None
    own_cell: bool = True


_LISTS = ("reservations", "compared", "groups")
_PARTS = ("usability", "train", "validation", "weak_group", "own_cell", *_LISTS)


@dataclass(frozen=True)
class ModuleNetwork:
    """A module of cells in series and in parallel.

    Attributes
    ----------
    network : of the mean cell
    module : S1 to S4
    record : what it was made from; its domain is worked out from the cell's
    """

    network: LocalModelNetwork
    module: ModuleModel
    record: ModuleRecord = field(default_factory=ModuleRecord)

    def __post_init__(self) -> None:
        """Give the record the module's domain."""
        parallel, domain = self.module.cells_in_parallel, {}
        for name, (low, high) in self.network.record.domain.items():
            factor = parallel if name in _OF_CURRENT else 1
            domain[name] = (factor * low, factor * high)
        object.__setattr__(self, "record", replace(self.record, domain=domain))

    @property
    def name(self) -> str:
        """What a person calls the model."""
        in_series, parallel = self.module.cells_in_series, self.module.cells_in_parallel
        return f"module {self.module.kind} of {in_series} x {parallel} cells ({self.network.structure.name})"

    @property
    def dt_s(self) -> float:
        """Sampling time in s."""
        return self.network.dt_s

    @property
    def cell(self) -> CellContext:
        """Capacity of the whole module, and efficiency."""
        own = self.network.cell
        return CellContext(self.module.cells_in_parallel * own.capacity_Ah, own.efficiency)

    @property
    def candidates(self) -> tuple[ModuleModel, ...]:
        """All module models that the data determine, the smallest first."""
        return tuple(_candidate(self.module, each) for each in self.record.compared) or (self.module,)

    def mean_cell_run(self, run: GridRun) -> GridRun:
        """Return a run of the module, on the grid, as its mean cell sees it."""
        module = self.module
        return replace(
            run,
            current_A=module.cell_current_A(run.current_A),
            charge_Ah=run.charge_Ah / module.cells_in_parallel,
            voltage_V=self._cell_voltage_V(run.voltage_V, run.current_A),
        )

    def mean_cell_series(self, run: TimeSeries) -> TimeSeries:
        """Return a measured run of the module as its mean cell sees it."""
        current_A = self.module.cell_current_A(run.current_A)
        return replace(run, current_A=current_A, voltage_V=self._cell_voltage_V(run.voltage_V, run.current_A))

    def _cell_voltage_V(self, voltage_V: FloatArray, current_A: FloatArray) -> FloatArray:
        beside_V = self.module.voltage_V(np.zeros(len(voltage_V)), np.nan_to_num(current_A))
        return (voltage_V - beside_V) / self.module.cells_in_series

    def to_json(self) -> Json:
        """Return a document of plain types with its schema version."""
        record = {name: getattr(self.record, name) for name in _PARTS}
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": KIND,
            "module": self.module.to_json(),
            "cell": self.network.to_json(),
            "record": {name: list(value) if name in _LISTS else value for name, value in record.items()},
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> ModuleNetwork:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is no model of a module, of another schema version, or damaged.
        """
        if not isinstance(document, dict) or document.get("kind") != KIND:
            raise StructureError(f"not a model of a module: its 'kind' must be {KIND!r}")
        check_seal(document)
        if document.get("schema_version") != SCHEMA_VERSION:
            raise StructureError(
                f"model of a module has schema version {document.get('schema_version')!r}; {SCHEMA_VERSION} is "
                "supported"
            )
        record = document.get("record", {})
        if not isinstance(record, dict) or not all(isinstance(record.get(name, []), list) for name in _LISTS):
            raise StructureError("model of a module is damaged: its record must be an object")
        parts = {name: record[name] for name in _PARTS if name in record}
        parts |= {name: tuple(parts[name]) for name in _LISTS if name in parts}
        network = LocalModelNetwork.from_json(document.get("cell"))  # pyright: ignore[reportArgumentType]  # it checks
        return cls(network, ModuleModel.from_json(document.get("module", {})), ModuleRecord(**parts))


def _candidate(chosen: ModuleModel, document: Json) -> ModuleModel:
    try:
        pairs = [
            (float(document[name]["charge"][part]), float(document[name]["discharge"][part]))
            for name in ("resistance_Ohm", "offset_V")
            for part in ("value", "std")
        ]
        return replace(
            chosen,
            kind=str(document["kind"]),
            resistance_Ohm=pairs[0],
            resistance_std_Ohm=pairs[1],
            offset_V=pairs[2],
            offset_std_V=pairs[3],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ModelError(f"model of a module is damaged: record.compared: {error!r}") from None


@free_run_V.register
def _(model: ModuleNetwork, run: GridRun, initial_soc: float) -> FloatArray:
    cell_V = free_run_V(model.network, model.mean_cell_run(run), initial_soc)
    return model.module.voltage_V(cell_V, run.current_A)


@memory_s.register
def _(model: ModuleNetwork) -> float:
    return memory_s(model.network)


def model_from_json(document: Any) -> LocalModelNetwork | ModuleNetwork:
    """Read the model of a cell or of a module, whichever a document is.

    Raises
    ------
    ModelError
        It is neither.
    """
    if isinstance(document, dict) and document.get("kind") == KIND:
        return ModuleNetwork.from_json(document)
    return LocalModelNetwork.from_json(document)


def cell_network(model: CellModel) -> LocalModelNetwork:
    """Return the network of a cell in a model of a cell or of a module.

    Raises
    ------
    ModelError
        It has none.
    """
    found = model.network if isinstance(model, ModuleNetwork) else model
    if not isinstance(found, LocalModelNetwork):
        raise ModelError(f"{model.name} has no network of local models")
    return found
