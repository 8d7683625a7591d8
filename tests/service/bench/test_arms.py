"""What several arms on one machine cost."""

import os
import subprocess
import sys

from softarm.bench.arms import family, processor_time

NESTED = "import subprocess, sys; subprocess.run([sys.executable, '-c', {inner!r}], check=True)"
BUSY = "import time\nwhile time.process_time() < 0.5: pass\nprint('done', flush=True); input()"


def test_the_processor_time_of_descendants_counts() -> None:
    command = [sys.executable, "-c", NESTED.format(inner=BUSY)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "done\n"
        assert len(list(family(process.pid))) == 2
        assert 0.45 < processor_time(process.pid) < 5.0
        process.communicate("\n")


def test_a_process_alone_is_its_own_family() -> None:
    assert next(family(os.getpid())) == os.getpid()
