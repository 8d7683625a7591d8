"""What commands load before they begin."""

import subprocess
import sys

CODE = """
import sys
import softarm.analysis.diagnosis.run, softarm.analysis.offline.track, softarm.daemon.app
import softarm.cli.fakes, softarm.fakes.plant.from_specimen, softarm.experiments.session
print([name for name in ("matplotlib", "polars", "scipy.signal", "scipy.stats") if name in sys.modules])
"""


def test_commands_start_without_slow_libraries_that_few_of_them_use() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
