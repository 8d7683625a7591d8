"""``softarm bench NAME``: one module of ``softarm.bench`` per benchmark, imported only when it is run."""

import importlib
import importlib.util

import click

BENCHES = {
    "verify": "Check the finite elements against published and analytic answers.",
    "sofa": "Compare with SOFA's equilibria and inverse trajectories.",
    "step": "Time a step of the estimator, part by part.",
    "rod": "Hold the calibrated rod against its finite-element model, and time both.",
    "latency": "Time estimates from the packet to a subscriber in another process.",
    "mesh": "Compare the shipped meshes with their refinements.",
    "drivers": "Time and load the device drivers against the fakes.",
    "faults": "Strike every kind of device with random faults, and hold each reading against the truth.",
    "diagnosis": "Prove the diagnosis on sealed trials and beside its alternatives.",
    "safety": "Strike every device with every fault in every mode; is the arm left safe?",
    "soak": "Run a service for long under faults and clients that come, go and stall.",
    "plant": "Time the fake arm against real time.",
    "real-data": "Calibrate on real recordings and predict what was held out.",
}


def module_name(name: str) -> str:
    """Name the module of a benchmark."""
    return f"softarm.bench.{name.replace('-', '_')}"


class LazyBenches(click.Group):
    """The benchmarks that are installed; the others are neither listed nor run."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Name the benchmarks whose module exists."""
        return [name for name in BENCHES if importlib.util.find_spec(module_name(name))]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        """Import one benchmark.

        Raises:
            click.UsageError: There is none of that name.
        """
        installed = self.list_commands(ctx)
        if cmd_name not in installed:
            raise click.UsageError(f"no benchmark is called {cmd_name}; take one of: {', '.join(installed)}")
        command = importlib.import_module(module_name(cmd_name)).command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the benchmarks without importing them."""
        if rows := [(name, BENCHES[name]) for name in self.list_commands(ctx)]:
            with formatter.section("Benchmarks"):
                formatter.write_dl(rows)


@click.group(cls=LazyBenches, no_args_is_help=True)
def command() -> None:
    """Run a benchmark and print its table.

    Example: softarm bench step --quick
    """
