# SPDX-License-Identifier: Apache-2.0
"""Configuration: small frozen dataclasses, filled by gin.

Paper values are the defaults; every other value stands in a file of ``configs/``.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from internal import binding, enhancements, fields
from internal.binding import configurable, typed
from internal.enhancements.base import Enhancement
from internal.enhancements.gamma import Gamma
from internal.enhancements.look import Look
from internal.errors import UserError
from internal.fields.base import FieldConfig
from internal.fields.mlp import MLP
from internal.scene.config import SceneConfig


@configurable("Model")
@typed
@dataclasses.dataclass(frozen=True)
class ModelConfig:
    """The field, its sampling and the enhancement."""

    field: FieldConfig = dataclasses.field(default_factory=MLP)  # internal/fields
    # internal/enhancements; None: plain mip-NeRF without v and r
    enhancement: Enhancement | None = dataclasses.field(default_factory=Gamma)
    num_samples: tuple[int, ...] = (128, 128)  # per level of hierarchical sampling
    resample_padding: float = 0.01  # mip-NeRF Eq. 18
    near_reach: float = 0.0  # of ``coord.Space.gradient_share``; 0: all learn alike
    ray_shape: str = "auto"  # cone, cylinder; auto: cylinder in NDC
    deg_view: int = 4
    head_width: int = 128  # hidden width of F1 and F2
    density_noise: float = 1.0  # std, training only


@configurable("Losses")
@typed
@dataclasses.dataclass(frozen=True)
class LossConfig:
    """Weights and constants of the field's losses; a weight of 0 removes a term."""

    data_eps: float = 1e-3  # epsilon_2, plus
    data_eps_of_mean: float = 0.0  # this part of the photos' mean
    observation: str = "ideal"  # photos show colours; noisy: internal/scene/noise.py
    coarse: float = 0.1  # data term of the levels before the last
    interlevel: float = 1.0  # of proposals, where the field has them
    distortion: float = 0.01  # at the first step; so many times that at the last:
    distortion_growth: float = 1.0


@configurable("Optimizer")
@typed
@dataclasses.dataclass(frozen=True)
class OptimizerConfig:
    """Adam for the field and, from ``Train.enhance_start``, a fresh one for the
    enhancement."""

    lr_init: float = 1e-3
    lr_final: float = 1e-5
    warmup_steps: int = 2500
    warmup_factor: float = 0.01
    enhancement_lr_init: float = 1e-3
    enhancement_lr_final: float = 1e-4
    b2: float = 0.999  # of Adam
    eps: float = 1e-8  # of Adam
    averaged_end: float = 0.0  # share of the steps whose mean the field ends at
    clip_value: float = 0.1  # per element, then; 0: not at all
    clip_norm: float = 0.1  # per group (field, enhancement); 0: not at all


@configurable("Train")
@typed
@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """The schedule of one run."""

    max_steps: int = 105_000
    enhance_start: int = 100_000  # first step of the enhancement losses
    batch_size: int = 1024  # pixels; each brings what its enhancement asks for
    seek_detail: bool = False  # draws more pixels where photos have detail
    passes: int = 1  # parts of a batch worked off one after the other
    seed: int = 0
    log_every: int = 100
    checkpoint_every: int = 5000
    checkpoints_kept: int = 2
    preview_every: int = 5000  # TensorBoard pictures of the first training view


@configurable("Render")
@typed
@dataclasses.dataclass(frozen=True)
class RenderConfig(Look):
    """Camera path, light and size of what render.py writes."""

    path: str = "auto"  # spiral, ellipse, around, views, or a JSON file
    frames: int = 120
    fps: int = 30
    chunk: int = 4096  # rays per call; lower it when memory runs out
    sample_shares: tuple[float, ...] = ()  # of Model.num_samples; (): all of each


