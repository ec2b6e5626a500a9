"""Test protocols as data: what a step, an end, a loop is; and the machine that plays them tick by tick, with no I/O."""
