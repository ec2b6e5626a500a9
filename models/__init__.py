"""Pure mathematics of the test bench: arrays in, arrays out."""
