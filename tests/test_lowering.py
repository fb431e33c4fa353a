# SPDX-License-Identifier: Apache-2.0
"""What this machine may not run: programs for NVIDIA GPUs and TPUs, on eight devices.

Each shipped configuration's programs are lowered for both, in the sizes of tests; what
passes between devices is read in the programs that the CPU's compiler partitioned.
"""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from jax import export
from jax.sharding import AbstractMesh, AxisType, NamedSharding, PartitionSpec

from benchmarks.scaling import traffic
from internal import parallel
from internal.configs import load_config, with_effect
from internal.enhancements.look import NEUTRAL
from internal.export import bake, rasterizer
from internal.models import Model
from internal.rendering.renderer import Renderer
from internal.training import sampler
from internal.training import step as training
from tests.conftest import TINY_MLP
from tests.test_splats import CAMERA, some_splats

PLATFORMS = ("cuda", "tpu")
SIZES = (
    *TINY_MLP, "Train.batch_size = 64", "Model.num_samples = (4, 4)",
    "Model.head_width = 8", "HashGrid.log2_rows = 8", "HashGrid.finest = 32",
    "HashGrid.proposal_resolutions = (4,)", "Gamma.width = 8",
)  # fmt: skip
BASES = {"small_size": ("nerf",), "bright": ("nerf",)}  # these go on top of another
SCALARS = 32  # losses, the error: no gradient is so small
SHIPPED = sorted(path.stem for path in Path("configs").glob("*.gin"))
ON_ONE = ("llnerf", "llnerf_best", "nerf_fast")  # the fields, the enhancements, none


def tiny(name, *bindings):
    """A shipped configuration with the sizes of a test."""
    files = [f"configs/{x}.gin" for x in (*BASES.get(name, ()), name)]
    return load_config(files, with_effect(files, [*SIZES, *bindings]))


def on_leaves(function, *arguments, shardings=None):
    """A jitted function of the arrays in some arguments, and the shapes of these.

    What JAX puts into a pytree while it lowers is no array, and the types that tests
    check would say so.

    Args:
        shardings: of each argument; None: anywhere.
    """
    values, tree = jax.tree.flatten(arguments)
    leaves = [jax.ShapeDtypeStruct(np.shape(x), x.dtype) for x in values]

    def call(*leaves):
        return jax.tree.leaves(function(*jax.tree.unflatten(tree, leaves)))

    if shardings is None:
        return jax.jit(call), leaves
    placed = [
        sharding
        for argument, sharding in zip(arguments, shardings, strict=True)
        for _ in jax.tree.leaves(argument)
    ]
    return jax.jit(call, in_shardings=placed), leaves


def step_on_leaves(config, mesh, cameras, images, space, fed=False):
    """The train step, what it is given, and how many weights it trains."""
    model = Model(config.model)
    state = jax.eval_shape(lambda: training.initial_state(config, model))
    gains = np.ones((len(images), 3), np.float32)
    source = sampler.resident_pixels(images, gains, sampler.Chances())
    if fed:
        neighbors = sampler.neighbors_of(config)
        batch = source.batch(cameras, config.train, neighbors, jnp.int32(0))
        source = sampler.FedPixels(batch)
    step = training.make_train_step(config, model, mesh, 0.1)
    whole = NamedSharding(mesh, PartitionSpec())
    shardings = [whole] * 3 + [parallel.batch_sharding(mesh) if fed else whole]
    given = (state, cameras, space, source)
    weights = sum(x.size for x in jax.tree.leaves(state.params))
    return *on_leaves(step, *given, shardings=shardings), weights


def abstract_mesh(devices):
    return AbstractMesh((devices,), ("data",), axis_types=(AxisType.Auto,))


def lowered(function, leaves):
    """A program for both platforms, as text; it calls nothing that a CPU alone has."""
    exported = export.export(function, platforms=PLATFORMS)(*leaves)
    assert exported.platforms == PLATFORMS
    text = exported.mlir_module()
    assert re.findall(r"custom_call @(\w+)", text) == []
    return exported, text


