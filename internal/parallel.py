# SPDX-License-Identifier: Apache-2.0
"""Devices and processes: one mesh axis, data parallel.

Arrays are either whole on every device (``replicate``) or split over the mesh on
their first axis (``shard_batch``); the compiler inserts the sums over devices.
"""

import glob
import os
import shutil
from collections.abc import Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import AbstractMesh, AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import ArrayLike

from internal.errors import UserError, one_line

T = TypeVar("T")


def initialize(coordinator: str, num_processes: int, process_id: int) -> None:
    """Joins this process to a multi-process run; one process needs none of it.

    Raises:
        UserError: the numbers do not fit each other, or nobody is there to join.
    """
    if not 0 <= process_id < num_processes:
        raise UserError(
            f"--process_id {process_id} of --num_processes {num_processes}: expected "
            "0 to one less than the number of processes"
        )
    if num_processes == 1:
        return
    if not coordinator:
        raise UserError("several processes need --coordinator=HOST:PORT of process 0")
    try:
        jax.distributed.initialize(coordinator, num_processes, process_id)
    except (RuntimeError, ValueError) as error:
        raise UserError(
            f"--coordinator={coordinator}: cannot join ({one_line(error)}); start "
            "the same command on each, with process 0 on that host"
        ) from error


def data_mesh(batch_size: int, devices: Sequence[Any] | None = None) -> Mesh:
    """Devices on one axis, ``data``: all of all processes unless some are named.

    Raises:
        UserError: the batch cannot be split evenly over the devices.
    """
    devices = jax.devices() if devices is None else devices
    count = len(devices)
    if batch_size % count:
        raise UserError(
            f"Train.batch_size = {batch_size} does not divide among {count} devices; "
            f"use a multiple of {count}"
        )
    return jax.make_mesh(
        (count,), ("data",), axis_types=(AxisType.Auto,), devices=devices
    )


def batch_sharding(mesh: Mesh | AbstractMesh) -> NamedSharding:
    """Split over devices on the first axis."""
    return NamedSharding(mesh, PartitionSpec("data"))


def replicate(tree: T, mesh: Mesh) -> T:
    """The same host values, whole on every device."""
    sharding = NamedSharding(mesh, PartitionSpec())

    def place(value: ArrayLike) -> jax.Array:
        x = np.asarray(value)
        return jax.make_array_from_callback(x.shape, sharding, lambda index: x[index])

    return jax.tree.map(place, tree)


def process_share(count: int) -> slice:
    """The part of ``count`` patches that this process gathers."""
    share = count // jax.process_count()
    return slice(jax.process_index() * share, (jax.process_index() + 1) * share)


def shard_batch(tree: T, mesh: Mesh) -> T:
    """Each process's share of a batch as one array over all devices."""
    sharding = batch_sharding(mesh)
    return jax.tree.map(
        lambda x: jax.make_array_from_process_local_data(sharding, np.asarray(x)), tree
    )


def agreed_to_stop(asked: bool, step: int, every: int) -> bool:
    """Whether this process or another was asked to stop.

    All must leave after the same step, so several compare every ``every`` steps only.
    """
    if jax.process_count() == 1:
        return asked
    return step % every == 0 and in_any_process(asked)


def in_any_process(here: bool) -> bool:
    """Whether something holds in this process or in another; all must ask."""
    return bool(np.any(multihost_utils.process_allgather(np.array(here))))


def is_writer() -> bool:
    """Whether this process writes files (process 0)."""
    return jax.process_index() == 0


def describe_devices() -> str:
    """One line on what computes; a loud one if a GPU sits idle.

    Raises:
        UserError: JAX_PLATFORMS names what this machine does not have.
    """
    try:
        devices = jax.devices()
    except (RuntimeError, AssertionError) as error:
        raise UserError(
            f"JAX_PLATFORMS={os.environ.get('JAX_PLATFORMS', '')}: no such device "
            f"can be used ({one_line(error)}); unset it, or for an NVIDIA GPU run "
            'pip install "jax[cuda13]"'
        ) from error
    names = ", ".join(sorted({device.device_kind for device in devices}))
    line = f"devices: {len(devices)} x {devices[0].platform} ({names})"
    if jax.process_count() > 1:
        line += f", process {jax.process_index()} of {jax.process_count()}"
    elif devices[0].platform == "cpu":
        line += f", {os.cpu_count()} cores"
    if devices[0].platform == "cpu" and _gpu_present():
        line += (
            "\n*** WARNING: this machine has a GPU that JAX cannot see: everything "
            'runs on the CPU. Install it with: pip install "jax[cuda13]" ***'
        )
    return line


def _gpu_present() -> bool:
    """Whether an NVIDIA GPU is attached, asked of the system and not of JAX."""
    return bool(glob.glob("/dev/nvidia[0-9]*")) or bool(shutil.which("nvidia-smi"))
