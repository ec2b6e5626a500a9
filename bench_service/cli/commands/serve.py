"""`bench-service serve`: the service itself, with its page and its REST API."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from urllib.parse import quote

from bench_service.cli.arguments import port
from bench_service.cli.command import Command
from bench_service.cli.output import Output


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, metavar="bench.toml", help="default: bench.toml where there is one")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: this machine only)")
    parser.add_argument("--port", type=port, default=8000, metavar="N", help="0 takes a free one")


def _run(options: Namespace, output: Output) -> int:
    # Lazy: fastapi, uvicorn and sqlalchemy take 940 ms.
    from bench_service.app import serve
    from bench_service.cli.service import check_data_dir
    from bench_service.config import load_config
    from bench_service.config.token import TOKEN_FILE, service_token

    config = load_config(options.config)
    check_data_dir(config.data_dir)

    def ready(address: str) -> None:
        token = service_token(config.data_dir, options.host)
        answer = {"address": address, "data_dir": str(config.data_dir)}
        lines = [f"serving {address}, data in {config.data_dir}; Ctrl-C ends it safely"]
        if token is not None:
            answer["login"] = f"{address}/login?token={quote(token)}"
            lines += [
                f"open the page with {answer['login']}",
                f"programs send 'Authorization: Bearer TOKEN'; the token is in {config.data_dir / TOKEN_FILE}",
                "anybody who has the link may start, stop and acknowledge; it travels unencrypted",
            ]
        output.result(answer, lambda console: console.print("\n".join(lines), soft_wrap=True, markup=False))

    serve(config, options.host, options.port, ready)
    return 0


COMMAND = Command("serve", "serve benches, page and REST API", _arguments, _run)
