# SPDX-License-Identifier: Apache-2.0
"""Training on several devices, on paper: memory of each, and what they pass per step.

python -m benchmarks.scaling [--devices 1 8 64]

Nothing is run: each configuration's step on a scene of LOM's size is compiled for so
many CPU devices. Memory is the compiler's, traffic is counted in the compiled program,
FLOPs in the one before it. Interconnects have their nominal bandwidth per device and
direction, all-reduces are rings, devices sustain ``SUSTAINED``; latency is left out.
"""

import argparse
import dataclasses
import math
import re
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from benchmarks import workload
from internal import parallel
from internal.cameras import NODES, Cameras
from internal.configs import load_config
from internal.coord import ForwardFacing
from internal.models import Model
from internal.training import sampler
from internal.training.step import initial_state, make_train_step

CONFIGS = (workload.FAITHFUL, "configs/llnerf_best.gin")
SUSTAINED = 20e12  # FLOP/s of a device
BANDWIDTHS = {  # bytes/s of a device
    "NVLink 4": 450e9, "TPU v5e ICI": 100e9, "InfiniBand NDR": 50e9, "PCIe 4 x16": 32e9,
}  # fmt: skip
VIEWS, PIXELS = 22, 500 * 375


@dataclasses.dataclass(frozen=True)
class Cost:
    """Of a step on one device, in bytes and FLOPs."""

    kept: float  # arguments: state, photos, cameras
    worked: float  # temporaries
    flops: float
    summed: float  # over devices


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, nargs="+", default=[1, 8, 64])
    flags = parser.parse_args()
    jax.config.update("jax_num_cpu_devices", max(flags.devices))
    costs, times = [], []
    for file in CONFIGS:
        whole = cost_of(file, 1).flops
        for count in flags.devices:
            cost = cost_of(file, count)
            megabytes = (cost.kept, cost.worked, cost.summed)
            costs.append((file, count, *(f"{x / 1e6:,.1f}" for x in megabytes)))
            sent = 2.0 * (count - 1) / count * cost.summed
            seconds = [flops / SUSTAINED for flops in (whole, cost.flops)]
            seconds += [sent / bandwidth for bandwidth in BANDWIDTHS.values()]
            times.append((file, count, *(f"{1e3 * x:.2f}" for x in seconds)))
    who = ("config", "devices")
    print(workload.markdown((*who, "kept, MB", "worked on, MB", "summed, MB"), costs))
    computed = ("a whole batch", "its part of one")
    print(workload.markdown((*who, *computed, *BANDWIDTHS), times))


def cost_of(file: str, count: int) -> Cost:
    """What a step of a configuration costs each of so many devices.

    With several, all of a device's part of the batch is in flight: every pass would
    sum the gradients over the devices again.
    """
    config = load_config([file], [])
    if count > 1:
        size = config.train.batch_size // count * count
        split = [f"Train.batch_size = {size}", "Train.passes = 1"]
        config = load_config([file], split)
    mesh = parallel.data_mesh(config.train.batch_size, jax.devices()[:count])
    model = Model(config.model)
    step = jax.jit(make_train_step(config, model, mesh, 0.1), donate_argnums=0)
    state = jax.eval_shape(lambda: initial_state(config, model))
    given: Any = on_devices((state, *scene_shapes()), mesh)
    lowered = step.lower(*given)
    compiled = lowered.compile()
    memory: Any = compiled.memory_analysis()
    costs: Any = lowered.cost_analysis()
    passed = traffic(compiled.as_text() or "")
    flops = costs["flops"] * config.train.passes / count
    return Cost(
        memory.argument_size_in_bytes,
        memory.temp_size_in_bytes,
        flops,
        4.0 * sum(numbers for kind, numbers in passed if kind == "all-reduce"),
    )


def scene_shapes() -> tuple[Cameras, ForwardFacing, sampler.ResidentPixels]:
    """A scene of LOM's size, as shapes."""
    shape: Any = jax.ShapeDtypeStruct
    each = shape((VIEWS,), jnp.int32)
    cameras = Cameras(
        shape((VIEWS, 3, 4), jnp.float32),
        shape((NODES**2, 3), jnp.float32),
        *[each] * 3,
    )
    photos = shape((VIEWS * PIXELS, 3), jnp.uint16)
    gains = shape((VIEWS, 3), jnp.float32)
    source = sampler.ResidentPixels(photos, each, gains, sampler.Chances())
    return cameras, ForwardFacing(shape((2,), jnp.float32)), source


def on_devices(tree: tuple, mesh: Mesh) -> tuple:
    """The same shapes, whole on every device."""
    whole = NamedSharding(mesh, PartitionSpec())
    return jax.tree.map(
        lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=whole), tree
    )


def traffic(program: str) -> list[tuple[str, int]]:
    """What a compiled program passes between devices: the kind of each collective, and
    of how many numbers."""
    found = []
    pattern = r"= (.*?) (all-\w+|collective-\w+|reduce-scatter)(?:-start)?\("
    for shapes, kind in re.findall(pattern, program):
        sizes = re.findall(r"[a-z]\d+\[([\d,]*)\]", shapes)
        numbers = [math.prod(map(int, re.findall(r"\d+", size))) for size in sizes]
        found.append((kind, sum(numbers)))
    return found


if __name__ == "__main__":
    main()
