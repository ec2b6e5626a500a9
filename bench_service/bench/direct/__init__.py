"""The short way to a bench: stop and acknowledge on a loopback port of its control process, past the API."""
