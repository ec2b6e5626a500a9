"""Weights of what may have changed, what a run says of them, and how likely each set of changes is by that."""
