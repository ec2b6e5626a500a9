"""`bench-service completion SHELL`: what a shell reads so that the tabulator key completes commands and options."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from bench_service.cli.command import Command
from bench_service.cli.output import Output

_WHERE = {
    "bash": 'eval "$(bench-service completion bash)"    # in ~/.bashrc',
    "zsh": 'eval "$(bench-service completion zsh)"    # in ~/.zshrc, after compinit',
    "fish": "bench-service completion fish | source    # in ~/.config/fish/config.fish",
}


def _arguments(parser: ArgumentParser) -> None:
    parser.add_argument("shell", choices=list(_WHERE), help="; ".join(_WHERE.values()))


def _run(options: Namespace, output: Output) -> int:
    # Lazy: 20 ms that no other command needs.
    from argcomplete.shell_integration import shellcode

    script = shellcode(["bench-service"], shell=options.shell)
    output.result({"shell": options.shell, "script": script}, lambda _: print(script))
    return 0


COMMAND = Command("completion", "print what completes commands and options in a shell", _arguments, _run)
