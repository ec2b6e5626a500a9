"""Where what stands in the observer's state, constants, memory and output row, for compiled functions (njit)."""

from __future__ import annotations

from typing import Any

# How the observer's loops are compiled: without counting references to arrays, which took longer than the arithmetic
# (nothing inside allocates), and with a division by zero giving inf.
COMPILED: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}
# Places in the state after the n past outputs.
AT_SOC, AT_QUICK, AT_SLOW, AT_OFFSET, AT_CAPACITY, AT_VOLTAGE, AT_RESISTANCE, N_EXTRA = range(8)
# Last, of a network with hysteresis only: the place in the loop at the start, -1 (discharged) to 1 (charged).
AT_LOOP = N_EXTRA
# Places in the memory of a signal of hysteresis: its value, and how much of the place at the start is left in it.
LOOP_VALUE, LOOP_LEFT = range(2)
# Constants: noise variances per sample (normalised output, SoC, measurement); how much of the quick error is kept from
# sample to sample; how fast the slow error fades with time (per sample) and with charge (per unit of SoC); whether the
# steady-state gains are used; weight of a sample in the net movement; the little more current (0: no offset is
# estimated); nominal capacity; by how much the SoC's band is widened; relative standard deviation of the resistances,
# and that of a resistance in series (normalised output per ampere); what the variance that innovations are judged by
# has more; the trained temperatures (degC), and how far from them the model's error is twice as large (K).
Q_OUTPUT, Q_SOC, R_VOLTAGE, QUICK_KEEP, SLOW_RATE, SLOW_CHARGE, STEADY, NET_SHARE, MORE_A = range(9)
CAPACITY_AH, BAND, RESISTANCE_STD, SERIES_STD, R_JUDGED_MORE, TRAINED_LOW, TRAINED_HIGH, DOUBLING_K = range(9, 17)
N_CONSTANTS = 17
# Rows of the sizes that the model's error has near each local model.
QUICK_SIZE, SLOW_SIZE, N_ERRORS = range(3)
# Memory besides the filters: last current, direction, last temperature, samples seen, charge counted since the start,
# how the state of charge moves on average over `NET_S`, what the current sensor reads too much with its standard
# deviation, for how many samples in a row the current has been missing, and how much of what a missing current did is
# still in the voltage (0 to 1).
HELD_CURRENT, HELD_DIRECTION, HELD_TEMPERATURE, SEEN, COUNTED, NET, HELD_OFFSET, HELD_OFFSET_STD = range(8)
LOST, LOST_LEFT, N_HELD = 8, 9, 10
# Of a current that is not known, in multiples of the network's rest current: about 1C.
UNKNOWN_CURRENT = 200.0
# A load that only swings does not leave the place on the open-circuit curve at which the model is wrong; and what a
# current has left behind in the voltage is gone after a few times as long.
NET_S = 600.0
# Columns of the output row, in physical units.
SOC_OUT, SOC_STD_OUT, VOLTAGE_OUT, INNOVATION_OUT, INNOVATION_STD_OUT = range(5)
OFFSET_OUT, OFFSET_STD_OUT, CAPACITY_OUT, CAPACITY_STD_OUT, HYPOTHESES_OUT = range(5, 10)
ERROR_OUT = 10
N_OUT = 11
# How far the estimate may leave 0..1: a cell is not more than full, up to what its capacity is uncertain by.
SOC_SLACK = 0.01
# Rows of the scratch space: likelihood, expected voltage and innovation of each hypothesis; output row and gain over
# the states; validity and its derivative over the local models; blended parameters and their derivative; what is kept
# of each state, and two rows of the covariance on its way; for each axis of the partition the kernels of its intervals
# and their derivatives.
LIKELIHOOD_ROW, EXPECTED_ROW, INNOVATION_ROW, OUTPUT_ROW, GAIN_ROW, VALIDITY_ROW, TILT_ROW = range(7)
BLENDED_ROW, TILTED_ROW, KEPT_ROW, MOVED_ROW, COUNTED_ROW, AXIS_ROWS = range(7, 13)
