"""The socket that the server gets."""

import socket

from bench_service.app.server import _bound


def test_what_is_accepted_sends_small_answers_at_once() -> None:
    with _bound("127.0.0.1", 0) as listener:
        with socket.create_connection(listener.getsockname()) as client:
            accepted, _ = listener.accept()
            with accepted:
                assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
                assert client.getpeername() == listener.getsockname()
