"""What slipped or smaller electrodes do to a run: another capacity and another open-circuit curve at once."""

from __future__ import annotations

from collections.abc import Callable

from models.data.timeseries import FloatArray
from models.effects.effect import Parameter, Shift
from models.effects.expected import Expected
from models.effects.half_cells import HalfCells, half_cells
from models.effects.view import OwnModel, View

# Of a share that is lost; a little less than nothing, so that a search may begin on either side of it.
_STEP, _LIMITS = 2e-3, (-0.02, 0.4)
# Of the fresh capacity. Electrodes whose curves meet the cell's limits no more have none, and no run is of such.
_LEAST_CAPACITY = 0.05

Loss = Callable[[HalfCells, float], HalfCells]
Electrodes = Callable[[OwnModel], HalfCells | None]

# What is left of the charge that the cell holds, by whichever electrode it went.
LEFT = Parameter("capacity_Ah", "Ah", "capacity that is left of the cell by this loss")


def loss_shift(loss: Loss, of: str = "", apart: Electrodes = half_cells) -> Shift:
    """A share that is lost, simulated again.

    Parameters
    ----------
    loss : fresh electrodes, share -> electrodes
    of : added to the name of the parameter
    apart : the cell of a model -> its electrodes; where it has none, nothing is lost
    """

    def soc(view: View, share: float) -> FloatArray:
        """The run's initial SoC is a fraction of the new capacity."""
        fresh = apart(view.model)
        if fresh is None:
            return view.soc
        return view.initial_soc + (view.soc - view.initial_soc) * _shrinks(fresh, loss(fresh, share))

    def voltage(view: View, share: float) -> FloatArray:
        fresh = apart(view.model)
        if fresh is None:
            return 0.0 * view.voltage_V
        aged = loss(fresh, share)
        counted = soc(view, share)[view.index]
        # By as much charge as before the surface of the particles runs ahead: more of what is left.
        inputs = view.inputs.ahead(_shrinks(fresh, aged))
        at = counted + inputs.surface
        bent_V = aged.open_circuit_V(at) - fresh.open_circuit_V(at)
        return view.model.voltage_V(inputs, counted) - view.voltage_V + bent_V

    def left_Ah(view: View, share: float) -> tuple[float, ...]:
        fresh = apart(view.model)
        return (view.capacity_Ah / (1.0 if fresh is None else _shrinks(fresh, loss(fresh, share))),)

    return Shift(voltage, lambda _view: _STEP, lambda _view: _LIMITS, soc=soc, of=of, also=left_Ah)


def _shrinks(fresh: HalfCells, aged: HalfCells) -> float:
    """By how much a charge is more of the cell than it was."""
    return fresh.capacity / max(aged.capacity, _LEAST_CAPACITY * fresh.capacity)


def _promised_from(view: View) -> float:
    """Smallest share that can be promised to be told: none of electrodes whose curves nobody knows.

    How such a cell's curve bends is a guess then: of 21 simulated losses beyond what their shape alone promised one was
    named first (`docs/results.md`).
    """
    fresh = half_cells(view.model)
    return 0.0 if fresh is not None and fresh.sure else float("inf")


def expected_loss(usual: float, starts: tuple[float, ...]) -> Expected:
    """How large a loss is to be expected.

    Parameters
    ----------
    usual : share
    starts : of the search, in usual shares
    """
    # The plain capacity is asked first: in a record that is short of rests both look alike.
    return Expected(
        width=lambda _view: usual,
        starts=starts,
        from_best=True,
        share=0.3,
        learned=False,
        found_from=_promised_from,
    )


def regressor(shift: Shift) -> Callable[[View], FloatArray]:
    """(m, 1) its voltage for a share of 1, to first order."""
    return lambda view: shift.voltage(view, _STEP)[:, None] / _STEP
