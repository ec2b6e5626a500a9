"""What a bounded network may be made of."""

import pytest

from models.data.errors import ModelError
from models.identification.bounded.terms import BOTH_WAYS, LOOP, SCALED, SLOPE, SLOW, TRANSFER, Basis, make_basis

PARTS = (BOTH_WAYS, LOOP, SCALED, SLOPE, SLOW, TRANSFER)


def parts(basis: Basis) -> set[str]:
    return {name for term in basis.terms for name in term.parts}


def test_terms_follow_what_the_runs_say_of_temperature() -> None:
    moving, one, missing = (make_basis(1.0, 2.5, temperature) for temperature in ("moves", "one", "missing"))
    assert "scaled_current:7500" in {term.signal for term in moving.terms}
    assert [term.signal for term in moving.terms if not term.bounded] == ["temperature"]
    assert parts(moving) - parts(one) == {SCALED, SLOPE}
    assert parts(one) == parts(missing)
    # Without a temperature nothing may be scaled by it.
    assert not any("3500" in term.signal or "4000" in term.signal for term in missing.terms)


def test_low_passes_that_the_sampling_cannot_tell_are_left_out() -> None:
    fast, slow = (make_basis(dt_s, 2.5, "missing") for dt_s in (1.0, 30.0))
    assert "low_pass:2/0" in {term.signal for term in fast.terms}
    assert not {"low_pass:2/0", "low_pass:20/0"} & {term.signal for term in slow.terms}
    assert "low_pass:60/0" in {term.signal for term in slow.terms}


def test_an_effect_goes_with_all_of_its_terms() -> None:
    basis = make_basis(1.0, 2.5, "moves", squared=True)
    for name in PARTS:
        left = basis.without((name,))
        assert name not in parts(left) and 0 < len(left.terms) < len(basis.terms)
    assert [term.signal for term in basis.without(PARTS).terms][0] == "current"


def test_what_is_not_there_cannot_be_left_out() -> None:
    with pytest.raises(
        ModelError,
        match="slope with temperature cannot be left out.*it has asymmetry of charge and discharge, charge_transfer",
    ):
        make_basis(1.0, 2.5, "one").without((SLOPE,))


def test_directions_differ_only_where_it_pays_until_it_is_asked_for() -> None:
    plain, asked = (make_basis(1.0, 2.5, "moves", finer=finer).terms for finer in ((), (BOTH_WAYS,)))
    assert {term.held for term in plain if BOTH_WAYS not in term.parts} == {1.0}
    assert min(term.held for term in plain if BOTH_WAYS in term.parts) > 1.0
    assert {term.held for term in asked} == {1.0}
    # As many that only charge knows as only discharge does, none of them without transfer.
    ways = [term.signal.split("/")[0] for term in plain if BOTH_WAYS in term.parts]
    assert ways.count("directed_transfer:1") == ways.count("directed_transfer:-1") == len(ways) / 2
    assert BOTH_WAYS not in parts(make_basis(1.0, 2.5, "moves").without((TRANSFER,)))


def test_a_part_can_have_more_resolution() -> None:
    plain = {term.signal for term in make_basis(1.0, 2.5, "moves").terms}
    for name in (LOOP, SLOW, TRANSFER, SCALED):
        finer = make_basis(1.0, 2.5, "moves", finer=(name,))
        more = [term for term in finer.terms if term.signal not in plain]
        assert plain < {term.signal for term in finer.terms}
        assert all(name in term.parts for term in more)
