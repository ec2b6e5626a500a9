"""Reading the file and the environment; what is wrong is named with its file, key and reason."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bench_service.config.service import ServiceConfig
from bench_service.errors import ServiceError

CONFIG_FILE = "bench.toml"
DATA_DIR_VARIABLE = "BENCH_DATA_DIR"
WORKER_NICE_VARIABLE = "BENCH_WORKER_NICE"


class ConfigError(ServiceError):
    """A configuration that the service refuses; the message names file, key and reason.

    Parameters
    ----------
    file : str
        File, or environment variable, in which the value stands.
    key : str
        Dotted name of the key, empty if the whole file is meant.
    reason : str
        What is wrong, and what would be right.
    """

    code = "config"

    def __init__(self, file: str, key: str, reason: str) -> None:
        super().__init__(f"{file}: {key}: {reason}" if key else f"{file}: {reason}", (file, key))
        self.file = file
        self.key = key
        self.reason = reason


def load_config(path: Path | None = None, environ: Mapping[str, str] | None = None) -> ServiceConfig:
    """Read the configuration.

    Parameters
    ----------
    path : Path or None
        The file; None means `bench.toml` of the working directory where there is one, else the defaults.
    environ : mapping or None
        The environment, of the process by default. ``BENCH_DATA_DIR`` wins over the file's ``data_dir``,
        ``BENCH_WORKER_NICE`` over its ``worker_nice``.

    Raises
    ------
    ConfigError
        File missing, not TOML, an unknown key, a value outside its range.
    """
    environ = os.environ if environ is None else environ
    if path is None:
        path = Path(CONFIG_FILE) if Path(CONFIG_FILE).exists() else None
    config = ServiceConfig() if path is None else parse_config(_read(path), str(path))
    if (data_dir := named_data_dir(environ)) is not None:
        config = config.model_copy(update={"data_dir": data_dir})
    if WORKER_NICE_VARIABLE in environ:
        text = environ[WORKER_NICE_VARIABLE]
        if not text.isdecimal() or int(text) > 19:
            raise ConfigError("environment", WORKER_NICE_VARIABLE, f"is {text!r}; name a whole number from 0 to 19")
        config = config.model_copy(update={"worker_nice": int(text)})
    return config


def named_data_dir(environ: Mapping[str, str] | None = None) -> Path | None:
    """Return the data directory that the environment names, if it does; raises `ConfigError` where that is empty."""
    told = (os.environ if environ is None else environ).get(DATA_DIR_VARIABLE)
    if told is None:
        return None
    if not told.strip():
        raise ConfigError("environment", DATA_DIR_VARIABLE, "is empty; name a directory or unset it")
    return Path(told)


def parse_config(text: str, file: str = CONFIG_FILE) -> ServiceConfig:
    """Check the text of a configuration file; ``file`` is only its name in messages.

    Raises
    ------
    ConfigError
        Not TOML, an unknown key, a value outside its range; only the first fault is named.
    """
    try:
        document: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(file, "", f"not valid TOML: {error}") from error
    try:
        return ServiceConfig.model_validate(document, context={"folder": Path(file).parent})
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        reason = "unknown key" if first["type"] == "extra_forbidden" else first["msg"]
        raise ConfigError(file, key, reason.removeprefix("Value error, ")) from error


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ConfigError(str(path), "", "no such file; 'bench-service config init' writes a commented one") from error
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), "", f"cannot be read: {error}") from error
