"""The command line: one file per command in `bench_service.cli.commands`."""
