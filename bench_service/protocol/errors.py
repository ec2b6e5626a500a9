"""What is wrong with a protocol."""

from bench_service.errors import BadRequestError


class ProtocolError(BadRequestError):
    """A protocol that cannot be played, or cannot be said in another format; the message names the step."""

    code = "bad_protocol"
