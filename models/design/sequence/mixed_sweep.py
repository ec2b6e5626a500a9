"""The whole window up, down and up again in pieces of several kinds, speeds and sizes: covered, not known best.

What is optimal for a model by its information alone puts all time where that model says that it learns most: on the
strongest currents, where a cell is warm and the model's structure is wrong. Box and Draper, J. Am. Stat. Assoc. 54,
1959: where a model is not the truth, a design that is spread evenly over the asked region leaves less error in it than
one that makes the variance least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.design.sequence.excitation_sequence import Block, ExcitationSequence
from models.design.sequence.sequence_builder import FULL_PULSE, SequenceBuilder
from models.design.sequence.sequence_plan import SequencePlan

# All constants: benchmarks/design_coverage.py, seeds 20 to 23.
# Of one piece: long enough for the middle time constants of cells, and four to six of them on a way.
_PIECE_S = 500.0
# Mean current of every second piece over that of the way, and of the others; their mean is 1.
_SPEEDS = (1.35, 0.65)
# Of the room that the mean current leaves to the limits, in turn; with the three kinds and the two speeds a pattern
# that comes back after twelve pieces.
_SHARES = (1.0, 0.4, 0.7, 0.25)
# Of the largest current: the mean of a way at the most, so that the fast pieces still have room.
_MOST_MEAN = 0.68
# Ways shorter than this are none: the start lies at an end.
_SHORTEST_SOC = 0.02
# Shortest and longest hold of random steps, longest and shortest period of the sines in s.
_HOLDS_S, _PERIODS_S, _SINES = (2.0, 120.0), (4.0, 500.0), 20
# After every so many pieces a full pulse and a rest.
_STOP_AFTER, _REST_S = 6, 150.0
# Where the voltage makes the way to an end slower than planned, the rest of it is planned anew so many times.
_PLANS = 4

Wave = Callable[[int, float, np.random.Generator], FloatArray]


def mixed_sweep(plan: SequencePlan, duration_s: float, seed: int) -> ExcitationSequence | None:
    """Sweep the window of a plan.

    Parameters
    ----------
    plan : limits, ends of the window and the rest there, what the voltage leaves; its levels and blocks are not used
    duration_s : of the whole
    seed : of the random parts; the mean currents, their order, kinds and sizes do not depend on it

    Returns
    -------
    ExcitationSequence or None
        Its blocks are the pieces. What is laid over a mean may swing a little beyond the window: the caller moves the
        whole into all limits. None: the plan has no ends, or the time does not suffice to go to both.
    """
    if plan.ends is None:
        return None
    low, high = plan.ends
    first = (high,) if high - plan.initial_soc > _SHORTEST_SOC else ()
    # To the upper end, the lower one, and the upper one again if there is time.
    found = _fitted(plan, (*first, low, high), duration_s, seed)
    return _fitted(plan, (*first, low), duration_s, seed) if found is None else found


def _fitted(plan: SequencePlan, ends: tuple[float, ...], duration_s: float, seed: int) -> ExcitationSequence | None:
    """Go to some ends in a time; None: it does not suffice."""
    time_s = duration_s
    for _ in range(_PLANS):
        if _mean_A(plan, ends, time_s) > _MOST_MEAN * _amplitude_A(plan):
            return None
        found = _swept(plan, ends, time_s, np.random.default_rng([seed, 11]))
        over_s = found.duration_s - duration_s
        if over_s <= 0.5 * plan.dt_s:
            missing = round(duration_s / plan.dt_s) - len(found.current_A)
            return replace(found, current_A=np.append(found.current_A, np.zeros(missing)))
        time_s -= over_s + plan.dt_s
    return None


def _amplitude_A(plan: SequencePlan) -> float:
    low_A, high_A = plan.limits.current_A
    return min(-low_A, high_A)


def _moving_s(plan: SequencePlan, ends: tuple[float, ...], time_s: float) -> float:
    """Time without the pulses and the rests."""
    stopped = (_REST_S + plan.pulse_s) / (_STOP_AFTER * _PIECE_S)
    return time_s / (1.0 + stopped) - len(ends) * (plan.end_rest_s + plan.pulse_s)


def _mean_A(plan: SequencePlan, ends: tuple[float, ...], time_s: float) -> float:
    """Mean size of the current on the ways between the ends."""
    moving_s = _moving_s(plan, ends, time_s)
    ways = float(np.abs(np.diff([plan.initial_soc, *ends])).sum())
    return np.inf if moving_s <= 0.0 else ways * 3600.0 * plan.capacity_Ah / moving_s


def _swept(plan: SequencePlan, ends: tuple[float, ...], time_s: float, rng: np.random.Generator) -> ExcitationSequence:
    way_A, number, blocks = _mean_A(plan, ends, time_s), 0, list[Block]()
    builder = SequenceBuilder(plan.limits, plan.capacity_Ah, plan.initial_soc, plan.dt_s, plan.pulse_s, plan.ratio)
    for end in ends:
        way = end - builder.soc
        way_s = abs(way) * 3600.0 * plan.capacity_Ah / way_A
        # An even number of pieces: fast and slow ones in turn make up for each other.
        count = 2 * max(1, round(0.5 * way_s / _PIECE_S))
        samples = max(1, round(way_s / count / plan.dt_s))
        for left in range(count, 0, -1):
            # Pulses and what the voltage took are made up for by the pieces that are left.
            speed_A = (end - builder.soc) * 3600.0 * plan.capacity_Ah / (samples * plan.dt_s)
            mean_A = speed_A * _speed(number) / sum(_speed(number + k) for k in range(left))
            current_A = _piece_A(plan, builder.soc, mean_A, samples, number, rng)
            soc, first = builder.soc, builder.append(current_A)
            blocks.append(Block(first, first + samples, soc))
            number += 1
            if number % _STOP_AFTER == 0:
                # All that the limits allow, one way and the other in turn: the pieces only come near them.
                builder.pulse((-1.0) ** (number // _STOP_AFTER), FULL_PULSE, plan.pulse_s)
                builder.rest(_REST_S)
        # What rounding and the voltage have left of the way.
        builder.reach(end)
        builder.rest(plan.end_rest_s)
        # Into the window again by a full pulse as well.
        builder.pulse(-float(np.sign(way)), FULL_PULSE, plan.pulse_s)
    return ExcitationSequence(builder.current_A(), plan.dt_s, tuple(blocks))


def _speed(number: int) -> float:
    return _SPEEDS[number % len(_SPEEDS)]


def _piece_A(
    plan: SequencePlan, soc: float, mean_A: float, samples: int, number: int, rng: np.random.Generator
) -> FloatArray:
    """(samples,) one piece: its mean carries the charge on, what is laid over it depends on its number."""
    after = soc + mean_A * samples * plan.dt_s / 3600.0 / plan.capacity_Ah
    low_A, high_A = (
        limit_A * plan.ratio.least(sign, soc, after)
        for limit_A, sign in zip(plan.limits.current_A, (-1.0, 1.0), strict=True)
    )
    if not low_A < mean_A < high_A:
        # The voltage leaves less than the mean.
        mean_A = float(np.clip(mean_A, _MOST_MEAN * low_A, _MOST_MEAN * high_A))
    wave = _WAVES[number % len(_WAVES)](samples, plan.dt_s, rng)
    wave = wave - wave.mean()
    wave = wave / max(float(np.abs(wave).max()), 1e-12) * _SHARES[number % len(_SHARES)]
    return _with_mean(np.where(wave > 0.0, high_A - mean_A, mean_A - low_A) * wave, mean_A, low_A, high_A)


def _with_mean(wave_A: FloatArray, mean_A: float, low_A: float, high_A: float) -> FloatArray:
    """A wave within limits, shifted until its mean is the one asked for."""
    least, most = low_A - float(wave_A.max()), high_A - float(wave_A.min())
    for _ in range(60):
        middle = 0.5 * (least + most)
        if float(np.clip(wave_A + middle, low_A, high_A).mean()) < mean_A:
            least = middle
        else:
            most = middle
    return np.clip(wave_A + most, low_A, high_A)


def _steps(samples: int, dt_s: float, rng: np.random.Generator) -> FloatArray:
    """Random levels, held for random times whose logarithm is even."""
    times_s = np.exp(rng.uniform(np.log(_HOLDS_S[0]), np.log(_HOLDS_S[1]), samples))
    counts = np.maximum(1, (times_s / dt_s).astype(int))
    return np.repeat(rng.uniform(-1.0, 1.0, samples), counts)[:samples]


def _sines(samples: int, dt_s: float, rng: np.random.Generator) -> FloatArray:
    """Sines of random phase, their periods spread evenly over the decades."""
    shortest_s = max(_PERIODS_S[0], 4.0 * dt_s)
    periods_s = np.geomspace(shortest_s, max(min(_PERIODS_S[1], samples * dt_s), shortest_s), _SINES)
    angles = 2.0 * np.pi * dt_s * np.arange(samples)[:, None] / periods_s
    return np.sin(angles + rng.uniform(0.0, 2.0 * np.pi, _SINES)).sum(axis=1)


def _pulses(samples: int, dt_s: float, rng: np.random.Generator) -> FloatArray:
    """One pulse up and one down, each with its mean current before and after it."""
    part = max(1, samples // 6)
    wave = np.zeros(samples)
    wave[part : 2 * part], wave[3 * part : 4 * part] = 1.0, -1.0
    return wave


_WAVES: tuple[Wave, ...] = (_steps, _sines, _pulses)
