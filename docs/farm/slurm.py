"""Let SLURM's nodes compensate a show: workers come and go, the command waits for them.

Needs ``pip install dask-jobqueue`` beside domesim, on a node whose files all others see:

    python slurm.py masters/show.####.exr --scene dome_imax --out projected
"""

import subprocess
import sys

from dask_jobqueue import SLURMCluster

NODES = 32
A_NODE = 8  # workers: a node of 16 cores and 64 GB does eight frames of 4096² at once

with SLURMCluster(
    queue="render",
    cores=A_NODE,  # one frame to a worker: `processes` is the same
    processes=A_NODE,
    memory="64GB",
    walltime="12:00:00",
    job_cpu=16,
    job_script_prologue=["export OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=1"],
    # A GPU: worker_extra_args=["--resources", "GPU=1"], and --device cuda below
) as cluster:
    cluster.scale(jobs=NODES)
    address = cluster.scheduler_address
    command = ["domesim", "compensate", *sys.argv[1:], "--scheduler", address]
    sys.exit(subprocess.run(command, check=False).returncode)
