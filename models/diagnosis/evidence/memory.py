"""What a diagnosis needs to know of the training runs, without the runs: sums of products, and the heat balance."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.metrics import noise_floor_V
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.reference.layout import Layout, Shape
from models.diagnosis.reference.reference import Reference
from models.diagnosis.reference.samples import Samples, choose_samples, visible
from models.diagnosis.thermal.heat_balance import HeatBalance, fit_heat_balance
from models.effects import Effect
from models.network.local_model_network import LocalModelNetwork

SCHEMA_VERSION = 1
SAMPLES = 6_000
_COLUMN_RIDGE = 1e-6
# Least squared voltage, relative to the own squared error, that an effect may have had in the training runs already.
_LEAST_ALLOWED = 0.1
# The noise is known to this factor of its variance: it is told from few and rounded figures.
_NOISE_KNOWN_TO = 1.1
# Digits that are written: far more than the estimates are good for.
_DIGITS = 9


@dataclass(frozen=True)
class Memory:
    """The training runs as a diagnosis remembers them.

    Attributes
    ----------
    reference : model fitted to them
    names, sizes : effects that they can show, and the number of each one's regressors
    information : (p + k, p + k) of the model's and the effects' coefficients, for a noise of 1 V^2
    right : (p + k,) products of the regressors and what the model leaves
    own_mse : mean squared error that remains then, V^2
    noise_mse : of the measurement alone, V^2
    balance : of the heat; None where it cannot be known
    """

    reference: Reference
    names: tuple[str, ...]
    sizes: tuple[int, ...]
    information: FloatArray
    right: FloatArray
    own_mse: float
    noise_mse: float
    balance: HeatBalance | None

    def moved(self, part: np.ndarray) -> FloatArray:
        """Coefficients that fit what the model leaves of the training runs, with some of the effects only."""
        information = self.information[np.ix_(part, part)]
        scale = np.sqrt(np.diag(information))
        return np.linalg.solve(information / np.outer(scale, scale), self.right[part] / scale) / scale

    def part(self, effects: list[Effect]) -> np.ndarray:
        """Places of the model's coefficients and of those of some effects, in the order of `names`."""
        wanted = {effect.name for effect in effects}
        start = len(self.reference.coefficients)
        places = [np.arange(start)]
        for name, size in zip(self.names, self.sizes, strict=True):
            if name in wanted:
                places.append(np.arange(start, start + size))
            start += size
        return np.concatenate(places)

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types; of the symmetric information one half is written."""
        upper = self.information[np.triu_indices(len(self.information))]
        layout = self.reference.layout
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "diagnosis_memory",
            "layout": {
                "capacity_Ah": layout.capacity_Ah,
                "dt_s": layout.dt_s,
                "soc_range": list(layout.soc_range),
                "shape": asdict(layout.shape),
                "with_temperature": layout.with_temperature,
            },
            "coefficients": self.reference.coefficients.tolist(),
            "domain": {name: list(span) for name, span in self.reference.domain.items()},
            "own_rms_V": self.reference.own_rms_V,
            "held_out_rms_V": self.reference.held_out_rms_V,
            "names": list(self.names),
            "sizes": list(self.sizes),
            "information": [float(f"{each:.{_DIGITS}g}") for each in upper],
            "right": self.right.tolist(),
            "own_mse": self.own_mse,
            "noise_mse": self.noise_mse,
            "balance": None if self.balance is None else asdict(self.balance),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Memory:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is none, or damaged.
        """
        if document.get("kind") != "diagnosis_memory" or document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not a diagnosis memory of schema version {SCHEMA_VERSION}; fit the model again")
        try:
            plan = dict(document["layout"])
            low, high = plan.pop("soc_range")
            layout = Layout(**(plan | {"shape": Shape(**plan["shape"]), "soc_range": (low, high)}))
            domain = {name: (float(span[0]), float(span[1])) for name, span in document["domain"].items()}
            coefficients = np.array(document["coefficients"], dtype=np.float64)
            rms = (float(document["own_rms_V"]), float(document["held_out_rms_V"]))
            reference = Reference(layout, coefficients, np.zeros((0, 0)), domain, *rms)
            names, sizes = tuple(document["names"]), tuple(int(size) for size in document["sizes"])
            total = layout.size + sum(sizes)
            information = np.zeros((total, total))
            information[np.triu_indices(total)] = document["information"]
            information += np.triu(information, 1).T
            right = np.array(document["right"], dtype=np.float64)
            balance = None if document["balance"] is None else HeatBalance(**document["balance"])
            figures = (float(document["own_mse"]), float(document["noise_mse"]))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ModelError(f"diagnosis memory is damaged: {error!r}; fit the model again") from None
        if len(coefficients) != layout.size or len(right) != total or len(names) != len(sizes):
            raise ModelError("diagnosis memory is damaged: its sizes do not fit; fit the model again")
        return cls(reference, names, sizes, information, right, *figures, balance)


def memory_in(network: LocalModelNetwork) -> Memory | None:
    """Read what a network's record remembers of its training runs; None where it remembers nothing."""
    document = network.record.diagnosis
    return None if document is None else Memory.from_json(document)


def remember(reference: Reference, train: list[GridRun], train_soc: list[float], effects: list[Effect]) -> Memory:
    """Take from the training runs what a diagnosis needs.

    Parameters
    ----------
    reference : fitted to them
    train, train_soc : runs with their SoC at the start
    effects : that may be asked for
    """
    samples = choose_samples(reference, train, train_soc, SAMPLES)
    usable = [effect for effect in effects if visible(effect, train)]
    columns = [samples.regressors(effect) for effect in usable]
    extended = np.hstack([samples.own_regressors(reference), *columns])
    p, error = len(reference.coefficients), samples.error_V
    information = extended.T @ extended
    information[:p, :p] += reference.penalty * len(error)
    right = extended.T @ error
    right[:p] -= len(error) * (reference.penalty @ reference.coefficients)
    names, sizes = tuple(effect.name for effect in usable), tuple(column.shape[1] for column in columns)
    power = (extended[:, p:] ** 2).mean(axis=0)
    balance = fit_heat_balance(reference, train, train_soc)

    def remembered(prior: FloatArray, own_mse: float) -> Memory:
        wider = information.copy()
        added = np.arange(p, len(information))
        wider[added, added] += prior + 1e-12
        memory = Memory(reference, names, sizes, wider, right, own_mse, 0.0, balance)
        own = float(np.mean((error - extended @ memory.moved(np.arange(len(right)))) ** 2))
        return replace(memory, own_mse=own, noise_mse=min(noise_mse(samples), own))

    # The model is right, as far as it goes: an effect may have been at work by as much as its systematic error.
    free = remembered(_COLUMN_RIDGE * len(error) * power, 0.0)
    allowed = max(_LEAST_ALLOWED * free.own_mse, free.own_mse - free.noise_mse)
    return remembered(power * free.own_mse / allowed, free.own_mse)


def noise_mse(samples: Samples) -> float:
    """Variance of the measurement's noise in V^2."""
    floors = np.array([noise_floor_V(view.run.voltage_V, view.run.current_A) for view in samples.views])
    known = floors[np.isfinite(floors)]
    return _NOISE_KNOWN_TO * float(np.median(known) ** 2) if len(known) else 0.0
