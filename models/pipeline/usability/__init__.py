"""Whether a fitted model can be used, and what it was made from leaves open: one file for each kind of reason."""
