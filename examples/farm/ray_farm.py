"""Runs a job on a cluster of Ray: python3 ray_farm.py [JOB.json [ADDRESS]]

Without an address it starts Ray on this machine. `gelato` must be found on all nodes, and the folder must have the same
name on all machines.
"""

import os
import sys

import ray

import job


@ray.remote(num_cpus=1, max_retries=2, retry_exceptions=[RuntimeError])
def task(folder, words, *before):
    """Runs a task when those before it are done. A task of a lost node, and one that was killed, is tried again."""
    os.chdir(folder)
    return job.run(words, *before)


def main():
    here = os.getcwd()
    ray.init(address=sys.argv[2] if len(sys.argv) > 2 else None, runtime_env={"py_modules": [job.__file__]},
             include_dashboard=False, log_to_driver=False)
    done = {}
    for step in job.steps():
        before = [one for name in step.get("after", []) for one in done[name]]
        done[step["name"]] = [task.remote(here, words, *before) for words in job.commands(step)]
    failed = 0
    for name, tasks in done.items():
        for number, one in enumerate(tasks):
            try:
                ray.get(one)
            except ray.exceptions.RayError as error:
                failed += 1
                print(f"{name}-{number}: {error}", file=sys.stderr)
    total = sum(map(len, done.values()))
    print(f"{total - failed} of {total} tasks are done")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
