"""Brings a database file to the schema of this version, at every opening, in one transaction."""

from pathlib import Path
from typing import Literal

from sqlalchemy import Connection, Engine, MetaData, inspect, text

from bench_service.errors import StoreError
from bench_service.store import schema

Database = Literal["meta", "samples"]

# Newest revision of each database. Known here so that opening an up-to-date file does not load Alembic (0.2 s);
# a test compares it with the revision files.
HEAD: dict[Database, str] = {"meta": "meta_0008", "samples": "samples_0001"}
_SCRIPTS = Path(__file__).parent / "migrations"
_METADATA: dict[Database, MetaData] = {"meta": schema.META, "samples": schema.SAMPLES}


def upgrade(engine: Engine, database: Database) -> None:
    """Apply the revisions that the file has not seen yet.

    Raises
    ------
    StoreError
        The file was written by a newer version of this service.
    """
    with engine.begin() as connection:
        present = _revision(connection)
        if present != HEAD[database]:
            _apply(connection, database, present)


def check_revision(engine: Engine, database: Database) -> None:
    """Raise `StoreError` where a file that is only read is not of this version."""
    with engine.begin() as connection:
        present = _revision(connection)
    if present != HEAD[database]:
        raise StoreError(
            f"the {database} database is at revision {present!r}, this version reads {HEAD[database]!r}; "
            "start the service of this version once, which brings it up to date"
        )


def directory(database: Database) -> Path:
    """Return the directory with the revision files of a database."""
    return _SCRIPTS / database


def _revision(connection: Connection) -> str | None:
    if not inspect(connection).has_table("alembic_version"):
        return None
    return connection.execute(text("SELECT version_num FROM alembic_version")).scalar()


def _apply(connection: Connection, database: Database, present: str | None) -> None:
    # Lazy: alembic takes 120 ms.
    from alembic import command
    from alembic.config import Config
    from alembic.util import CommandError

    config = Config()
    config.set_main_option("script_location", _option(_SCRIPTS))
    config.set_main_option("path_separator", "newline")
    config.set_main_option("version_locations", _option(directory(database)))
    config.attributes["connection"] = connection
    config.attributes["metadata"] = _METADATA[database]
    try:
        command.upgrade(config, "head")
    except CommandError as error:
        raise StoreError(
            f"the {database} database is at revision {present!r}, which this version does not know; "
            "it was written by a newer version: install that version, or choose another data directory"
        ) from error


def _option(path: Path) -> str:
    return str(path).replace("%", "%%")  # the configuration interpolates
