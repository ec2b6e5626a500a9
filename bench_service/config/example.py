"""The commented `bench.toml` that `bench-service config init` writes; its values are the defaults."""


def example_config() -> str:
    """Text of a commented `bench.toml` whose values are the defaults."""
    return _EXAMPLE


_EXAMPLE = """\
# Configuration of bench-service. Every value here is the default. Positive current charges the cell.

# Where runs, samples and models are kept. The environment variable BENCH_DATA_DIR wins over this line.
data_dir = "bench-data"

# Whose service this is: the first part of the names of files that go out, as Institution__Cell__20260102_001.bdf.csv.
institution = "laboratory"

# Room in MB that must be left on the disk when a run has been stored; a run that would leave less is refused.
free_floor_MB = 200.0

# Worker processes for fits and comparisons, and how much they give way to other programs: 19 most, 0 not at all. On a
# machine that others keep busy, 19 gets them hardly any time. The environment variable BENCH_WORKER_NICE wins.
workers = 1
worker_nice = 19

# An address that is told of each run that has ended, such as that of an electronic notebook (docs/notebook.md).
# [webhook]
# url = "https://notebook.example/hooks/bench"
# Signs what is sent: header X-Bench-Signature, "sha256=" and the HMAC-SHA256 of the body. Absent: no signature.
# secret = "sixteen-letters-or-more"
# Sent as "Authorization: Bearer ...". Absent: no such header.
# token = "..."
# Longest wait for an answer, and how long it is tried again where none comes.
# timeout_s = 10.0
# retry_h = 24.0

# Programs of your own that read what is not read here: each gets the path of the file, and prints a table as CSV or
# Parquet (docs/files.md).
# [readers]
# ".mpr" = ["python3", "docs/example-readers/mpr_galvani.py"]

# One table per bench. "sim" is simulated: the service starts its simulator itself.
[bench.sim]
# A real cycler instead of a simulated one:  url = "modbus-tcp://192.168.1.50:502"  and no "simulate" table; or
# "modbus-rtu:///dev/ttyUSB0?baud=115200&parity=N", or "can://socketcan/can0?bitrate=500000&node=1&log=traffic";
# capacity_Ah and the limits of voltage, current and temperature must then be stated.
# Register map: a name from drivers/maps, or the path of a .toml file.
map = "generic"
# File of a cell type, from the folder of this file: limits must lie within what its data sheet allows, and what nobody
# states is taken from it (docs/commissioning.md). Absent: limits are what is stated here.
# cell_type = "cells/my-cell.toml"
# Nominal capacity of the cell, for counting charge before a run. Simulated: the simulated cell's own.
capacity_Ah = 2.5
# The cycler's own watchdog switches its output off after this time without a command. Above 2 s, or with a
# device that has none, the bench starts only with external_interlock = true: your declaration that hardware
# of its own protects the cell.
watchdog_s = 1.0
external_interlock = false
# Longest wait for one answer of the cycler, and the time after a set-point change in which the measured
# current is not yet compared with the commanded one.
timeout_s = 0.5
settle_s = 1.0
# How the observer that runs live with a model weighs the voltage: "kalman", by the covariance of the moment, or
# "steady", by gains worked out beforehand for each local model. Absent: as the model has it, which is "kalman".
# observer_gain = "steady"

[bench.sim.simulate]
# modbus-tcp, modbus-rtu (a pseudo-terminal, paced to its baud rate) or can (needs map = "generic_can")
protocol = "modbus-tcp"
baud = 115200
# nmc, lfp or nimh
cell = "nmc"
# A module of such cells: "4x2" has 4 in series and 2 in parallel. Absent: one cell.
# module = "4x2"
# Physical effects of the simulated cell on top of its own, for example { hysteresis = 0.02 }.
effects = {}
# One more effect that nobody is told: "random" or a name; the page looks for it and opens the seal.
# hidden_effect = "random"
# What goes wrong when, for example "silence@sample:30; nan.voltage@t:12.5+3" (docs/cyclers.md).
faults = ""
seed = 1
# true: simulated time moves one period per sample, as fast as the machine can. false: the wall clock, times speed.
lock_step = true
speed = 1.0
# Where the cell starts, and the temperature around it.
initial_soc = 0.5
ambient_degC = 25.0
# True capacity of the simulated cell. Absent: the cell's own.
# capacity_Ah = 2.5

# A temperature chamber around the cell, which protocols then set (steps "chamber" and "soak"; docs/cyclers.md). Without
# a url it is simulated, as the bench is. Take the "#" away before all lines that are wanted.
# [bench.sim.chamber]
# url = "modbus-tcp://192.168.1.60:502"
# Register map of kind "chamber": a name from drivers/maps, or the path of a .toml file.
# map = "generic_chamber"
# Window of its set points. Absent: the bench's limits of temperature.
# temperature_degC = [0.0, 50.0]
# How near its air counts as there, and how far beyond the window the air may be before a run is ended.
# tolerance_K = 1.0
# overshoot_K = 5.0
# Longest wait for one answer, and the time without one after which a run is ended.
# timeout_s = 1.0
# lost_s = 30.0
# After a run that has set it, and after every run that did not come to its own end: "off", "keep", or a set point.
# at_end = "off"
# A simulated one: how fast it is, and what goes wrong when.
# simulate = { ramp_K_per_min = 3.0, faults = "" }

# Limits of the bench. A run may only narrow them. Simulated: what the simulated cell allows.
[bench.sim.limits]
voltage_V = [2.5, 4.2]
current_A = [-10.0, 5.0]
temperature_degC = [-20.0, 60.0]
soc = [0.0, 1.0]
# Largest change of the set-point per second. Absent: steps are allowed.
# ramp_A_per_s = 10.0
# Longest run: 14 days.
duration_s = 1209600.0
"""
