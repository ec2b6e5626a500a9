"""Python client of the REST API, for campaigns and for the command line; knows nothing else of the service."""

from bench_service.client.async_client import AsyncBenchClient
from bench_service.client.bench_client import BenchClient
from bench_service.client.connection import ClientError
from bench_service.client.waiting import ENDED_CAMPAIGN_STATES, ENDED_RUN_STATES

__all__ = ["ENDED_CAMPAIGN_STATES", "ENDED_RUN_STATES", "AsyncBenchClient", "BenchClient", "ClientError"]
