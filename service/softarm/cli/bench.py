"""``softarm bench NAME``: one module per benchmark, imported only when it is run."""

import importlib
import importlib.util
import sys
from pathlib import Path

import click

CHECKOUT = Path(__file__).parents[3]
ACCEPTANCE = "acceptance"
"""Package below ``tests/`` of a checkout with the benchmarks that only developers run."""

LABORATORY_BENCHMARKS = {
    "step": "Time a step of the estimator, part by part and by each solver.",
    "latency": "Time estimates from the packet to a subscriber in another process.",
    "arms": "Run several fake arms on this machine, and measure what each costs.",
    "diagnosis": "Diagnose blind trials, and score them if answers are given.",
}
ACCEPTANCE_BENCHMARKS = {
    "verify": "Check the finite elements against published and analytic answers.",
    "sofa": "Compare with SOFA's equilibria and inverse trajectories.",
    "tracking": "Time the tracking path without each of its parts, and finite elements as the mesh grows.",
    "rod": "Compare the calibrated rod with its finite-element model, and time both.",
    "mesh": "Compare the shipped meshes with their refinements.",
    "drivers": "Time and load the device drivers against the fakes.",
    "faults": "Inject random faults into every kind of device, and compare each reading with the truth.",
    "safety": "Inject every fault into every device in every mode, and check that the arm is left safe.",
    "soak": "Run a service for a long time under faults, with clients that connect, disconnect and stall.",
    "plant": "Time the fake arm against real time.",
    "trial": "Record a blind trial of the fake arm.",
    "real-data": "Calibrate on real recordings and predict what was held out.",
    "proof": "Prove the diagnosis on the fake arm and against its alternatives.",
    "reference": "Write the reference pages of docs/ from the definitions they describe.",
    "measured": "Run benchmarks, keep their output, and write their figures into the documents.",
}


def benchmarks(checkout: Path = CHECKOUT) -> dict[str, tuple[str, str]]:
    """List the benchmarks that can be run: all in a checkout, those of a laboratory elsewhere.

    Args:
        checkout: Root of the checkout, if this is one.

    Returns:
        For each name, its module and one line of help.
    """
    packages = {"softarm.bench": LABORATORY_BENCHMARKS}
    tests = checkout / "tests"
    if (tests / ACCEPTANCE / "__init__.py").exists():
        packages[ACCEPTANCE] = ACCEPTANCE_BENCHMARKS
        if str(tests) not in sys.path:
            sys.path.append(str(tests))
    named = {
        name: (f"{package}.{name.replace('-', '_')}", line)
        for package, lines in packages.items()
        for name, line in lines.items()
    }
    return {name: entry for name, entry in named.items() if importlib.util.find_spec(entry[0])}


class LazyBenchmarks(click.Group):
    """The benchmarks that are at hand; the others are neither listed nor run."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Name the benchmarks whose module exists."""
        return list(benchmarks())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:  # noqa: ARG002
        """Import one benchmark.

        Raises:
            click.UsageError: There is none of that name.
        """
        known = benchmarks()
        if cmd_name not in known:
            where = "; this one runs in a checkout" if cmd_name in ACCEPTANCE_BENCHMARKS else ""
            raise click.UsageError(
                f"no benchmark is called {cmd_name}{where}; choose one of: {', '.join(known)}"
            )
        command = importlib.import_module(known[cmd_name][0]).command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the benchmarks without importing them."""
        with formatter.section("Benchmarks"):
            formatter.write_dl([(name, line) for name, (_, line) in benchmarks().items()])


@click.group(cls=LazyBenchmarks, no_args_is_help=True)
def command() -> None:
    """Run a benchmark and print its table.

    Example: softarm bench step --quick
    """
