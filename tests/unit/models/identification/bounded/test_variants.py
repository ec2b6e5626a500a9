"""Which form is taken, and what is left out of it."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.identification.bounded.best_variant import best_variant
from models.identification.bounded.fitted import fit_variant
from models.identification.bounded.terms import BEHIND, BOTH_WAYS
from models.identification.bounded.variants import Trials, Variant, clearly_better, temperature_in, variant_of
from models.network.regression import CellContext, SignalBank
from tests.unit.models.identification.bounded.bank import bank, trials, two_electrodes

COUNTS = np.full(5, 100.0)


def test_better_by_more_than_one_standard_error() -> None:
    present = np.full(5, 4.0)
    # Of the root mean squares: better by 0.1 on each fold, then by 0.1 on the mean of folds that differ by 1.
    assert clearly_better(np.full(5, 1.9**2), present, COUNTS)
    scattered = (1.9 + np.array([1.0, -1.0, 1.0, -1.0, 0.0])) ** 2
    assert not clearly_better(scattered, present, COUNTS)
    assert not clearly_better(present, present, COUNTS)
    assert not clearly_better(np.full(5, 4.1), present, COUNTS)


def test_the_rule_is_that_of_the_standard_error() -> None:
    step = np.array([0.2, -0.1, 0.3, 0.05, 0.1])
    error = float(np.sqrt(np.mean((step - step.mean()) ** 2) / 4.0))
    for shift, wanted in ((1.01, True), (0.99, False)):
        trial = (3.0 - (step - step.mean() + shift * error)) ** 2
        assert clearly_better(trial, np.full(5, 9.0), COUNTS) is wanted


def test_empty_folds_do_not_count_and_one_fold_is_compared_as_it_is() -> None:
    counts = np.array([100.0, 0.0, 0.0, 0.0, 0.0])
    assert clearly_better(np.array([1.0, 9.0, 9.0, 9.0, 9.0]), np.full(5, 1.1), counts)
    assert not clearly_better(np.array([1.2, 0.0, 0.0, 0.0, 0.0]), np.full(5, 1.1), counts)


def test_a_plain_cell_gets_the_plain_form() -> None:
    tried = trials()
    assert best_variant(tried) == Variant()
    assert Variant() in tried.known and len(tried.known) > 1


def test_gains_that_change_within_a_tenth_of_the_charge_get_more_knots() -> None:
    plain = bank(n=12_000)
    bump = [
        replace(run, voltage_V=run.voltage_V + 0.04 * np.exp(-(((soc - 0.5) / 0.05) ** 2)) * run.current_A)
        for run, soc in zip(plain.runs, plain.values("soc"), strict=True)
    ]
    tried = Trials(SignalBank(bump, plain.initial_soc, plain.cell))
    best = best_variant(tried)
    assert best.fine_gains
    assert tried.mean(tried.error(best)) < 0.9 * tried.mean(tried.error(replace(best, fine_gains=False)))


def test_a_surface_that_runs_empty_in_the_cold_is_slower_there() -> None:
    moved, rng = bank(n=6000, swing_K=15.0), np.random.default_rng(3)
    # Down to a tenth of the charge, where the curve falls by half a volt.
    drained = SignalBank(moved.runs, [0.235] * len(moved.runs), moved.cell)
    knee = [
        replace(
            run,
            voltage_V=3.2 + 0.6 * s - 0.5 * np.exp(-s / 0.05) + 0.02 * run.current_A + rng.normal(0.0, 1e-3, len(run)),
        )
        for run, s in zip(moved.runs, drained.values("surface_soc:0.05/1000/6500/30"), strict=True)
    ]
    tried = Trials(SignalBank(knee, drained.initial_soc, moved.cell))
    best = best_variant(tried)
    assert best.surface is not None and len(best.surface) == 4
    others = [tried.mean(tried.error(each)) for each in tried.known if each.surface and len(each.surface) == 3]
    assert tried.mean(tried.error(best)) < 0.8 * min(others)


def test_where_one_electrode_alone_runs_ahead_the_other_one_stands_at_the_mean() -> None:
    tried = Trials(two_electrodes(0.8))
    best = best_variant(tried)
    assert best.behind and best.surface is not None
    assert best.surface[:2] == pytest.approx((0.1, 268.0), rel=0.3)
    alone = [tried.mean(tried.error(each)) for each in tried.known if not each.behind]
    assert tried.mean(tried.error(best)) < 0.85 * min(alone)
    fit = fit_variant(tried, best)
    (number,) = (b for b, term in enumerate(fit.layout.basis.terms) if term.signal.startswith(BEHIND))
    part = slice(int(fit.layout.first[number]), int(fit.layout.first[number + 1]))
    # It is one slope, so that what is left to the surface rises wherever that is, and no resistance can be negative.
    (slope_V,) = fit.coefficients[part] / fit.layout.scale[number]
    assert slope_V == pytest.approx(0.8, rel=0.25)
    n = fit.layout.n_curve
    assert (np.diff(fit.coefficients[:n]) - slope_V * np.diff(fit.layout.knots.soc)).min() > -1e-9


def test_without_diffusion_no_part_of_the_curve_is_behind() -> None:
    tried = Trials(two_electrodes(0.8), ("relaxation",))
    best_variant(tried)
    assert not any(each.behind for each in tried.known)


def test_effects_are_left_out_of_every_form() -> None:
    tried = trials(("hysteresis", "relaxation"))
    for variant in (Variant(), Variant(squared=True)):
        found = {name for term in tried.basis(variant).terms for name in term.parts}
        assert "charge_transfer" in found and not found & {"hysteresis", "relaxation"}
    # A surface that runs ahead of the mean is slow diffusion, too.
    best_variant(tried)
    assert all(variant.surface is None for variant in tried.known)


def test_an_effect_that_the_runs_cannot_show_is_not_there_to_be_left_out() -> None:
    with pytest.raises(ModelError, match="scaling by temperature cannot be left out"):
        Trials(bank(swing_K=0.0), ("scaling by temperature",)).basis(Variant())


def test_what_runs_say_of_the_temperature() -> None:
    still = bank(swing_K=0.0)
    assert temperature_in(still) == "one"
    assert temperature_in(bank(n=1500, swing_K=5.0)) == "moves"
    blind = [replace(run, temperature_degC=np.full(len(run), np.nan)) for run in still.runs]
    assert temperature_in(SignalBank(blind, still.initial_soc, CellContext(2.5))) == "missing"


def test_a_form_names_itself() -> None:
    plain = {"axis": "soc", "squared": False, "fine_slope": False}
    assert Variant().to_json() == plain | {"fine_gains": False, "behind": False}
    assert variant_of(plain) == Variant()  # as former versions wrote it
    rich = Variant((0.02, 200.0, 5500.0), squared=True, fine_gains=True, behind=True)
    assert variant_of(rich.to_json()) == rich
    assert Variant((0.02, 200.0, 5500.0), squared=True).axis == "surface_soc:0.02/200/5500"
    emptying = Variant((0.05, 1000.0, 6500.0, 30.0))
    assert emptying.axis == "surface_soc:0.05/1000/6500/30" and variant_of(emptying.to_json()) == emptying


def test_what_charge_and_discharge_lose_differently_is_fitted_and_can_be_left_out() -> None:
    alike = bank(n=4000)
    more = [replace(run, voltage_V=run.voltage_V + 0.01 * np.maximum(run.current_A, 0.0)) for run in alike.runs]
    unequal = SignalBank(more, alike.initial_soc, alike.cell)
    errors_V = []
    for own in (alike, unequal):
        for without in ((), (BOTH_WAYS,)):
            tried = Trials(own, without)
            errors_V.append(tried.mean(tried.error(Variant())))
    assert errors_V[0] == pytest.approx(errors_V[1], rel=0.05)
    assert errors_V[2] < 2.0 * errors_V[0] < 0.5 * errors_V[3]


def test_kinds_of_models_are_compared_on_whole_runs_of_three_and_on_blocks_of_two() -> None:
    two = bank(n=3000)
    again = Trials(two)
    np.testing.assert_array_equal(again.outer_error(Variant())[0], again.error(Variant()))
    runs = [*two.runs, replace(two.runs[0], voltage_V=two.runs[0].voltage_V + 0.05)]
    three = Trials(SignalBank(runs, [*two.initial_soc, two.initial_soc[0]], two.cell))
    mse, counts = three.outer_error(Variant())
    assert len(mse) == 3 and counts.sum() == sum(int(run.measured.sum()) for run in runs)
    # Of the moved run nothing was seen: all of its 50 mV are an error, of its blocks about half.
    assert mse[2] > 2.0 * three.error(Variant()).max()
