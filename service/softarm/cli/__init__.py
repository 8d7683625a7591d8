"""The ``softarm`` command: one module per sub-command, imported only when it is called."""

import errno
import importlib
import os
import sys
from collections.abc import Sequence

import click

from softarm.common.errors import WorkFailedError
from softarm.estimator.errors import InputError, suggest
from softarm_client.errors import ClientError, SetupError

TRACEBACK = "SOFTARM_TRACEBACK"
"""Environment variable that shows the traceback of an internal error."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells expect it."""
THREADS = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"
"""Environment variables for how many threads linear algebra may use; libraries read them as they load."""

UNUSABLE = (
    errno.EACCES, errno.EEXIST, errno.EISDIR, errno.ENAMETOOLONG, errno.ENOTDIR, errno.EPERM, errno.EROFS,
)  # fmt: skip
"""Errors of the system for which a path of the user is the cause."""
FULL = errno.ENOSPC, errno.EDQUOT

COMMANDS = {
    "demo": "Start simulated instruments, service and page, and run the force experiment.",
    "serve": "Run the service for one arm: the daemon that systemd starts.",
    "status": "Show what a running arm is doing.",
    "arm": "Arm a running arm and hold pressures until Ctrl-C.",
    "stop": "Vent a running arm at once and latch a fault.",
    "clear": "Leave FAULTED once the cause is gone.",
    "tare": "Take the present external force as zero.",
    "teach": "Teach poses by hand, list them, and go to them.",
    "record": "Record a running arm.",
    "specimen": "Describe an arm: write its specimen from measures.",
    "check": "Check a specimen or a configuration, and draw what it describes.",
    "convert": "Convert a recording between MCAP, tables and Qualisys exports.",
    "estimate": "Estimate pose and external force over a recording.",
    "diagnose": "Find the physics that a model leaves out.",
    "calibrate": "Fit moduli, chamber gains and frame alignment to recordings.",
    "excite": "Run and record the manoeuvres that distinguish physical effects.",
    "experiment": "Run the paper's experiments and print their tables.",
    "plot": "Plot a recording.",
    "bench": "Run a benchmark and print its table.",
    "fakes": "Start simulated instruments on real ports.",
    "page": "Serve the operator page, or the page of a recording, in the browser.",
    "ros": "Offer a running arm as a ROS 2 node.",
    "vent": "Vent every chamber, whether or not the service runs.",
    "doctor": "Check every configured device: does it answer, how fast, and with which fault.",
}


OPERATE = "arm", "stop", "clear", "tare"
"""Commands that share the module ``operate``; any other has the module of its name."""


class LazyGroup(click.Group):
    """A group whose commands live in ``softarm.cli.<name>`` and load on use."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Name the commands in the order in which a user meets them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import the module of one command."""
        if cmd_name not in COMMANDS:
            return None
        shared = cmd_name in OPERATE
        module = importlib.import_module(f"softarm.cli.{'operate' if shared else cmd_name}")
        command = getattr(module, cmd_name if shared else "command")
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command of a name, and suggest the nearest one where there is none."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            advice = suggest(args[0], COMMANDS, "", cutoff=0.6)
            ctx.fail(f"No such command '{args[0]}'{advice and f', {advice}'}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(package_name="softarm")
def softarm() -> None:
    """Estimate the shape of a pneumatic soft arm and the forces on it, from a few sensors and a model.

    Exit status: 0 done, 1 the work failed, 2 wrong use, 130 interrupted by Ctrl-C. Results go to stdout,
    progress and messages to stderr; with --json a command prints one JSON document.

    Example: softarm estimate RECORDING --specimen sopra
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; every error becomes one line and an exit status, internal errors too.

    Args:
        arguments: The words after ``softarm``; those of the process when left out.
    """
    for name in THREADS:  # more than one wait for each other, ruinously so where cores are shared
        os.environ.setdefault(name, "1")
    try:
        status = run(arguments)
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        what = " ".join(f"{type(error).__name__}: {error}".split())
        click.echo(f"softarm: internal error: {what}; set {TRACEBACK}=1 to see the traceback", err=True)
        status = 1
    sys.exit(status)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status: 0 done, 1 the work failed, 2 wrong use, 130 interrupted."""
    try:
        result = softarm.main(args=arguments, prog_name="softarm", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return 0
    except click.ClickException as error:
        what = error.format_message()
        if isinstance(error, click.UsageError) and error.ctx:
            stop = "" if what.endswith((".", "?")) else "."
            what = f"{what}{stop} See {error.ctx.command_path} --help."
        click.echo(f"softarm: {what}", err=True)
        return error.exit_code
    except (InputError, SetupError) as error:
        click.echo(f"softarm: {error}", err=True)
        return 2
    except (ClientError, WorkFailedError) as error:
        click.echo(f"softarm: {error}", err=True)
        return 1
    except OSError as error:
        full = error.errno in FULL
        if os.environ.get(TRACEBACK) or not (full or (error.errno in UNUSABLE and error.filename)):
            raise
        cure = "make room on the disk" if full else "give a path that can be used"
        click.echo(f"softarm: {error.filename or 'an output'}: {error.strerror}; {cure}", err=True)
        return 1 if full else 2
    except (click.Abort, KeyboardInterrupt) as error:
        if isinstance(error.__context__, EOFError):  # Click raises the same error for Ctrl-C
            click.echo(
                "softarm: standard input ended before every question was answered; run the command in a "
                "terminal, or pipe in one line per question",
                err=True,
            )
            return 2
        click.echo("softarm: interrupted", err=True)
        return INTERRUPTED
    return result if isinstance(result, int) else 0
