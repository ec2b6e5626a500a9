"""A profile that comes as the bytes of a CSV file."""

import gzip

import pytest

from bench_service.api.csv_body import read_csv_profile
from bench_service.errors import BadRequestError

GOOD = b"time_s,current_A\n0,1.5\n10,-2\n20,0\n"


def test_rows_are_read_in_their_order() -> None:
    profile = read_csv_profile(GOOD)
    assert profile.time_s.tolist() == [0.0, 10.0, 20.0]
    assert profile.current_A.tolist() == [1.5, -2.0, 0.0]


def test_a_compressed_body_is_refused_before_it_is_opened() -> None:
    with pytest.raises(BadRequestError, match="compressed; send it plain"):
        read_csv_profile(gzip.compress(GOOD))


@pytest.mark.parametrize(
    "body", [b"", b"time_s\n0\n", b"time_s,current_A\n", b"time_s,current_A\n0,x\n", b"\x00\xff\xfe"]
)
def test_what_is_no_profile_is_a_bad_request(body: bytes) -> None:
    with pytest.raises(BadRequestError):
        read_csv_profile(body)


def test_the_message_names_the_row_and_no_place_on_this_machine() -> None:
    with pytest.raises(BadRequestError) as refused:
        read_csv_profile(b"time_s,current_A\n0,1\n10,one\n20,0\n")
    message = str(refused.value)
    assert "profile.csv" in message and "bench-profile-" not in message
    # Counted as a person counts the lines of the file, header and all.
    assert "row 3" in message and "'one'" in message
