"""What can be said about an observer before it runs: observability and stability."""
