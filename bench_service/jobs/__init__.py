"""Long work in worker processes: the service answers while it goes on, and outlives its crash."""
