"""Reads a job file, for engines that are programmed in Python."""

import json
import subprocess
import sys

TRY_AGAIN = 75
"""The status of a task that was ended from outside, so that trying again may help."""


def commands(step):
    """Returns the commands of the tasks of a step, each a list of words."""
    if "commands" in step:
        return step["commands"]
    chunk = str(step.get("chunk", 1))
    words = ["gelato", "-frames", step["frames"], "-chunk", chunk, "-task"]
    rest = step.get("options", []) + step["scene"]
    return [words + [str(task)] + rest for task in range(tasks(step["frames"], int(chunk)))]


def tasks(frames, chunk):
    """Returns the number of tasks of a range such as "1-24" or "1-24x2,30"."""
    numbers = set()
    for part in frames.split(","):
        part, _, step = part.strip().partition("x")
        first, _, last = part.partition("-")
        first, last = int(first), int(last or first)
        numbers.update(range(min(first, last), max(first, last) + 1, int(step or 1)))
    return -(-len(numbers) // chunk)


def run(words, *_before):
    """Runs the command of a task on this machine, after the tasks `before`. A task that fails ends the job."""
    status = subprocess.run(words, check=False).returncode
    if status == TRY_AGAIN or status < 0:
        raise RuntimeError(f"{' '.join(words)}: status {status}")
    if status != 0:
        raise SystemError(f"{' '.join(words)}: errors, status {status}")
    return words


def steps():
    """Returns the steps of the job file that the command line names."""
    with open(sys.argv[1] if len(sys.argv) > 1 else "job.json", encoding="utf-8") as file:
        return json.load(file)["steps"]
