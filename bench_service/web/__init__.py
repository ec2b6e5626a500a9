"""The page served at ``/``: a client of the public REST and WebSocket API and of nothing else."""
