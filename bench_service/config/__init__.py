"""The only reader of `bench.toml` and of the environment.

Without a file the service knows one bench, `sim`, whose simulator it starts itself.
"""

from bench_service.config.bench import BenchConfig, LimitsConfig
from bench_service.config.cell_type import CellTypeConfig
from bench_service.config.chamber import ChamberConfig, SimulatedChamberConfig
from bench_service.config.example import example_config
from bench_service.config.reading import ConfigError, load_config, named_data_dir, parse_config
from bench_service.config.service import ServiceConfig
from bench_service.config.simulate import SimulateConfig
from bench_service.config.webhook import WebhookConfig

__all__ = [
    "BenchConfig",
    "CellTypeConfig",
    "ChamberConfig",
    "ConfigError",
    "LimitsConfig",
    "ServiceConfig",
    "SimulateConfig",
    "SimulatedChamberConfig",
    "WebhookConfig",
    "example_config",
    "load_config",
    "named_data_dir",
    "parse_config",
]
