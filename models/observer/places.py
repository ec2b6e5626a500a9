"""Where what stands in the observer's state, constants, memory and output row."""

from __future__ import annotations

# Places in the state after the n past outputs.
AT_SOC, AT_QUICK, AT_SLOW, AT_OFFSET, AT_CAPACITY, AT_VOLTAGE, AT_RESISTANCE, N_EXTRA = range(8)
# Constants: noise variances per sample (normalised output, SoC, measurement); how much of the quick error is kept from
# sample to sample; how fast the slow error fades with time (per sample) and with charge (per unit of SoC); their
# standard deviations (normalised); whether the steady-state gains are used; weight of a sample in the net movement;
# the little more current (0: no offset is estimated); nominal capacity; by how much the SoC's band is widened;
# relative standard deviation of the resistances; what the variance that innovations are judged by has more.
Q_OUTPUT, Q_SOC, R_VOLTAGE, QUICK_KEEP, SLOW_RATE, SLOW_CHARGE, QUICK_STD, SLOW_STD, STEADY, NET_SHARE, MORE_A = range(
    11
)
CAPACITY_AH, BAND, RESISTANCE_STD, R_JUDGED_MORE = 11, 12, 13, 14
N_CONSTANTS = 15
# Memory besides the filters: last current, direction, last temperature, samples seen, charge counted since the start,
# and how the state of charge moves on average over `NET_S`.
HELD_CURRENT, HELD_DIRECTION, HELD_TEMPERATURE, SEEN, COUNTED, NET = range(6)
N_HELD = 6
# A load that only swings does not leave the place on the open-circuit curve at which the model is wrong.
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
# of each state; covariance on its way.
LIKELIHOOD_ROW, EXPECTED_ROW, INNOVATION_ROW, OUTPUT_ROW, GAIN_ROW, VALIDITY_ROW, TILT_ROW = range(7)
BLENDED_ROW, TILTED_ROW, KEPT_ROW, MOVED_ROWS = range(7, 11)
