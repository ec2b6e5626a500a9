"""The client's calls about protocols: stored ones, standard tests, and what their runs have moved."""

from __future__ import annotations

from bench_service.client.connection import API, Connection, Record, part


class ProtocolCalls:
    """Calls about protocols; `BenchClient` hands them on."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def upload_protocol(self, document: Record, bench: str | None = None) -> Record:
        """Store a protocol, of our own schema or aurora-unicycler's; give its record.

        A design block in it is made for `bench`.
        """
        return self._connection.post(f"{API}/protocols", {"document": document, "bench": bench})

    def add_standard_test(self, name: str, bench: str, **parameters: object) -> Record:
        """Store a standard test, made for a bench; `parameters` are what differs from its defaults."""
        body = {"standard_test": name, "bench": bench, "parameters": parameters}
        return self._connection.post(f"{API}/protocols", body)

    def standard_tests(self) -> list[Record]:
        """The library: what each test is for, and its parameters."""
        return self._connection.get(f"{API}/standard-tests")["standard_tests"]

    def preview_protocol(self, bench: str, **what: object) -> Record:
        """What a protocol would do on a bench; `what` is document, standard_test or protocol_id, and initial_soc."""
        return self._connection.post(f"{API}/protocols/preview", {"bench": bench, **what})

    def protocols(self) -> list[Record]:
        """All protocols."""
        return self._connection.get(f"{API}/protocols")["protocols"]

    def protocol(self, protocol_id: str) -> Record:
        """One protocol, with its document."""
        return self._connection.get(f"{API}/protocols/{part(protocol_id)}")

    def run_steps(self, run_id: str) -> list[Record]:
        """What each step of a run has moved."""
        return self._connection.get(f"{API}/runs/{part(run_id)}/steps")["steps"]

    def run_cycles(self, run_id: str) -> list[Record]:
        """What each cycle of a run has moved: capacity, energy, mean voltages, efficiencies."""
        return self._connection.get(f"{API}/runs/{part(run_id)}/cycles")["cycles"]
