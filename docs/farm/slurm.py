"""Let SLURM's nodes compensate a show: workers come and go, the command waits for them.

Needs ``pip install dask-jobqueue`` beside domesim, on a node whose files all others see:

    python slurm.py masters/show.####.exr --scene dome_imax --out projected
"""

import subprocess
import sys

from dask_jobqueue import SLURMCluster

NODES = 32
A_NODE = 6  # workers: a node of 64 GB has room for six frames of 4096², at 8 GB each

with SLURMCluster(
    queue="render",
    cores=A_NODE,  # one frame to a worker: `processes` is the same
    processes=A_NODE,
    memory="64GB",
    walltime="12:00:00",
    job_cpu=16,
    worker_extra_args=["--memory-limit", "0"],  # a frame needs more than an equal share at times
    job_script_prologue=["export OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=1"],
    # A GPU: "--resources", "GPU=1" there, and --device cuda below
) as cluster:
    cluster.adapt(minimum_jobs=1, maximum_jobs=NODES)  # jobs that run out of time are replaced
    address = cluster.scheduler_address
    command = ["domesim", "compensate", *sys.argv[1:], "--scheduler", address]
    sys.exit(subprocess.run(command, check=False).returncode)
