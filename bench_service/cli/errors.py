"""What only the command line can find wrong."""


class UsageError(Exception):
    """Arguments that contradict each other or the machine (a port in use); one line for a person."""