@configurable("Config")
@typed
@dataclasses.dataclass(frozen=True)
class Config(SceneConfig):
    """The scene, where results go, and all the rest."""

    checkpoint_dir: str = ""
    max_minutes: float = 0.0  # stretches the schedule to this time; 0: as configured
    model: ModelConfig = dataclasses.field(default_factory=ModelConfig)
    losses: LossConfig = dataclasses.field(default_factory=LossConfig)
    optimizer: OptimizerConfig = dataclasses.field(default_factory=OptimizerConfig)
    train: TrainConfig = dataclasses.field(default_factory=TrainConfig)
    render: RenderConfig = dataclasses.field(default_factory=RenderConfig)


def load_config(
    files: Sequence[str], bindings: Sequence[str], base: Sequence[str] = ()
) -> Config:
    """Parses gin files, then bindings, and checks every name, type and use.

    Args:
        base: bindings that hold where files and bindings say nothing.

    Raises:
        UserError: a file is missing, a name is unknown, a value has a wrong type or
            no meaning, or nothing reads it.
    """
    register()
    config, names = _parsed(files, bindings, base)
    _check(config)
    found = _used(config, names)
    for name, where in _without_effect(files, bindings, base, found):
        place = f"{where}: " if where else ""
        raise UserError(f"gin: {place}{name} has no effect: {_reader(name)}")
    return config


def bound(name: str, files: Sequence[str], bindings: Sequence[str]) -> str:
    """What gin files, then bindings, say of one text; "" if nothing.

    Raises:
        UserError: as ``load_config``, of names that nobody knows.
    """
    register()
    return binding.parsed(files, bindings, (), lambda: binding.value_of(name))


def with_effect(files: Sequence[str], bindings: Sequence[str]) -> list[str]:
    """The bindings without those that nothing reads on top of these files."""
    register()
    found = _used(*_parsed(files, bindings, ()))
    names = {x: binding.stated_names(x) for x in bindings}
    return [x for x in bindings if names[x] & found or not names[x]]


def register() -> None:
    """Makes all that ``@`` can refer to known by name."""
    fields.register()
    enhancements.register()


def _without_effect(
    files: Sequence[str],
    bindings: Sequence[str],
    base: Sequence[str],
    found: frozenset[str],
) -> Iterator[tuple[str, str]]:
    """The names bound on the command line or by its files themselves that nothing
    reads, each with its file; ``found`` are those that are read.

    What a file includes may hold more than is read. What comes after a file may
    choose another field or enhancement, as long as something of the file is left.
    """
    for number, file in enumerate(files, start=1):
        stated = binding.stated_names(Path(file).read_text(encoding="utf-8"))
        left = bool(stated & found)
        alone = (files[:number], (), base)
        at_the_file = _used(*_parsed(*alone)) if left else found
        yield from ((name, file) for name in sorted(stated - at_the_file))
    stated = binding.stated_names("\n".join(bindings))
    yield from ((name, "") for name in sorted(stated - found))


def _parsed(
    files: Sequence[str], bindings: Sequence[str], base: Sequence[str]
) -> tuple[Config, frozenset[str]]:
    """The configuration, and the names of all bindings that making it read."""
    return binding.parsed(
        files, bindings, base, lambda: (Config(), binding.read_names())
    )


def _used(config: Config, names: frozenset[str]) -> frozenset[str]:
    """Of the names that a configuration read, those that change something."""
    return names - {
        name for x in _SOMETIMES if not x.holds(config) for name in x.names.split()
    }


def _reader(name: str) -> str:
    """What would have to be there for a setting to have an effect, in words."""
    section, dot, _ = name.rpartition(".")
    if not dot:
        return f"nothing says %{name}; a setting is SECTION.NAME, as in configs/*.gin"
    for case in _SOMETIMES:
        if name in case.names.split():
            return f"it needs {case.needs}"
    slots = {"Model.field": FieldConfig, "Model.enhancement": Enhancement}
    kinds = [x for x, name in binding.NAMES.items() if name == section.split("/")[-1]]
    uses = [
        f"{slot} = @{section}()"
        for kind in kinds
        for slot, protocol in slots.items()
        if isinstance(kind(), protocol)
    ]
    return f"it needs {' or '.join(uses) or f'@{section}()'}"


