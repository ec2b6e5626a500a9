"""Structure mode on blind cases: a network whose structure lacks one or two effects that its cell has.

``python benchmarks/diagnosis_structure.py [--cases 60] [--nulls 60] [--seed 0] [--rows FILE] [--json]``

A base is a cell without any effect that the structure lacks (open-circuit curve, ohmic resistance and two fast pairs
remain; NMC or LFP, every parameter moved at random) with a profile (load cycle, pulses and rests, or designed; chamber
still or moving) and a network of just the structure of that bare cell, whose two time constants are only nearly the
cell's; logs begin anywhere in their profiles; cases share bases. Each case draws one effect,
a third of them two, that a refit of the network cannot take in, of a size that leaves 2 to 20 mV after a refit (noise:
1 mV). The network is fitted to the training run with the effect; the diagnosis sees that run and a second one. Every
sixth case also adds what was named and what is true, and compares the errors on a third run.
"""

import sys
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from diagnosis_cases import (
    TARGET_MV,
    TWINS,
    Row,
    Sight,
    answered,
    middle,
    parser_of,
    quick_network,
    run_cases,
    scaled,
)
from diagnosis_cells import (
    CHAMBER_MOVES,
    CHEMISTRIES,
    PROFILES,
    Rig,
    begun_late,
    chamber_degC,
    changed,
    current_A,
    play,
    random_cell,
    true_parameter,
)

from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.diagnosis import diagnose
from models.diagnosis.structure.sensitivities import sensitivities_V
from models.effects import effect
from models.effects.input_correction import corrected
from models.identification.search.given import GivenCandidate
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from simulators.cell import Branch, CellParameters
from simulators.effects import apply_effects
from simulators.hidden_effect import SIZES, Size
from simulators.sensors import SensorParameters

TRAIN_S, RUN_S = 14_000.0, 11_000.0
INITIAL_SOC = 0.85
BASES, PAIRS_EVERY, ADDED_EVERY = 12, 3, 6
# Of the bare cell, whose own value is zero.
BARE_SIZES = {"charge_transfer": Size(0.005, 0.1), "relaxation": Size(0.001, 0.02)}
# What a refitted network without output feedback cannot take in.
LACKING = (
    "charge_discharge_asymmetry",
    "charge_transfer",
    "current_offset",
    "entropic_voltage",
    "hysteresis",
    "relaxation",
    "resistance_growth",
    "self_discharge",
    "temperature_dependence",
)
BRANCHES_S = (1.5, 25.0)
# Factor by which the cell's are off.
MOVED = (0.7, 1.4)
# How far into its profile a log begins.
BEGINS_S = (0.0, 3_000.0)
EXCHANGE_C_RATE = (0.1, 0.8)
_EVERY = 4


@dataclass(frozen=True)
class Base:
    """A bare cell, the currents and chamber temperatures of its runs, and what a refit takes in of the first."""

    rig: Rig
    profile: str
    chemistry: str
    moves: bool
    current: tuple[FloatArray, ...]
    chamber: tuple[FloatArray, ...]
    choice: GivenCandidate
    span: FloatArray


def bare_cell(chemistry: str, rng: np.random.Generator) -> CellParameters:
    """A cell with an open-circuit curve, an ohmic resistance and two pairs whose time constants are nearly known."""
    p = random_cell(chemistry, rng)
    first_s, second_s = (tau_s * float(np.exp(rng.uniform(*np.log(MOVED)))) for tau_s in BRANCHES_S)
    return replace(
        p,
        ohmic_at_empty_Ohm=0.0,
        fast_1=Branch(p.fast_1.resistance_Ohm, first_s),
        fast_2=Branch(p.fast_2.resistance_Ohm, second_s),
        slow=Branch(0.0, p.slow.time_constant_s),
        hysteresis_amplitude_V=0.0,
        charge_transfer_V=0.0,
        exchange_current_A=p.capacity_Ah * float(np.exp(rng.uniform(*np.log(EXCHANGE_C_RATE)))),
        activation_K=0.0,
        dU_dT_V_per_K=0.0,
    )


def bare_structure() -> Structure:
    """Just what the bare cell shows."""
    pairs = tuple(InputChannel(f"low_pass:{tau_s:g}") for tau_s in BRANCHES_S)
    inputs = (InputChannel("soc", delay=1), InputChannel("current"), *pairs)
    return Structure(0, inputs, (PartitionAxis("soc", k_sigma=0.7),), 1.0, name="bare")


