import pytest

from bench_service.bench.direct.messages import MAX_REQUEST_BYTES, Guard, Order, RefusedError, order_of, read_request

GUARD = Guard("secret", ("http://127.0.0.1:8000",))


def ask(text: str) -> Order | None:
    request = read_request(text.replace("\n", "\r\n").encode())
    assert request is not None
    return order_of(request, GUARD)


def test_the_token_comes_as_a_header_or_as_the_bodys_first_line() -> None:
    assert ask("POST /stop HTTP/1.1\nAuthorization: Bearer secret\n\n") == Order("stop", "")
    request = read_request(b"POST /acknowledge HTTP/1.1\r\nContent-Length: 20\r\n\r\nsecret\nlooked at it\n")
    assert request is not None and order_of(request, GUARD) == Order("acknowledge", "looked at it")


def test_what_is_not_whole_is_waited_for() -> None:
    whole = b"POST /stop HTTP/1.1\r\nContent-Length: 6\r\n\r\nsecret"
    assert [read_request(whole[:n]) for n in range(len(whole))] == [None] * len(whole)
    assert read_request(whole) is not None


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("POST /stop HTTP/1.1\n\n", 401),
        ("POST /stop HTTP/1.1\nAuthorization: Bearer secre\n\n", 401),
        ("POST /stop HTTP/1.1\nAuthorization: Bearer sécret\n\n", 400),
        ("GET /stop HTTP/1.1\nAuthorization: Bearer secret\n\n", 405),
        ("POST /run HTTP/1.1\nAuthorization: Bearer secret\n\n", 404),
        ("POST /stop HTTP/1.1\nAuthorization: Bearer secret\nOrigin: http://elsewhere\n\n", 403),
        ("nonsense\n\n", 400),
        ("POST /stop HTTP/1.1\nContent-Length: 9999999\n\n", 400),
        ("POST /stop HTTP/1.1\nContent-Length: -1\n\n", 400),
        ("x" * (MAX_REQUEST_BYTES + 1), 413),
    ],
)
def test_refusals(text: str, status: int) -> None:
    with pytest.raises(RefusedError) as caught:
        ask(text)
    assert caught.value.status == status


def test_a_browser_may_ask_before_it_asks() -> None:
    assert ask("OPTIONS /stop HTTP/1.1\nOrigin: http://127.0.0.1:8000\n\n") is None


def test_a_reason_is_one_short_line() -> None:
    body = "secret\n" + "a\tb " * 100
    request = read_request(f"POST /stop HTTP/1.1\r\nContent-Length: {len(body)}\r\n\r\n{body}".encode())
    assert request is not None
    order = order_of(request, GUARD)
    assert order is not None and len(order.reason) <= 200 and "\t" not in order.reason
