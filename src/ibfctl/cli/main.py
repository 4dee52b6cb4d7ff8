"""The command `ibfctl`: verbs on files, nouns for what lives in a service.

Importing this loads nothing numerical, so that it starts at once.
"""

from __future__ import annotations

import importlib
import os
import sys

import click

from ibfctl import __version__
from ibfctl.errors import IbfctlError

_VERBS = ("plan", "schedule", "compare", "tools", "tolerance", "tif", "simulate", "replan", "export", "demo")
_NOUNS = ("maps", "influences", "machines", "plans", "runs", "machine", "events")
_SERVICE = ("serve", "keys", "abort")
_ALL = (*_VERBS, *_NOUNS, *_SERVICE)
_EXIT_USAGE = 2
_EXIT_INTERRUPTED = 130


class _Verbs(click.Group):
    """A group whose verbs are imported when they are asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_ALL)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _ALL:
            return None
        command: click.Command = importlib.import_module(f"ibfctl.cli.{cmd_name}").command
        return command


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="ibfctl")
def cli() -> None:
    """Plan, schedule, run and prove deterministic finishing on Galil motion controllers."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every error ends in one line on standard error and the exit code of its kind."""
    sys.exit(run(arguments))


def run(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    try:
        cli.main(args=arguments, prog_name="ibfctl", standalone_mode=False)
    except IbfctlError as error:
        return _refuse(str(error), error.exit_code)
    except click.exceptions.Exit as leave:
        return leave.exit_code
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "ibfctl"
        return _refuse(f"{error.format_message()} See {command} --help", _EXIT_USAGE)
    except (KeyboardInterrupt, click.Abort):
        return _refuse("interrupted", _EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of the pipe has gone; keep the interpreter from complaining when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _refuse(f"{error.filename or 'system'}: {error.strerror or error}", 1)
    return 0


def _refuse(message: str, code: int) -> int:
    click.echo("error: " + " ".join(message.split()), err=True)
    return code
