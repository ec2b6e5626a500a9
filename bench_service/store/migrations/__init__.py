"""Alembic revisions of the two databases; applied by `bench_service.store.migrate`."""
