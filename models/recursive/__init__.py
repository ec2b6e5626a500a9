"""A network that learns on from sample to sample."""
