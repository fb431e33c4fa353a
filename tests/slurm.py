# SPDX-License-Identifier: Apache-2.0
"""A Slurm of one node on loopback, from the system's packages, for the tests."""

import contextlib
import os
import secrets
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue")
SECONDS_TO_START = 15.0
CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0,sched_interval=1
SlurmdParameters=config_overrides
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
KillWait=5
NodeName={host} NodeAddr=127.0.0.1 CPUs=8
PartitionName=requeue Nodes=ALL Default=YES PriorityTier=1 PreemptMode=REQUEUE
PartitionName=cancel Nodes=ALL PriorityTier=1 PreemptMode=CANCEL
PartitionName=dear Nodes=ALL PriorityTier=9 PreemptMode=OFF
"""


@contextlib.contextmanager
def running(folder: Path) -> Iterator[dict[str, str]]:
    """Yields the environment that the clients of this Slurm need.

    Skips the test where Slurm is not installed or does not start.
    """
    path = os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"])
    found = {name: shutil.which(name, path=path) for name in PROGRAMS}
    missing = [name for name, program in found.items() if not program]
    if missing:
        pytest.skip(f"no {missing[0]} (Debian: slurmctld slurmd slurm-client munge)")
    for name in ("state", "spool"):
        (folder / name).mkdir()
    key = folder / "munge.key"
    key.write_bytes(secrets.token_bytes(1024))
    key.chmod(0o400)
    configuration = folder / "slurm.conf"
    user = subprocess.check_output(["id", "-un"], text=True).strip()
    host = socket.gethostname().split(".")[0]
    values = {"folder": folder, "host": host, "user": user, "ports": free_ports(2)}
    configuration.write_text(CONFIGURATION.format(**values))
    own = {f"--{name}-file={folder}/munge.{name}" for name in ("key", "pid", "log")}
    commands = (
        [found["munged"], "-F", "--force", f"--socket={folder}/munge.socket",
         f"--seed-file={folder}/munge.seed", *own],
        [found["slurmctld"], "-D", "-f", configuration],
        [found["slurmd"], "-D", "-f", configuration],
    )  # fmt: skip
    environment = {"SLURM_CONF": str(configuration)}
    with contextlib.ExitStack() as stack, (folder / "daemons.log").open("w") as log:
        for command in commands:
            stack.enter_context(daemon(command, log))
            time.sleep(0.2)
        if not wait_until_idle(environment):
            last = (folder / "daemons.log").read_text()[-300:]
            pytest.skip(f"Slurm did not start here: {last}")
        yield environment
        subprocess.run(["scancel", f"--user={user}"], env=os.environ | environment)


@contextlib.contextmanager
def daemon(command, log) -> Iterator[None]:
    """A process that is ended with the block."""
    process = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def wait_until_idle(environment: dict[str, str]) -> bool:
    """Whether the node takes jobs, before the patience is over."""
    end = time.monotonic() + SECONDS_TO_START
    while time.monotonic() < end:
        asked = subprocess.run(
            ["timeout", "3", "sinfo", "--noheader", "--format=%T"],
            env=os.environ | environment, capture_output=True, text=True,
        )  # fmt: skip
        if asked.stdout.startswith("idle"):
            return True
        time.sleep(0.2)
    return False


def hurry() -> None:
    """Starts jobs that were queued again at once; Slurm has them wait a while."""
    waiting = ["squeue", "--me", "--noheader", "--states=PENDING", "--format=%A %r"]
    for line in subprocess.check_output(waiting, text=True).splitlines():
        job, reason = line.split(maxsplit=1)
        if reason == "BeginTime":
            update = ["scontrol", "update", f"JobId={job}", "StartTime=now"]
            subprocess.run(update, stderr=subprocess.DEVNULL)


def free_ports(count: int) -> list[int]:
    """Ports of this machine that nobody listens on."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for bound in sockets:
            bound.bind(("127.0.0.1", 0))
        return [bound.getsockname()[1] for bound in sockets]
