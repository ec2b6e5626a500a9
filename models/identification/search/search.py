"""Choosing orders, time constants, sharpness, regularisation and size from the training data alone.

Each candidate is constructed, fitted with shared poles and judged by its free-run error on held-out samples. The
choices are made one after the other, each with the best of those before; the table of all candidates is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from threadpoolctl import threadpool_limits

from models.data.resampling import GridRun
from models.identification.progress import Progress
from models.identification.search.candidate import Choice
from models.identification.search.chooser import Chooser
from models.identification.search.chosen_inputs import ChosenInputsSearch
from models.identification.search.fitted import Fitted, fitted_choice
from models.identification.search.fixed_inputs import FixedInputsSearch
from models.identification.search.given import GivenCandidate, pole_alternatives, poles_for, size_alternatives
from models.identification.search.judge import Judge
from models.identification.search.temperature_parts import temperature_parts
from models.network.model_record import Json
from models.network.regression import CellContext, SignalBank
from models.network.structure import Structure

# The fastest pole that a sampling time can show, in samples.
_FASTEST_SAMPLES = 2.0


@dataclass
class Search:
    """The search over candidates on one set of training runs."""

    runs: list[GridRun]
    initial_soc: list[float]
    cell: CellContext
    progress: Progress

    @cached_property
    def judge(self) -> Judge:
        """Held-out errors, and the signals of the runs, shared by all candidates."""
        return Judge(SignalBank(self.runs, self.initial_soc, self.cell))

    @property
    def table(self) -> list[Json]:
        """Documents of what was tried, each with its held-out error."""
        return self.judge.table

    @property
    def fastest_s(self) -> float:
        """The fastest pole that the sampling time can show."""
        return _FASTEST_SAMPLES * self.judge.dt_s

    def best(self, family: str) -> Choice:
        """Return the best candidate of "full", "minimal" or "searched"."""
        with threadpool_limits(1, user_api="blas"):
            if family == "searched":
                return ChosenInputsSearch(self._chooser).best()
            parts = temperature_parts(self.judge.bank)
            return FixedInputsSearch(self._chooser, self.fastest_s, parts).best(family)

    def best_within(self, given: Structure) -> GivenCandidate:
        """Choose poles and size for a structure that is given."""
        best = GivenCandidate(given, poles_for(given.output_order, 25.0, self.fastest_s))
        with threadpool_limits(1, user_api="blas"):
            for done in (0.0, 0.5):
                best = self._chooser.choose(best, pole_alternatives(best, self.fastest_s), done)
                best = self._chooser.choose(best, size_alternatives(best), done + 0.25)
        return best

    def fitted(self, choice: Choice) -> Fitted:
        """Construct and fit a choice with its poles shared, on all samples."""
        return fitted_choice(choice, self.judge.bank, self.judge.strengths(choice))

    @property
    def _chooser(self) -> Chooser:
        return Chooser(self.judge, self.progress)
