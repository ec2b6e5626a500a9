"""Protocols of other programs, in and out; what the other cannot say fails and names the step."""
