"""Estimating where a run begins from its voltage: state of charge, and the history that stands for the inner state.

Damped Gauss-Newton steps on the whitened error, with finite differences, so that any model that simulates a run will
do. A start is moved only where that lowers the error by clearly more than chance; else the run begins at rest, as it
was stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.comparison.start import Start, dies_out, free_run_from_V, simulates
from models.comparison.start_noise import ErrorModel, Whitener, error_model, seen_error_model, whitener
from models.data.history import StartHistory, first_part, going_on, history_edges_s
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.cell_model import CellModel
from models.network.free_run import memory_s

HEAD_S = 60.0
_FEWEST_SAMPLES = 5
_MOST_STEPS = 8
# A step that lowers the cost by less than this share of it, and by less than a half, is the last.
_SMALL_SHARE, _SMALL = 2e-3, 0.5
# How far parameters are moved for a derivative, in their prior standard deviations; currents less than what counts as
# a load, for the direction of the last current would flip.
_MOVED, _MOVED_REST = 0.05, 0.8
# Prior of the currents: as large as those of the run, or as this share of the largest that the model was made from, and
# no larger than what moves a cell by this share of its charge in one window.
_SHARE_OF_LARGEST, _LEAST_C_RATE = 0.3, 0.1
_MOVED_SHARE = 0.5
# By how much what flowed before may pass empty or full: about as far off as a full cell is stated.
_BEYOND_SOC = 0.02
# By how much -2 log likelihood must fall: the 0.1 % level of chi-square for one parameter, and for each further one.
_WORTH, _WORTH_EACH = 10.8, 2.4
# By how much -2 log likelihood must fall for a log to go on as it went: twice the logarithm of ten.
_LIKELIER = 4.6
# From a minute alone, errors of the model pass for a start more easily.
_HEAD_CAUTION = 2.0
# A run of fewer samples does not show its own error's correlation.
_SHOWS_OWN_ERROR = 500


def start_from_head(model: CellModel, run: GridRun, stated: Start) -> Start:
    """Place a start by the first 60 s of a run's voltage; the stated one unless another is clearly better."""
    head = first_part(run, 1 + int(HEAD_S / run.dt_s))
    if int(head.measured.sum()) < _FEWEST_SAMPLES or not simulates(model, head, stated):
        return stated
    expected = error_model(model, head, stated.initial_soc)
    estimate = _Estimate(model, head, stated, expected)
    found = estimate.best(_HEAD_CAUTION, usual=going_on(run, estimate.edges_s))
    return found if dies_out(model, run, (stated, found), HEAD_S) else stated


def start_from_run(model: CellModel, run: GridRun, stated: Start, expected: ErrorModel | None = None) -> Start:
    """Place a start by all of a run's voltage; the stated one unless another is clearly better.

    Parameters
    ----------
    model : simulates the run
    run : on its grid
    stated : where the run is said to begin; without `soc_std` its state of charge is taken as known
    expected : error of the model on such a run from the right start; by default what its record says

    Returns
    -------
    Start
        With the standard deviation of the state of charge that prior, error and correlation leave.
    """
    if int(run.measured.sum()) < _FEWEST_SAMPLES or not simulates(model, run, stated):
        return stated
    head = first_part(run, max(1 + int(HEAD_S / run.dt_s), round(memory_s(model) / run.dt_s)))
    if expected is None:
        expected = error_model(model, first_part(run, 1 + round(10.0 * HEAD_S / run.dt_s)), stated.initial_soc)
    first = _Estimate(model, head, stated, expected)
    guess = first.found(first.branches())
    whole = _Estimate(model, run, stated, expected, len(head))
    if len(run) < _SHOWS_OWN_ERROR:
        return whole.best(1.0, [guess])
    guess = whole.found([guess, np.zeros(len(guess))])
    error_V = run.voltage_V - free_run_from_V(model, run, whole.start(guess))
    return _Estimate(model, run, stated, seen_error_model([error_V]), len(head)).best(1.0, [guess])


def plainly_not_at_rest(model: CellModel, run: GridRun, stated: Start, expected: ErrorModel) -> bool:
    """Whether the first ten minutes are so far off that a start other than rest may explain them; quick to tell.

    A score test: by how much one step of the estimate would lower the error, were it linear.
    """
    head = first_part(run, 1 + int(10.0 * HEAD_S / run.dt_s))
    if int(head.measured.sum()) < _FEWEST_SAMPLES or not simulates(model, head, stated):
        return False
    estimate = _Estimate(model, head, stated, expected)
    return estimate.score() > estimate.worth


@dataclass(frozen=True)
class _Point:
    """Parameters in prior standard deviations, the error there, and -2 log likelihood with the prior.

    `white`: the whitened error, `squares_V2`: the plain sum of squares.
    """

    x: FloatArray
    white: FloatArray
    cost: float
    squares_V2: float


