"""The pytest plugin, used the way its users do: in tests of their own, in another process' collection."""

import shutil
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

EXAMPLES = Path(__file__).parents[3] / "docs" / "example-tests"


@pytest.fixture
def project(pytester: pytest.Pytester) -> pytest.Pytester:
    shutil.copy(EXAMPLES / "conftest.py", pytester.path)
    return pytester


def test_the_example_project_passes(project: pytest.Pytester) -> None:
    shutil.copy(EXAMPLES / "test_charger.py", project.path)
    project.runpytest_subprocess("-q", "-p", "no:cacheprovider").assert_outcomes(passed=9)


def test_equal_runs_asynchronous_tests_and_mistakes(project: pytest.Pytester) -> None:
    project.makepyfile(
        """
        import hashlib
        import pytest

        SEEN = set()

        @pytest.mark.parametrize("again", range(2))
        @pytest.mark.emulated(effects={"hysteresis": 0.02}, seed=3, capacity_Ah=3.0)
        def test_equal(bench, again):
            assert bench.capacity_Ah == 3.0
            run = bench.play([0.0, 5.0, 10.0], [2.0, -2.0, 0.0], dt_s=0.1)
            arrays = (run.time_s, run.current_A, run.voltage_V, run.temperature_degC, run.sequence, run.flags)
            SEEN.add(hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest())
            assert len(SEEN) == 1

        async def test_in_an_asynchronous_test_too(bench):
            assert bench.play([0.0, 1.0], [1.0, 0.0], dt_s=0.1).state == "completed"

        @pytest.mark.emulated(protocol="smoke")
        def test_protocol(emulated_cycler):
            pass

        @pytest.mark.emulated(faults="earthquake@t:1")
        def test_fault(emulated_cycler):
            pass

        @pytest.mark.emulated(cell="lead")
        def test_cell(emulated_cycler):
            pass
        """
    )
    result = project.runpytest_subprocess("-q", "-p", "no:cacheprovider", "-o", "asyncio_mode=auto")
    result.assert_outcomes(passed=3, errors=3)
    result.stdout.fnmatch_lines(["*'smoke'; choose one of modbus-tcp*"])
    result.stdout.fnmatch_lines(["*unknown kind 'earthquake'*"])
    result.stdout.fnmatch_lines(["*unknown cell 'lead'*"])
