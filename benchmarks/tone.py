# SPDX-License-Identifier: Apache-2.0
"""Every part of the tone curve, left out or changed, on one trained field.

python -m benchmarks.tone --run outputs/SCENE

The dark training views are metered (without truth), the dark test views developed and
scored. The last rows choose with the truth of the training views, as no method may.
"""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float
from scipy.optimize import minimize

from benchmarks import workload
from internal import cli, flags, losses, parallel, progress
from internal.color import from_uint16, linear_to_srgb, srgb_to_linear
from internal.configs import Config
from internal.enhancements.tone import MOST_SATURATION, response, saturate
from internal.rendering.renderer import Renderer
from internal.scoring import metrics
from internal.scoring.baselines import gain_to_mean
from internal.training.checkpoints import load_trained

VIEWS = 12  # of the training split, that are metered
STRIDE = 3  # pixels between metered ones
ROUNDS, BISECTIONS, MOST_STOPS = 5, 20, 12.0

Views = list[Float[np.ndarray, "_height _width 3"]]
Pixels = Float[Array | np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True)
class Variant:
    """One way to light the dark views."""

    contrast: float | None = 1.3  # None: no response, a straight line that clips
    target: float = 0.58
    least: float = 0.14
    mean: bool = False  # meters the mean of all channels
    gray_world: float = 0.0  # how much of the scene's mean colour is taken away
    black: float = 0.0  # percentile of the dark that becomes black


VARIANTS = {
    "all parts": Variant(),
    "a straight line that clips instead of the response": Variant(contrast=None),
    "without colourfulness": Variant(least=0.0),
    "mean of all channels metered, to 0.46": Variant(mean=True, target=0.46),
    "mean of all channels metered, to 0.50": Variant(mean=True, target=0.5),
    "contrast 1.0 (Reinhard)": Variant(contrast=1.0),
    "contrast 1.15": Variant(contrast=1.15),
    "contrast 1.45": Variant(contrast=1.45),
    "contrast 1.6": Variant(contrast=1.6),
    "target 0.55": Variant(target=0.55),
    "target 0.61": Variant(target=0.61),
    "least colourfulness 0.10": Variant(least=0.10),
    "least colourfulness 0.18": Variant(least=0.18),
    "half of gray world": Variant(gray_world=0.5),
    "gray world": Variant(gray_world=1.0),
    "black point: percentile 0.1": Variant(black=0.1),
}


def main() -> None:
    config = cli.start_trained(flags.trained(__doc__).parse_args())
    train, train_truth = dark_views(config, "train")
    test, truth = dark_views(config, "test")
    metered = np.concatenate([x[::STRIDE, ::STRIDE].reshape(-1, 3) for x in train])
    bright = np.concatenate([x[::STRIDE, ::STRIDE].reshape(-1, 3) for x in train_truth])
    methods: dict[str, Callable[[Float[np.ndarray, "h w 3"]], Array]] = {
        "one gain per view to mean 0.5": gain_to_mean
    }
    for name, variant in VARIANTS.items():
        methods[name] = functools.partial(light, variant, *meter(variant, metered))
    for name, parameters in ORACLES.items():
        methods[name] = oracle(parameters, metered, bright)
    rows = []
    for name, method in progress.track(
        methods.items(), len(methods), "scoring", "method"
    ):
        pictures = [np.clip(np.asarray(method(x)), 0, 1) for x in test]
        scores = [metrics.score(*pair) for pair in zip(pictures, truth, strict=True)]
        mean = {key: np.mean([x[key] for x in scores]) for key in scores[0]}
        keys = ("psnr", "psnr_exposure_matched", "ssim", "ciede2000")
        digits = (2, 2, 3, 2)
        cells = (f"{mean[key]:.{n}f}" for key, n in zip(keys, digits, strict=True))
        rows.append((name, *cells))
    headers = ("variant", "PSNR", "PSNR exp.", "SSIM", "CIEDE2000")
    print(workload.markdown(headers, rows))