class _Estimate:
    """One estimate: of the currents before the start, the newest first, and then of the state of charge where open."""

    def __init__(
        self, model: CellModel, run: GridRun, stated: Start, expected: ErrorModel, reach: int | None = None
    ) -> None:
        self._model, self._run, self._stated = model, run, stated
        # What the history does to the voltage has died out after this many samples.
        self._reach = len(run) if reach is None else min(reach, len(run))
        self.edges_s = history_edges_s(memory_s(model))
        self._white: Whitener = whitener(run.measured, expected)
        self._head: GridRun = first_part(run, self._reach)
        soc_std = stated.soc_std or 0.0
        currents = np.minimum(
            _usual_A(model, run), _MOVED_SHARE * model.cell.capacity_Ah / np.diff(self.edges_s) * 3600.0
        )
        self._scale = np.array([*currents, *([soc_std] if soc_std > 0.0 else [])])
        self._n_currents = len(currents)

    def branches(self) -> list[FloatArray]:
        """Where the search begins: at rest, after a long charge and after a long discharge."""
        after = np.zeros(len(self._scale))
        after[: self._n_currents] = 1.0
        return [np.zeros(len(self._scale)), after, -after]

    def start(self, x: FloatArray) -> Start:
        """The start that parameters stand for."""
        value = x * self._scale
        currents = value[: self._n_currents]
        offset = float(value[self._n_currents]) if self._soc_open else 0.0
        stated = self._stated.initial_soc
        soc = min(max(stated + offset, min(stated, 0.0)), max(stated, 1.0))
        currents = self._possible(currents, soc)
        history = StartHistory(self.edges_s, tuple(currents.tolist())) if currents.any() else None
        return replace(self._stated, initial_soc=soc, history=history)

    def _possible(self, currents_A: FloatArray, soc: float) -> FloatArray:
        """Currents, the newest first, as far as a cell can have had them that is to end at a state of charge."""
        low, high = min(soc, 0.0) - _BEYOND_SOC, max(soc, 1.0) + _BEYOND_SOC
        out = currents_A.copy()
        for k, unit in enumerate(np.diff(self.edges_s) / 3600.0 / self._model.cell.capacity_Ah):
            out[k] = np.clip(out[k], (soc - high) / unit, (soc - low) / unit)
            soc -= out[k] * unit
        return out

    def found(self, begin: list[FloatArray]) -> FloatArray:
        """The likeliest parameters from several first guesses."""
        free = np.ones(len(self._scale), dtype=bool)
        return min((self._descended(x, free) for x in begin), key=lambda point: point.cost).x

    def best(self, caution: float, begin: list[FloatArray] | None = None, usual: StartHistory | None = None) -> Start:
        """The start that is clearly better than the stated one: another state of charge, a history, or both.

        The stated one is taken from rest, or after a usual history where that is likelier: nothing of either is fitted.
        """
        rest = self._at(np.zeros(len(self._scale)))
        worth = {"all": caution * self.worth} | ({"soc": caution * _WORTH} if self._soc_open else {})
        if not np.isfinite(rest.cost):
            return self._stated
        plain, least = rest, min(rest.cost, self._settled().cost)
        if usual is not None and (after := self._unfitted(usual)).cost < least - _LIKELIER:
            plain, least = after, after.cost
        if least < min(worth.values()):
            return self._confirmed(plain)
        better: list[tuple[float, _Point, np.ndarray]] = []
        for name, needed in worth.items():
            free = np.ones(len(self._scale), dtype=bool)
            free[: self._n_currents] = name == "all"
            guesses = self.branches() if begin is None else [*begin, rest.x]
            points = [self._descended(x, free) for x in (guesses if name == "all" else [rest.x])]
            point = min(points, key=lambda each: each.cost)
            # A misfit that remains says that errors are larger than expected, and the gain is worth less.
            better.append(((least - point.cost) / self._excess(point, free) - needed, point, free))
        gain, point, free = max(better, key=lambda each: each[0])
        # What slow errors are expected to do may outweigh what a person sees: a start that looks worse is not taken.
        found = gain > 0.0 and point.squares_V2 <= plain.squares_V2
        return self._with_std(point, free) if found else self._confirmed(plain)

    def _unfitted(self, history: StartHistory) -> _Point:
        """A history that is known before the voltage is looked at: no prior weighs against it."""
        x = np.zeros(len(self._scale))
        x[: self._n_currents] = np.array(history.currents_A) / self._scale[: self._n_currents]
        point = self._at(x)
        return replace(point, cost=point.cost - float(x @ x))

    @property
    def worth(self) -> float:
        """By how much the cost must fall for all of it not to be chance."""
        return _WORTH + _WORTH_EACH * (len(self._scale) - 1)

    @property
    def _soc_open(self) -> bool:
        return len(self._scale) > self._n_currents

    def _with_std(self, point: _Point, free: np.ndarray) -> Start:
        start = self.start(point.x)
        return replace(start, soc_std=self._scale[-1] * self._spread(point, free)[1]) if self._soc_open else start

    def _confirmed(self, plain: _Point) -> Start:
        """The stated start, its state of charge as well known as the voltage confirms it."""
        if not self._soc_open:
            return self.start(plain.x)
        off, std = self._spread(plain, np.ones(len(self._scale), dtype=bool))
        return replace(self.start(plain.x), soc_std=float(self._scale[-1] * min(np.hypot(off, std), 1.0)))

    def _spread(self, point: _Point, free: np.ndarray) -> tuple[float, float]:
        """How far the next step would move the state of charge, and its standard deviation, both over the prior one."""
        slopes = self._slopes(point, free)
        excess = self._excess(point, free)
        spread = np.linalg.inv(slopes.T @ slopes / excess + np.eye(slopes.shape[1]))
        step = spread @ (-slopes.T @ point.white / excess - point.x[free])
        return float(step[-1]), float(np.sqrt(spread[-1, -1]))

    def _excess(self, point: _Point, free: np.ndarray) -> float:
        """How much larger errors are than expected, as a factor of their variance."""
        return max(1.0, float(point.white @ point.white) / max(len(point.white) - int(free.sum()), 1))

    def _descended(self, x: FloatArray, free: np.ndarray) -> _Point:
        now, damping = self._at(np.where(free, x, 0.0)), 1e-2
        for _ in range(_MOST_STEPS):
            slopes = self._slopes(now, free)
            if not np.isfinite(slopes).all():
                break
            size = slopes.T @ slopes + np.eye(slopes.shape[1])
            downhill = -slopes.T @ now.white - now.x[free]
            trial = now
            for _ in range(4):
                step = np.zeros(len(x))
                step[free] = np.linalg.solve(size + damping * np.diag(np.diag(size)), downhill)
                trial = self._at(now.x + step)
                if trial.cost < now.cost:
                    break
                damping *= 10.0
            if not trial.cost < now.cost:
                break
            fallen, now, damping = now.cost - trial.cost, trial, 0.2 * damping
            if fallen < max(_SMALL, _SMALL_SHARE * now.cost):
                break
        return now

    def _at(self, x: FloatArray) -> _Point:
        return self._point(x, self.start(x))

    def _point(self, x: FloatArray, start: Start) -> _Point:
        error_V = self._run.voltage_V - free_run_from_V(self._model, self._run, start)
        white = self._white.white(error_V)
        cost = float(white @ white + x @ x) if np.isfinite(white).all() else np.inf
        return _Point(x, white, cost, float(np.nansum(error_V**2)))

    def score(self) -> float:
        """How much one step from rest would lower the cost, were the error linear in the start."""
        settled = self._settled()
        slopes = self._slopes(settled, np.ones(len(self._scale), dtype=bool))
        downhill = slopes.T @ settled.white
        return float(downhill @ np.linalg.solve(slopes.T @ slopes + np.eye(len(downhill)), downhill))

    def _settled(self) -> _Point:
        """A long rest in front.

        A network with past outputs otherwise begins at measured ones, whose noise alone is no reason for a history.
        """
        rest = StartHistory(self.edges_s, (0.0,) * self._n_currents)
        return self._point(np.zeros(len(self._scale)), replace(self._stated, history=rest))

    def _slopes(self, point: _Point, free: np.ndarray) -> FloatArray:
        """(m, p) derivatives of the whitened error to the free parameters."""
        out = []
        simulated = free_run_from_V(self._model, self._run, self.start(point.x))
        for k in np.flatnonzero(free):
            is_soc = k >= self._n_currents
            moved = _MOVED if is_soc else min(_MOVED, _MOVED_REST * self._model.cell.rest_A / self._scale[k])
            x = point.x.copy()
            if is_soc and self.start(x).initial_soc > 0.5:
                moved = -moved  # Away from full, beyond which there is nothing.
            x[k] += moved
            run = self._run if is_soc else self._head
            change = np.zeros(len(self._run))
            change[: len(run)] = free_run_from_V(self._model, run, self.start(x)) - simulated[: len(run)]
            out.append(-self._white.white(change) / moved)
        return np.column_stack(out)


def _usual_A(model: CellModel, run: GridRun) -> float:
    """How large the currents before a run are taken to have been."""
    own = float(np.sqrt(np.mean(run.current_A**2)))
    largest = max((abs(edge) for edge in model.record.domain.get("current_A", (0.0,))), default=0.0)
    return max(own, _SHARE_OF_LARGEST * largest, _LEAST_C_RATE * model.cell.capacity_Ah)