@cache
def base(seed: int, number: int) -> Base:
    """Base of a number: chemistry, profile and chamber take turns."""
    rng = np.random.default_rng([seed, number, 11])
    chemistry, profile = CHEMISTRIES[number % 2], PROFILES[number // 2 % 3]
    moves = bool(number // 6 % 2)
    rig = Rig(bare_cell(chemistry, rng), SensorParameters())
    capacity_Ah = rig.cell.capacity_Ah
    current = tuple(current_A(profile, capacity_Ah, INITIAL_SOC, s, rng) for s in (TRAIN_S, RUN_S, RUN_S))
    chamber = tuple(chamber_degC(moves, len(each), rng) for each in current)
    run = to_grid(play(rig, current[0], chamber[0], INITIAL_SOC, rng, "bare"), 1.0)
    network, choice = quick_network(run, INITIAL_SOC, capacity_Ah, bare_structure())
    own = sensitivities_V(network, run, INITIAL_SOC, np.arange(0, len(run), _EVERY))
    return Base(rig, profile, chemistry, moves, current, chamber, choice, np.linalg.qr(own)[0])


def with_effect(rig: Rig, name: str, x: float) -> Rig:
    """The rig with an effect of a signed size."""
    if name in BARE_SIZES:
        return replace(rig, cell=apply_effects(rig.cell, rig.sensors, {name: x})[0])
    return changed(rig, name, x)


def judge(seed: int, number: int, null: bool) -> Row:
    """Draw one case, fit the network that lacks the effects, diagnose."""
    rng = np.random.default_rng([seed, number, 20 + null])
    while True:
        drawn = _drawn(seed, number, null, rng)
        if drawn is not None:
            break
    own, rig, truth, sizes, shows = drawn
    capacity_Ah = own.rig.cell.capacity_Ah
    logs = [_log(own, rig, k, rng) for k in range(2)]
    runs, soc = [run for run, _ in logs], [start for _, start in logs]
    network, _ = quick_network(to_grid(runs[0], 1.0), soc[0], capacity_Ah, bare_structure(), own.choice)
    answer = diagnose(network, [runs[1]], [soc[1]], train=[runs[0]], train_soc=[soc[0]], mode="structure")
    row = answered(answer, truth)
    off = ratio = None
    if len(truth) == 1 and row["right"] and row["named"][0] == truth[0]:
        found = next(iter(row["parameters"][truth[0]].values()))
        off = found / true_parameter(truth[0], own.rig, rig, sizes[0]) - 1.0
    if truth and row["right"] and number % ADDED_EVERY < 2:
        values = {name: row["parameters"][name] for name in row["named"]}
        right = {name: _true_values(name, own.rig, rig, x) for name, x in zip(truth, sizes, strict=True)}
        held_out = _log(own, rig, 2, rng)
        errors = [_with(network, own.choice, each, logs[0], held_out) for each in (values, right)]
        ratio = errors[0] / errors[1]
    return row | {
        "cell": own.chemistry,
        "profile": own.profile,
        "moves": own.moves,
        "sizes": sizes,
        "shows": shows,
        "parameter_error": off,
        "held_out_ratio": ratio,
    }


def _log(own: Base, rig: Rig, number: int, rng: np.random.Generator) -> tuple[TimeSeries, float]:
    """A measured profile of a base from anywhere on, with the state of charge at its start."""
    whole = play(rig, own.current[number], own.chamber[number], INITIAL_SOC, rng, f"run {number}")
    return begun_late(whole, own.rig.cell.capacity_Ah, float(rng.uniform(*BEGINS_S)))


def _drawn(
    seed: int, number: int, null: bool, rng: np.random.Generator
) -> tuple[Base, Rig, list[str], list[float], list[float]] | None:
    """A base and effects of random size; None where one of them cannot be made to show."""
    n_effects = 0 if null else 2 if number // BASES % PAIRS_EVERY == PAIRS_EVERY - 1 else 1
    truth = [str(each) for each in rng.choice(LACKING, size=n_effects, replace=False)]
    if set(truth) >= TWINS:
        return None
    # The base goes with the number, so that no profile is drawn less often because effects show less in it.
    chosen = number % BASES
    if any(each in CHAMBER_MOVES for each in truth) and chosen // 6 % 2 == 0:
        chosen += 6
    own = base(seed, chosen)
    rig, sizes, shown = own.rig, [], []
    for name in truth:
        target = float(np.exp(rng.uniform(*np.log(TARGET_MV))))
        size = BARE_SIZES.get(name) or SIZES[name]
        made = scaled(partial(with_effect, rig, name), size, rng, target, shows_mV(seed, chosen, name))
        if made is None:
            return None
        rig = made[0]
        sizes.append(made[1])
        shown.append(made[2])
    return own, rig, truth, sizes, shown


@cache
def shows_mV(seed: int, number: int, name: str) -> float:
    """What a refit leaves of an effect of middle size in a base's training run."""
    own, size = base(seed, number), BARE_SIZES.get(name) or SIZES[name]
    after = with_effect(own.rig, name, middle(size))
    error = Sight(own.current[0], own.chamber[0], INITIAL_SOC).error_V(own.rig, after)[::_EVERY]
    left = error - own.span @ (own.span.T @ error)
    return 1e3 * float(np.sqrt(np.mean(left**2)))


def _true_values(name: str, before: Rig, after: Rig, x: float) -> dict[str, float]:
    """Every parameter of an effect that putting it into a model asks for."""
    first = effect(name).parameters[0].name
    further = {
        "charge_transfer": {"exchange_current_A": after.cell.exchange_current_A},
        "hysteresis": {"rate": after.cell.hysteresis_rate},
        "relaxation": {"time_constant_s": after.cell.slow.time_constant_s},
    }
    return {first: true_parameter(name, before, after, x)} | further.get(name, {})


def _with(
    network: LocalModelNetwork,
    choice: GivenCandidate,
    added: dict[str, dict[str, float]],
    trained: tuple[TimeSeries, float],
    judged: tuple[TimeSeries, float],
) -> float:
    """RMS error on a held-out run, in V, of a network to which effects were added."""
    capacity_Ah, structure = network.cell.capacity_Ah, network.structure
    (train, train_soc), (held_out, soc) = trained, judged
    for name, values in added.items():
        extend = effect(name).extend
        if extend is not None:
            structure = extend(structure, values, capacity_Ah)
        train, held_out = corrected(train, effect(name), values), corrected(held_out, effect(name), values)
    wider, _ = quick_network(to_grid(train, 1.0), train_soc, capacity_Ah, structure, replace(choice, given=structure))
    run = to_grid(held_out, 1.0)
    return float(np.sqrt(np.mean((run.voltage_V - free_run_V(wider, run, soc)) ** 2)))


if __name__ == "__main__":
    sys.exit(run_cases(parser_of(__doc__).parse_args(), judge))
