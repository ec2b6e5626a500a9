from bench_service.errors import BadRequestError, BenchBusyError, ConflictError, NotFoundError


def test_a_bad_request_says_what_where_value_limit_and_remedy():
    error = BadRequestError(
        "current above the limit",
        ("current_A", 17),
        value=5.5,
        unit="A",
        limit=(-3.0, 3.0),
        remedy="lower the current or choose another bench",
    )
    assert str(error) == (
        "current above the limit at current_A.17: 5.5 A, limit -3 to 3 A; lower the current or choose another bench"
    )
    assert error.where == ("current_A", 17)
    assert error.code == "bad_request"


def test_only_what_is_given_is_said():
    assert BadRequestError("profile is empty").message == "profile is empty"


def test_unknown_things_are_named():
    error = NotFoundError.of("run", "abc")
    assert (error.message, error.where, error.code) == ("unknown run 'abc'", ("run",), "not_found")


def test_a_busy_bench_is_a_conflict():
    assert issubclass(BenchBusyError, ConflictError)
