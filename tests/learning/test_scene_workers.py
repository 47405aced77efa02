import subprocess
import sys
import time
from pathlib import Path

import pytest

from gmmjax.learning.scene_workers import over_workers

SCRIPT = """
import os, time
from gmmjax.learning.scene_workers import over_workers

def own_process(task):
    print(os.getpid(), flush=True)
    time.sleep(600)

if __name__ == "__main__":
    list(over_workers(own_process, range(2), 2))
"""


def test_results_come_in_the_order_of_the_tasks():
    assert [list(over_workers(abs, [-3, 1, -2], workers)) for workers in (1, 2)] == [[3, 1, 2]] * 2


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="processes are looked up in /proc")
def test_workers_end_with_the_process_that_started_them(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        workers = [int(process.stdout.readline()) for _ in range(2)]
        process.kill()
    deadline = time.monotonic() + 60
    while any(_runs(worker) for worker in workers) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not [worker for worker in workers if _runs(worker)]


def _runs(process):
    """Whether it has not ended; one that nobody waits for stays as a zombie."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"