@dataclasses.dataclass(frozen=True)
class _Sometimes:
    """Settings that are read under a condition."""

    names: str
    needs: str  # the condition in words
    holds: Callable[[Config], bool]


_SOMETIMES = (
    _Sometimes(
        "Train.enhance_start Optimizer.enhancement_lr_init "
        "Optimizer.enhancement_lr_final Render.strength Render.exposure "
        "Render.temperature Render.tint Render.contrast",
        "a Model.enhancement",
        lambda config: config.model.enhancement is not None,
    ),
    _Sometimes(
        "Losses.interlevel HashGrid.proposal_resolutions",
        "proposals: Model.field = @HashGrid() and two levels in Model.num_samples",
        lambda config: _proposes(config) and len(config.model.num_samples) > 1,
    ),
    _Sometimes(
        "Losses.coarse",
        "a coarse level: a field without proposals, as Model.field = @MLP(), and two "
        "levels in Model.num_samples",
        lambda config: not _proposes(config) and len(config.model.num_samples) > 1,
    ),
    _Sometimes(
        "Model.resample_padding",
        "two levels in Model.num_samples",
        lambda config: len(config.model.num_samples) > 1,
    ),
    _Sometimes(
        "Config.end_at_far",
        "Config.projection = 'ndc' or 'auto'",
        lambda config: config.projection != "contract",
    ),
)


def _proposes(config: Config) -> bool:
    return config.model.field.proposal() is not None


def _check(config: Config) -> None:
    """Rejects values that have the right type and no meaning."""
    model, train = config.model, config.train
    rules = {
        "Config.factor >= 1": config.factor >= 1,
        "Model.num_samples: one or more positive counts": len(model.num_samples) > 0
        and min(model.num_samples) > 0,
        "Render.sample_shares: () or a positive one for each of Model.num_samples": (
            len(config.render.sample_shares) in (0, len(model.num_samples))
            and min(config.render.sample_shares, default=1.0) > 0.0
        ),
        "Model.ray_shape: auto, cone or cylinder": model.ray_shape
        in ("auto", "cone", "cylinder"),
        "Losses.observation: ideal or noisy": config.losses.observation
        in ("ideal", "noisy"),
        "Train.max_steps >= 1": train.max_steps >= 1,
        f"Train.enhance_start = {train.enhance_start} comes before Train.max_steps = "
        f"{train.max_steps}, or the enhancement learns nothing; set both": (
            train.enhance_start < train.max_steps or model.enhancement is None
        ),
        "Train.log_every, checkpoint_every, preview_every >= 1": min(
            train.log_every, train.checkpoint_every, train.preview_every
        )
        >= 1,
        "Train.checkpoints_kept >= 1": train.checkpoints_kept >= 1,
        "Optimizer.lr_init, enhancement_lr_init > 0": min(
            config.optimizer.lr_init, config.optimizer.enhancement_lr_init
        )
        > 0.0,
        "Render.frames, fps, chunk >= 1": min(
            config.render.frames, config.render.fps, config.render.chunk
        )
        >= 1,
        "Model.head_width >= 1, deg_view >= 0": model.head_width >= 1
        and model.deg_view >= 0,
        "Model.field: sizes >= 1": min(_sizes(model.field), default=1) >= 1,
        "Train.passes = 1 for an enhancement that looks at the whole batch": (
            train.passes == 1
            or model.enhancement is None
            or not model.enhancement.whole_batch
        ),
        "Train.batch_size >= 1": train.batch_size >= 1,
        "Train.passes divides Train.batch_size": train.passes >= 1
        and train.batch_size % train.passes == 0,
    }
    for rule, holds in rules.items():
        if not holds:
            raise UserError(f"gin: a binding breaks the rule: {rule}")


def _sizes(field: FieldConfig) -> list[int]:
    """All counts and resolutions of a field."""
    flat = [x if isinstance(x, tuple) else (x,) for x in vars(field).values()]
    return [x for sizes in flat for x in sizes if type(x) is int]
