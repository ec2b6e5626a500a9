"""A network that is physical by construction: monotone open-circuit voltage, no negative gain, no output feedback."""