def dark_views(config: Config, split: str) -> tuple[Views, Views]:
    """Dark renderings of a split's views, and their normal-light photos."""
    mesh = parallel.data_mesh(jax.device_count())
    model, state = load_trained(config, mesh)
    scene = cli.load_split(config, split)
    renderer = Renderer(
        model, scene.cameras, scene.space, mesh, config.render.chunk, lambda x: x.rgb
    )
    step = max(len(scene.images) // VIEWS, 1) if split == "train" else 1
    views = range(0, len(scene.images), step)
    rendered = [np.asarray(renderer.view(state.params, view)) for view in views]
    return rendered, [from_uint16(scene.truth[view]) for view in views]


def light(
    variant: Variant,
    balance: Float[np.ndarray, " 3"],
    black: float,
    stops: float,
    saturation: float,
    dark_srgb: Float[np.ndarray, "*b 3"],
) -> Float[Array, "*b 3"]:
    """What the variant makes of dark colours; of the shipped one, ``tone.develop``."""
    linear = jnp.maximum(srgb_to_linear(dark_srgb) - black, 0.0) * balance
    exposed = saturate(linear, jnp.asarray(saturation)) * 2.0**stops
    if variant.contrast is None:
        return jnp.clip(linear_to_srgb(exposed), 0.0, 1.0)
    return linear_to_srgb(response(exposed, variant.contrast))


def meter(
    variant: Variant, dark_srgb: Pixels
) -> tuple[Float[np.ndarray, " 3"], float, float, float]:
    """Colour balance, black, stops and saturation at which the losses are least."""
    linear = np.asarray(srgb_to_linear(dark_srgb))
    mean = np.mean(linear, axis=0)
    balance = (np.mean(mean) / mean) ** variant.gray_world
    black = (
        float(np.percentile(np.min(linear, -1), variant.black))
        if variant.black
        else 0.0
    )
    lit = jax.jit(functools.partial(light, variant, balance, black))

    def too_dark(saturation: float, stops: float) -> bool:
        brightness = exposure(variant, lit(stops, saturation, dark_srgb))
        return bool(brightness < variant.target)

    def too_pale(stops: float, saturation: float) -> bool:
        srgb = lit(stops, saturation, dark_srgb)
        return bool(losses.colorfulness(srgb) < variant.least)

    stops, saturation = 0.0, 1.0
    for _ in range(ROUNDS):
        stops = bisect(functools.partial(too_dark, saturation), -MOST_STOPS, MOST_STOPS)
        saturation = bisect(functools.partial(too_pale, stops), 1.0, MOST_SATURATION)
    return balance, black, stops, saturation


def exposure(variant: Variant, srgb: Pixels) -> Float[Array, ""]:
    return jnp.mean(srgb if variant.mean else jnp.max(srgb, axis=-1))


def bisect(too_low: Callable[[float], bool], low: float, high: float) -> float:
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if too_low(middle) else (low, middle)
    return low


ORACLES = {
    "chosen with the truth: one gain": 1,
    "chosen with the truth: gain and contrast": 2,
    "chosen with the truth: a gain per channel and contrast": 4,
}


def oracle(
    parameters: int, dark_srgb: Pixels, truth: Pixels
) -> Callable[[Float[np.ndarray, "h w 3"]], Array]:
    """The curve nearest to the truth in mean squared error."""

    def curve(
        values: Float[Array | np.ndarray, " n"], srgb: Pixels
    ) -> Float[Array, "*b 3"]:
        gains = 2.0 ** jnp.asarray(values[0] if parameters < 4 else values[1:])
        exposed = gains * srgb_to_linear(srgb)
        if parameters == 1:
            return jnp.clip(linear_to_srgb(exposed), 0.0, 1.0)
        return linear_to_srgb(response(exposed, values[1 if parameters == 2 else 0]))

    start = {1: [5.0], 2: [5.0, 1.3], 4: [1.3, 5.0, 5.0, 5.0]}[parameters]

    @jax.jit
    def error(values: Float[Array, " n"]) -> Float[Array, ""]:
        return jnp.mean((curve(values, dark_srgb) - truth) ** 2)

    best = minimize(error, np.array(start), method="Nelder-Mead").x
    return functools.partial(curve, best)


if __name__ == "__main__":
    main()
