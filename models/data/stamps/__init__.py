"""Time stamps as they come: what a logger, its clock, or a person's filter has done to them, found and undone."""
