"""Files in and out of the service: measured runs, profiles, results.

Each format is one module with a constant ``FORMAT``; it is found by itself (`bench_service.exchange.registry`).
"""

from bench_service.exchange.errors import ProfileFileError, RunFileError
from bench_service.exchange.profile import ProfileFile, read_profile
from bench_service.exchange.read import RunFile, read_run, read_run_file
from bench_service.exchange.write import encode_run, export_formats, write_run

__all__ = [
    "ProfileFile",
    "ProfileFileError",
    "RunFile",
    "RunFileError",
    "encode_run",
    "export_formats",
    "read_profile",
    "read_run",
    "read_run_file",
    "write_run",
]
