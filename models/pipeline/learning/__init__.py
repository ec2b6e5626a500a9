"""A model that learns from run to run: what the cell holds now, then its local models sample by sample."""
