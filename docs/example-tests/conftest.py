"""Makes the fixtures of the emulated bench known to these tests."""

pytest_plugins = ["bench_service.pytest_plugin"]