def tolerated(optimizer):
    """One of optax in which types are promoted in silence: floats to integer powers."""

    def update(updates, state, params=None):
        with jax.numpy_dtype_promotion("standard"):
            return optimizer.update(updates, state, params)

    return optax.GradientTransformation(optimizer.init, update)


@pytest.fixture
def strict(monkeypatch):
    """No type is promoted in silence, but in Adam."""
    adam = optax.adam
    monkeypatch.setattr(optax, "adam", lambda *a, **named: tolerated(adam(*a, **named)))
    with jax.numpy_dtype_promotion("strict"):
        yield


@pytest.mark.parametrize(
    ("name", "devices"), [*((x, 8) for x in SHIPPED), *((x, 1) for x in ON_ONE)]
)
def test_the_step_lowers_for_gpus_and_tpus_and_splits_its_batch(
    name, devices, tiny_cameras, tiny_images, ndc, strict
):
    mesh = abstract_mesh(devices)
    step, leaves, _ = step_on_leaves(tiny(name), mesh, tiny_cameras, tiny_images, ndc)
    exported, text = lowered(step, leaves)
    assert exported.nr_devices == devices
    split = re.findall(r'sdy.sharding_constraint .*\[\{"data"\}, \{', text)
    assert len(split) == 5  # view, x, y, levels, gains


@pytest.mark.parametrize(
    ("name", "devices"), [*((x, 4) for x in SHIPPED), ("llnerf_best", 1)]
)
def test_rendering_lowers_for_gpus_and_tpus(name, devices, tiny_cameras, ndc, strict):
    config = tiny(name)
    mesh = parallel.data_mesh(devices, jax.devices()[:devices])
    model = Model(config.model)
    renderer = Renderer(model, tiny_cameras, ndc, mesh, chunk=64)
    params = jax.eval_shape(lambda: training.initial_state(config, model)).params
    whole = NamedSharding(mesh, PartitionSpec())
    camera = tiny_cameras.take(np.array([0]))
    given = (params, camera, ndc, NEUTRAL, jnp.int32(0))
    render = on_leaves(renderer._render_chunk, *given, shardings=[whole] * 5)
    exported, text = lowered(*render)
    assert exported.nr_devices == devices
    assert re.search(r'sdy.sharding_constraint .*\[\{"data"\}\]', text)


def test_baking_splats_lowers_for_gpus_and_tpus(strict):
    splats = some_splats()
    footprints = rasterizer._project(splats, CAMERA)
    lists = rasterizer.list_splats(footprints, CAMERA.width, CAMERA.height)
    packed = jnp.zeros((len(splats), 9))
    srgb = jnp.zeros((len(lists.starts), 3, rasterizer.PIXELS))
    optimizer = tolerated(bake.optimizer_of_fit(5))
    improve = bake.improvement(optimizer, bake.RATES, jnp.ones((len(splats), 1)))
    fitted = {name: getattr(splats, name) for name in bake.RATES}
    for function, *arguments in (
        (rasterizer._project, splats, CAMERA),
        (rasterizer._pack, footprints),
        (rasterizer._walk_all, packed, *lists),
        (rasterizer._walk_all_back, packed, *lists, srgb, srgb),
        (rasterizer._pull_back, splats, CAMERA, packed),
        (improve, fitted, fitted, optimizer.init(fitted)),
    ):
        lowered(*on_leaves(function, *arguments))


@pytest.mark.parametrize(("name", "fed"), [("llnerf_best", False), ("nerf_fast", True)])
def test_devices_sum_each_gradient_once_and_pass_nothing_else(
    name, fed, tiny_cameras, tiny_images, ndc
):
    config = tiny(name)
    mesh = parallel.data_mesh(config.train.batch_size)
    step, leaves, weights = step_on_leaves(
        config, mesh, tiny_cameras, tiny_images, ndc, fed
    )
    passed = traffic(step.lower(*leaves).compile().as_text() or "")
    assert {kind for kind, _ in passed} == {"all-reduce"}
    assert sum(numbers > SCALARS for _, numbers in passed) == 1
    assert weights <= sum(numbers for _, numbers in passed) <= weights + SCALARS
