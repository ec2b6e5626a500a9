"""Composition root: builds the application and serves it."""

from bench_service.app.application import create_app
from bench_service.app.server import serve

__all__ = ["create_app", "serve"]
