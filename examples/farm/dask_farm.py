"""Runs a job on a cluster of Dask: python3 dask_farm.py [JOB.json [ADDRESS]]

Without the address of a scheduler it starts a cluster of this machine. `gelato` must be found by all workers, and the
folder must have the same name on all machines. `dask worker --nthreads 1` lets a worker have one task at a time.
"""

import sys

from dask.distributed import Client, LocalCluster, wait

import job


def main():
    if len(sys.argv) > 2:
        client = Client(sys.argv[2])
    else:
        client = Client(LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None))
    # The workers need not find the module.
    client.upload_file(job.__file__)
    done = {}
    for step in job.steps():
        before = [future for name in step.get("after", []) for future in done[name]]
        # A task whose process was killed is tried again, and a task of a lost worker runs on another one.
        done[step["name"]] = [
            client.submit(job.run, words, *before, retries=2, pure=False, key=f"{step['name']}-{number}")
            for number, words in enumerate(job.commands(step))
        ]
    futures = [future for step in done.values() for future in step]
    wait(futures)
    failed = [future for future in futures if future.status != "finished"]
    for future in failed:
        print(f"{future.key}: {future.status}: {future.exception()}", file=sys.stderr)
    print(f"{len(futures) - len(failed)} of {len(futures)} tasks are done")
    client.close()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
