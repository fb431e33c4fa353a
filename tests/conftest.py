# SPDX-License-Identifier: Apache-2.0
"""What all tests share: fake devices, a tiny model, tiny scenes."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import make_scene
import train as train_script
from internal.cameras import Cameras, node_positions
from internal.configs import Config, load_config
from internal.coord import ForwardFacing

# Tests compile much and compute little. Scripts that tests start inherit this.
_QUICK = [
    "--xla_backend_optimization_level=0",
    "--xla_llvm_disable_expensive_passes=true",
]
if jax.__version_info__ < (0, 11):  # a flag that a later XLA lacks would end the run
    _QUICK.append("--xla_cpu_use_fusion_emitters=false")
os.environ["XLA_FLAGS"] = " ".join(
    dict.fromkeys([*os.environ.get("XLA_FLAGS", "").split(), *_QUICK])
)

# Four CPU devices, so that every run tests what several GPUs would do.
jax.config.update("jax_num_cpu_devices", 4)

# Laws have no deadline: a machine may be busy.
settings.register_profile(
    "patient", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("patient")

TINY_SIZES = (
    "Model.num_samples = (6, 7)",
    "Model.head_width = 8",
    "Train.batch_size = 8",
    "Train.max_steps = 6",
    "Train.log_every = 2",
    "Train.checkpoint_every = 3",
    "Train.preview_every = 6",
    "Optimizer.averaged_end = 0.4",
    "Optimizer.warmup_steps = 2",
    "Render.chunk = 64",
    "Render.frames = 3",
)
TINY_MLP = ("MLP.depth = 2", "MLP.width = 16", "MLP.max_deg = 4")
TINY_ENHANCED = ("Train.enhance_start = 3",)
TINY_GAMMA = (*TINY_ENHANCED, "Gamma.width = 8")
TINY_PLAIN = (*TINY_SIZES, *TINY_MLP, "Model.enhancement = None")
TINY_MODEL = (*TINY_SIZES, *TINY_MLP, *TINY_GAMMA)


def bindings(scene: Path, model: tuple[str, ...] = TINY_MODEL) -> list[str]:
    """Gin bindings of a tiny model on a scene."""
    return [*model, f"Config.data_dir = {str(scene)!r}"]


def flags(
    scene: Path, run: Path, *own: str, model: tuple[str, ...] = TINY_MODEL
) -> list[str]:
    """A script's flags for a tiny model in a run folder, with own bindings."""
    run_binding = f"Config.checkpoint_dir = {str(run)!r}"
    every = (*bindings(scene, model), run_binding, *own)
    return [f"--gin_bindings={binding}" for binding in every]


@pytest.fixture(scope="session", autouse=True)
def compiled_once(tmp_path_factory) -> None:
    """What tests and the scripts that they start compile is compiled once a run."""
    settings = {
        "jax_compilation_cache_dir": str(tmp_path_factory.mktemp("compiled")),
        "jax_persistent_cache_min_compile_time_secs": 0.1,
    }
    for name, value in settings.items():
        jax.config.update(name, value)
        os.environ[name.upper()] = str(value)


@pytest.fixture(scope="session")
def night(tmp_path_factory) -> Path:
    """The night scene, six views of 36 x 32 pixels."""
    folder = tmp_path_factory.mktemp("scenes") / "night"
    size = ["--views", "6", "--width", "36", "--height", "32"]
    assert make_scene.main(["night", str(folder), *size]) == 0
    return folder


@pytest.fixture(scope="session")
def night_run(night, tmp_path_factory) -> Path:
    """Six steps of training on it. Nobody trains on in this folder: copy it."""
    folder = tmp_path_factory.mktemp("runs") / "night"
    assert train_script.main(flags(night, folder)) == 0
    return folder


@pytest.fixture(scope="session")
def tiny_config() -> Config:
    """A decomposed model so small that a step compiles in a second or two."""
    return load_config([], TINY_MODEL)


@pytest.fixture(scope="session")
def tiny_cameras() -> Cameras:
    """Three pinhole views of 10 x 8 pixels, side by side, looking along -z."""
    width, height, views = 10, 8, 3
    x, y = np.meshgrid(node_positions(width), node_positions(height))
    directions = np.stack([(x - 5) / 10, -(y - 4) / 10, -np.ones_like(x)], axis=-1)
    camtoworlds = np.tile(np.eye(4)[:3], (views, 1, 1))
    camtoworlds[:, 0, 3] = np.linspace(-0.2, 0.2, views)
    return Cameras(
        camtoworlds=jnp.float32(camtoworlds),
        directions=jnp.float32(directions.reshape(-1, 3)),
        table_starts=jnp.zeros(views, jnp.int32),
        widths=jnp.full(views, width, jnp.int32),
        heights=jnp.full(views, height, jnp.int32),
    )


@pytest.fixture(scope="session")
def tiny_images() -> tuple[np.ndarray, ...]:
    """Dark noise for the three tiny views, uint16 sRGB."""
    rng = np.random.default_rng(0)
    return tuple(rng.integers(0, 16000, (8, 10, 3)).astype(np.uint16) for _ in range(3))


@pytest.fixture(scope="session")
def ndc() -> ForwardFacing:
    """The forward-facing space of the tiny cameras."""
    return ForwardFacing(jnp.array([2.0, 2.5]))


@pytest.fixture(scope="session")
def captures() -> Path:
    """The folder of real captures; tests that need it skip where it is absent."""
    default = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("LLNERF_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real captures in {folder} (set LLNERF_DATA)")
    return folder
