"""The fuzzy observer as the run loop sees it; loaded with the first run that asks for one."""

import math
from dataclasses import replace
from typing import Any

from bench_service.bench.observer_link import NO_ESTIMATE, ObserverError, ObserverLink, ObserverRow
from bench_service.bench.request import ObserverOrder, RunRequest
from models.effects.input_correction import LiveCorrection, corrections_of
from models.effects.reading import Reading
from models.module.network import ModuleNetwork, cell_network, model_from_json
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver, ObserverSettings, default_settings
from models.observer.filter.fuzzy_observer import ObserverState
from models.observer.health import Watcher
from models.observer.module.module_observer import ModuleObserver
from models.observer.module.tuning import module_observer

# Outside of this a state of charge is no estimate any more.
_PLAUSIBLE_SOC = (-0.2, 1.2)
# Mean and standard deviation of "anything between 0 and 1".
_UNKNOWN_SOC, _UNKNOWN_SOC_STD = 0.5, 0.29


class FuzzyObserverLink:
    """A fuzzy observer with its memory, and with a watch over whether it can be believed.

    It gets the samples as its model reads them, see `effects.input_correction`; before the first it says nothing.
    """

    def __init__(
        self,
        observer: FuzzyObserver | ModuleObserver,
        state: ObserverState,
        watcher: Watcher,
        correction: LiveCorrection,
    ) -> None:
        self._observer = observer
        self._state = state
        self._watcher = watcher
        self._correction = correction

    def step(
        self, current_A: float, voltage_V: float, temperature_degC: float, ambient_degC: float = math.nan
    ) -> ObserverRow:
        """Return the estimate after one sample; see `ObserverLink`."""
        read = self._correction.step(Reading(current_A, voltage_V, temperature_degC, ambient_degC))
        if read is None:
            return NO_ESTIMATE
        try:
            self._state, out = self._observer.step(self._state, read.current_A, read.voltage_V, read.temperature_degC)
        except Exception as error:  # whatever a model does, the run must not depend on it
            raise ObserverError(f"the observer failed: {error!r}") from error
        low, high = _PLAUSIBLE_SOC
        if not (low <= out.soc <= high and math.isfinite(out.soc_std) and math.isfinite(out.model_voltage_V)):
            raise ObserverError(
                f"the observer has diverged: state of charge {out.soc:.3g} +- {out.soc_std:.2g}, "
                f"model voltage {out.model_voltage_V:.4g} V"
            )
        self._watcher.step(out, read.voltage_V)
        return ObserverRow(out.soc, out.soc_std, out.model_voltage_V, out.innovation_V)

    def new_alarms(self) -> list[str]:
        """Return what is wrong since the last sample and was not before; see `ObserverLink`."""
        return self._watcher.new_alarms()


def fuzzy_link(request: RunRequest, order: ObserverOrder) -> ObserverLink:
    """Build the observer of a request; see `run_setup.build_observer`."""
    try:
        model = model_from_json(order["model"])
        settings = dict(order.get("settings") or {})
        soc = settings.pop("initial_soc", None)
        observer = _observer(model, settings)
        if not math.isclose(observer.dt_s, request.dt_s, rel_tol=1e-9):
            raise ValueError(f"the model's period is {observer.dt_s:g} s, the run's {request.dt_s:g} s; use one")
        soc, std = _initial_soc(soc if soc is not None else request.initial_soc)
        _, out = observer.step(observer.initial(soc, std), 0.0, math.nan, math.nan)  # compiles
        Watcher().step(out, math.nan)
        correction = LiveCorrection(corrections_of(model.record), observer.dt_s)
        return FuzzyObserverLink(observer, observer.initial(soc, std), Watcher(), correction)
    except Exception as error:
        raise ObserverError(f"the observer cannot start: {error}") from error


def _observer(model: LocalModelNetwork | ModuleNetwork, settings: dict[str, Any]) -> FuzzyObserver | ModuleObserver:
    """Observer of a cell or of a module with some of its settings replaced."""
    network = cell_network(model)
    if settings:
        merged = ObserverSettings.from_json(default_settings(network).to_json() | settings)
        network = replace(network, record=replace(network.record, observer=merged.to_json()))
    if isinstance(model, ModuleNetwork):
        return module_observer(replace(model, network=network))
    return FuzzyObserver(network)


def _initial_soc(soc: float | None) -> tuple[float, float | None]:
    """Return initial state of charge and its standard deviation (None: the settings')."""
    return (_UNKNOWN_SOC, _UNKNOWN_SOC_STD) if soc is None else (float(soc), None)
