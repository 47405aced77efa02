import os
import subprocess
import sys
import time

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
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # Where nobody waits for it, what has ended keeps its number.
    with open(f"/proc/{process}/stat") as file:
        return file.read().rsplit(")", 1)[1].split()[0] != "Z"
