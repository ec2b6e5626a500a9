"""Errors that the mathematics raises; each message says what, where, the value with its unit and what to do."""


class ModelError(ValueError):
    """Base of all errors that a caller of `models` can cause and mend."""


class TimeSeriesError(ModelError):
    """Measured arrays that cannot be used as they are."""


class StructureError(ModelError):
    """A network structure that contradicts itself, or a document that is not a model."""


class NotIdentifiableError(ModelError):
    """The data do not determine what was asked for; the message names the weak direction in physical words."""
