"""What can be wrong with a file; each message is one line: file, place, value with unit, what to do."""

from bench_service.errors import BadRequestError


class ExchangeError(BadRequestError):
    """Base of all errors of files that come in or go out."""

    code = "bad_file"


class RunFileError(ExchangeError):
    """A file that cannot be used as a measured run."""


class ProfileFileError(ExchangeError):
    """A file that cannot be used as a current profile."""


class UnknownFormatError(ExchangeError):
    """A format that cannot be written."""
