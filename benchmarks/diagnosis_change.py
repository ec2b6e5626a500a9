"""Change mode on blind cases: a cell is measured, something changes, it is measured again.

``python benchmarks/diagnosis_change.py [--cases 60] [--nulls 20] [--seed 0] [--train-runs 1] [--rows FILE] [--json]``

A base is a cell (NMC or LFP, every parameter moved at random) with one training run (load cycle, pulses and rests, or
designed; chamber still or moving), or up to three of them, and what is remembered of it; cases share bases. Each case
draws one effect of the whole catalogue, a quarter of them two, and a size that shows by 2 to 20 mV (0.3 to 3 K in the
temperature) above what a perfect model of the cell before the change would do, and measures one of four further
profiles of the base.
"""

import sys
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from diagnosis_cases import (
    TARGET_K,
    TARGET_MV,
    TWINS,
    Row,
    Sight,
    answered,
    is_thermal,
    middle,
    parser_of,
    quick_network,
    run_cases,
    scaled,
    stated_power,
)
from diagnosis_cells import (
    ALL_SIZES,
    CHAMBER_MOVES,
    CHEMISTRIES,
    PROFILES,
    Rig,
    chamber_degC,
    changed,
    current_A,
    play,
    random_cell,
    true_parameter,
)

from models.data.resampling import to_grid
from models.diagnosis import diagnose, memory_of
from models.diagnosis.known.memory import KnownRuns
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import minimal_structure
from simulators.cell import SOC_SCALE
from simulators.sensors import SensorParameters

TRAIN_S, RUN_S = 18_000.0, 11_000.0
INITIAL_SOC = 0.85
BASES, PLANS, PAIRS_EVERY = 12, 4, 4


@dataclass(frozen=True)
class Base:
    """A cell before the change, with what is remembered of its training run."""

    rig: Rig
    profile: str
    chemistry: str
    moves: bool
    memory: KnownRuns
    network: LocalModelNetwork


@cache
def base(seed: int, number: int, train_runs: int) -> Base:
    """Base of a number: chemistry, profile and chamber take turns; of more runs than one the profiles do, too."""
    rng = np.random.default_rng([seed, number, 7])
    chemistry, profile = CHEMISTRIES[number % 2], PROFILES[number // 2 % 3]
    moves = bool(number // 6 % 2)
    rig = Rig(random_cell(chemistry, rng), SensorParameters())
    capacity_Ah = rig.cell.capacity_Ah
    grid = []
    for k in range(train_runs):
        own = PROFILES[(PROFILES.index(profile) + k) % len(PROFILES)]
        current = current_A(own, capacity_Ah, INITIAL_SOC, TRAIN_S, rng)
        run = play(rig, current, chamber_degC(moves, len(current), rng), INITIAL_SOC, rng, f"before {k}")
        grid.append(to_grid(run, 1.0))
    # The figures of an answer are about a network; what is found rests on the memory alone.
    network, _ = quick_network(grid[0], INITIAL_SOC, capacity_Ah, minimal_structure(1.0, output_order=0))
    return Base(rig, profile, chemistry, moves, memory_of(grid, [INITIAL_SOC] * train_runs, capacity_Ah), network)


def judge(seed: int, number: int, null: bool, train_runs: int = 1) -> Row:
    """Draw one case, measure, diagnose."""
    rng = np.random.default_rng([seed, number, 10 + null])
    while True:
        found = _drawn(seed, number, null, train_runs, rng)
        if found is not None:
            break
    own, current, chamber, rig, truth, sizes, shows = found
    run = play(rig, current, chamber, INITIAL_SOC, rng, "after")
    stated = INITIAL_SOC + rig.stated_soc_error
    answer = diagnose(own.network, [run], [stated], memory=own.memory, mode="change")
    row = answered(answer, truth)
    off = None
    if len(truth) == 1 and row["right"] and row["named"][0] == truth[0]:
        off = _off(truth[0], own.rig, rig, sizes[0], row["parameters"][truth[0]])
    return row | {
        "cell": own.chemistry,
        "profile": own.profile,
        "moves": own.moves,
        "sizes": sizes,
        "shows": shows,
        "parameter_error": off,
        "power": stated_power(answer, truth),
    }


def _drawn(seed: int, number: int, null: bool, train_runs: int, rng: np.random.Generator) -> tuple[Any, ...] | None:
    """A base, a profile, and effects of random size; None where one of them cannot be made to show."""
    n_effects = 0 if null else 2 if number // BASES % PAIRS_EVERY == PAIRS_EVERY - 1 else 1
    truth = [str(each) for each in rng.choice(sorted(ALL_SIZES), size=n_effects, replace=False)]
    if set(truth) >= TWINS:
        return None
    # The base goes with the number, so that no profile is drawn less often because effects show less in it.
    chosen = number % BASES
    if any(each in CHAMBER_MOVES for each in truth) and chosen // 6 % 2 == 0:
        chosen += 6
    own = base(seed, chosen, train_runs)
    sight = _sight(seed, chosen, train_runs, int(rng.integers(PLANS)))
    rig, sizes, shows = own.rig, [], []
    for name in truth:
        thermal = is_thermal(name)
        target = float(np.exp(rng.uniform(*np.log(TARGET_K if thermal else TARGET_MV))))
        size = ALL_SIZES[name]
        middle_shows = sight.shows(rig, changed(rig, name, middle(size)), thermal)
        made = scaled(partial(changed, rig, name), size, rng, target, middle_shows)
        if made is None:
            return None
        rig, x, shown = made
        sizes.append(x)
        shows.append(shown)
    return own, sight.current, sight.chamber, rig, truth, sizes, shows


@cache
def _sight(seed: int, number: int, train_runs: int, plan: int) -> Sight:
    """One of the profiles that are played after the change."""
    own, rng = base(seed, number, train_runs), np.random.default_rng([seed, number, plan, 8])
    current = current_A(own.profile, own.rig.cell.capacity_Ah, INITIAL_SOC, RUN_S, rng)
    return Sight(current, chamber_degC(own.moves, len(current), rng), INITIAL_SOC)


def _off(truth: str, before: Rig, after: Rig, size: float, values: dict[str, float]) -> float:
    """Relative error of the primary parameter; of a curve over SoC, its RMS over the points that are given."""
    if truth in ("ocv_shape", "soc_dependence"):
        soc = np.array([float(name.rsplit(" ", 1)[1]) for name in values])
        if truth == "ocv_shape":
            curves = [rig.cell.open_circuit.voltage_V for rig in (before, after)]
            true = 1e3 * np.array([curves[1](s) - curves[0](s) for s in soc])
        else:
            true = size * np.exp(-soc / SOC_SCALE)
        return float(np.sqrt(np.mean((np.array(list(values.values())) - true) ** 2) / np.mean(true**2)))
    true = true_parameter(truth, before, after, size)
    found = next(iter(values.values()))
    if truth in ("capacity", "heat_transfer", "initial_soc"):
        # Judged on the change, not on the value itself.
        was = {
            "capacity": before.cell.capacity_Ah,
            "heat_transfer": before.cell.heat_transfer_W_per_K,
            "initial_soc": INITIAL_SOC + after.stated_soc_error,
        }[truth]
        true = INITIAL_SOC if truth == "initial_soc" else true
        return (found - was) / (true - was) - 1.0
    return found / true - 1.0


if __name__ == "__main__":
    parser = parser_of(__doc__)
    parser.add_argument("--train-runs", type=int, choices=(1, 2, 3), default=1, help="of each cell before the change")
    arguments = parser.parse_args()
    sys.exit(run_cases(arguments, partial(judge, train_runs=arguments.train_runs)))
