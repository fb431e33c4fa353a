# SPDX-License-Identifier: Apache-2.0
"""Laws of every enhancement: light edits, one path, and one made by a user."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, ClassVar

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn
from jaxtyping import Float

import eval as eval_script
import render as render_script
import train as train_script
from internal import parallel
from internal.binding import configurable, typed
from internal.color import linear_to_srgb, photo_to_linear, srgb_to_linear
from internal.configs import load_config
from internal.enhancements import metering
from internal.enhancements.base import Enhancement, Output
from internal.enhancements.gamma import Gamma, GammaNetwork
from internal.enhancements.look import DISPLAY_POWER, NEUTRAL, LightEdit, Look
from internal.enhancements.tone import Tone, ToneNetwork
from internal.models import Model
from internal.rendering.renderer import Renderer
from internal.structs import Colored, Decomposed, Level, Lit, LitRendering, Terms
from internal.training.step import initial_state
from internal.volume import composite
from tests.conftest import TINY_ENHANCED, TINY_MLP, TINY_MODEL, TINY_SIZES, flags

TONE = Tone(stops=3.0)
KINDS = [Gamma(), TONE]
ids = pytest.mark.parametrize("enhancement", KINDS, ids=lambda e: type(e).__name__)


def level_of(seed: int = 0) -> Level:
    """Six rays of four samples."""
    keys = jax.random.split(jax.random.key(seed), 4)
    weights = jax.random.dirichlet(keys[0], jnp.ones(4), (6,))
    samples = Decomposed(
        density=jnp.ones((6, 4)),
        v=jnp.exp(jax.random.uniform(keys[1], (6, 4, 1), minval=-4.0, maxval=-2.0)),
        r=jax.random.uniform(keys[2], (6, 4, 3), minval=0.3, maxval=1.5),
        features=jax.random.normal(keys[3], (6, 4, 5)),
    )
    return Level(jnp.ones((6, 5)), weights, composite(weights, samples.rgb), samples)


def applied(enhancement: Enhancement) -> tuple[Any, Any]:
    """Its network and parameters that are not the first ones."""
    network: Any = enhancement.network("enhancement")
    params = network.init(jax.random.key(1), level_of(), NEUTRAL)
    if isinstance(enhancement, Tone):
        params = {"params": {"saturation": jnp.float32(1.2)}}
    return network, params


def rendering_of(enhancement: Enhancement, look: Look) -> LitRendering:
    network, params = applied(enhancement)
    level = level_of()
    assert isinstance(level.samples, Decomposed)
    lit = network.apply(params, level, look.edit())
    v, r = (composite(level.weights, x) for x in (level.samples.v, level.samples.r))
    return LitRendering(level.rgb, level.rgb[:, :1], v, r, lit)


@ids
def test_the_neutral_edit_changes_no_bit_and_strength_zero_is_the_dark(enhancement):
    neutral = rendering_of(enhancement, Look(1.0, 0.0, 6500.0))
    chex.assert_trees_all_equal(rendering_of(enhancement, Look()), neutral)
    off = rendering_of(enhancement, Look(strength=0.0))
    np.testing.assert_allclose(off.enhanced, off.rgb, rtol=1e-5)
    half = rendering_of(enhancement, Look(strength=0.5)).enhanced
    assert jnp.all((off.enhanced < half) & (half < neutral.enhanced))


@ids
def test_warm_is_redder_and_magenta_less_green(enhancement):
    plain = rendering_of(enhancement, Look()).enhanced
    warm = rendering_of(enhancement, Look(temperature=3000.0)).enhanced
    assert jnp.all((warm > plain)[:, 0] & (warm < plain)[:, 2])
    magenta = rendering_of(enhancement, Look(tint=1.0)).enhanced
    assert jnp.all((magenta < plain)[:, 1] & (magenta > plain)[:, 0])


@ids
@pytest.mark.parametrize("contrast", [0.5, 2.0])
def test_contrast_is_a_power_about_middle_grey(enhancement, contrast):
    """Of one sample in grey: r and compositing are then the identity."""
    network, params = applied(enhancement)
    v = jnp.geomspace(0.002, 0.6, 7)[:, None, None]
    grey = Decomposed(v[..., 0], v, jnp.ones((7, 1, 3)), jnp.zeros((7, 1, 5)))
    level = Level(jnp.ones((7, 2)), jnp.ones((7, 1)), grey.rgb[:, 0], grey)
    plain = network.apply(params, level, NEUTRAL).enhanced
    edited = network.apply(params, level, Look(contrast=contrast).edit()).enhanced
    np.testing.assert_allclose(edited, 0.5 * (2.0 * plain) ** contrast, rtol=1e-4)


WEIGHTS = [(Gamma(), f"{n}_smooth") for n in ("alpha", "gamma")]
WEIGHTS += [(Gamma(), n) for n in ("exposure", "gray", "gamma_norm")]
WEIGHTS += [(TONE, "colorfulness")]


@pytest.mark.parametrize(("enhancement", "name"), WEIGHTS)
def test_a_weight_weighs_its_own_term(enhancement, name):
    rendering = rendering_of(enhancement, Look())
    before = enhancement.terms(rendering)
    heavier = {name: 3.0 * getattr(enhancement, name)}
    after = dataclasses.replace(enhancement, **heavier).terms(rendering)
    assert before[name] > 0.0
    for term, value in before.items():
        expected = 3.0 * value if term == name else value
        np.testing.assert_allclose(after[term], expected, rtol=1e-5, err_msg=term)


def test_what_is_metered_is_what_is_rendered():
    dark = np.asarray(0.02 * (1.0 + jax.random.uniform(jax.random.key(3), (3000, 3))))
    tone = Tone(colorfulness=0.0).metered(dark)
    network: Any = tone.network("enhancement")
    one = jnp.ones((len(dark), 1))
    level = Level(one, one, jnp.asarray(dark), Colored(one, jnp.asarray(dark)[:, None]))
    lit = network.apply({"params": {"saturation": jnp.ones(())}}, level, NEUTRAL)
    prior = metering.load_prior()
    curve = metering.meter(dark, prior), prior.contrast, prior.shoulder
    wanted = metering.developed(photo_to_linear(dark), *curve)
    np.testing.assert_allclose(jnp.mean(lit.enhanced), wanted.mean(), atol=2e-4)


def test_a_stop_doubles_the_light_of_gamma_and_comes_before_the_shoulder_of_tone():
    plain, more = (rendering_of(Gamma(), Look(exposure=e)).enhanced for e in (0.0, 1.0))
    np.testing.assert_allclose((more / plain) ** DISPLAY_POWER, 2.0, rtol=1e-4)
    network, params = applied(TONE)
    level = level_of()
    brighter = linear_to_srgb(2.0 * srgb_to_linear(level.rgb))
    expected = network.apply(
        params, dataclasses.replace(level, rgb=brighter), NEUTRAL
    ).enhanced
    got = rendering_of(TONE, Look(exposure=1.0)).enhanced
    np.testing.assert_allclose(got, expected, rtol=1e-4)
    assert jnp.all(rendering_of(TONE, Look(exposure=9.0)).enhanced < 1.0)


@ids
@pytest.mark.parametrize(
    "look", [Look(exposure=1.5), Look(0.4, 0.5, 3000.0, 0.3, 1.7), Look(0.0, -1.0)]
)
def test_relighting_finished_pixels_is_following_rays_anew(enhancement, look):
    network, params = applied(enhancement)
    along = enhancement.along_rays(look.edit())
    before = rendering_of(enhancement, Look())
    rendered = network.apply(params, level_of(), along)
    before = dataclasses.replace(before, lit=rendered)
    method = {Gamma: GammaNetwork, Tone: ToneNetwork}[type(enhancement)].relight
    relit = network.apply(params, before, look.edit(), method=method)
    expected = rendering_of(enhancement, look).lit
    chex.assert_trees_all_close(relit, expected, rtol=2e-4, atol=1e-6)


@ids
def test_a_picture_of_any_size_is_relit_as_if_rendered_so(
    enhancement, tiny_cameras, ndc
):
    config = load_config([], TINY_MODEL)
    own = dataclasses.replace(config.model, enhancement=enhancement)
    config = dataclasses.replace(config, model=own)
    model, mesh = Model(own), parallel.data_mesh(4)
    params = initial_state(config, model).params
    renderer = Renderer(model, tiny_cameras, ndc, mesh, 24)  # of 80 pixels
    edit = Look(0.7, 1.0, 4000.0, 0.2, 1.3).edit()
    before = renderer.view(params, 1, enhancement.along_rays(edit))
    assert isinstance(before, LitRendering)
    relit = renderer.relit(params, before, edit)
    expected = renderer.view(params, 1, edit)
    chex.assert_trees_all_close(relit, expected, rtol=2e-4, atol=1e-6)


@ids
def test_every_output_has_its_shape_and_a_sentence(enhancement):
    rendering = rendering_of(enhancement, Look())
    assert "enhanced" in enhancement.outputs
    for output in enhancement.outputs.values():
        assert output.of(rendering).shape in ((6, 1), (6, 3))
        assert len(output.explanation) > 10


@ids
def test_its_terms_move_all_its_parameters(enhancement):
    network, params = applied(enhancement)
    rendering = rendering_of(enhancement, Look())

    def loss(params):
        lit = network.apply(params, level_of(), NEUTRAL)
        return sum(enhancement.terms(dataclasses.replace(rendering, lit=lit)).values())

    moved = jax.tree.leaves(jax.grad(loss)(params))
    assert any(jnp.any(x != 0.0) for x in moved)
    assert all(jnp.all(jnp.isfinite(x)) for x in moved)


@configurable("Gain")
@typed
@dataclasses.dataclass(frozen=True)
class Gain:
    """A third enhancement, as a user would write it: one gain of v per scene."""

    neighbors: ClassVar[int] = 0
    whole_batch: ClassVar[bool] = False
    outputs: ClassVar[Mapping[str, Output]] = {
        "enhanced": Output("the lit scene, gain * c", lambda x: x.enhanced),
        "halved": Output("half of the lit scene", lambda x: x.enhanced / 2),
    }
    target: float = 0.4

    def network(self, name: str) -> "GainNetwork":
        return GainNetwork(name=name)

    def metered(self, dark_srgb: Float[np.ndarray, "n 3"]) -> "Gain":
        return self

    def along_rays(self, edit: LightEdit) -> LightEdit:
        return NEUTRAL

    def terms(self, rendering: LitRendering) -> Terms:
        return {"level": jnp.mean(rendering.enhanced - self.target) ** 2}


class GainNetwork(nn.Module):
    def setup(self) -> None:
        self.gain = self.param("gain", nn.initializers.ones, ())

    def __call__(self, level: Level, edit: LightEdit) -> Lit:
        return Lit(level.rgb * self.gain * edit.coded_gains)

    def relight(self, rendering: LitRendering, edit: LightEdit) -> Lit:
        return Lit(rendering.rgb * self.gain * edit.coded_gains)


def test_an_enhancement_from_outside_trains_evaluates_renders_and_is_explained(
    night, tmp_path
):
    run = tmp_path / "run"
    own = ["Model.enhancement = @Gain()", "Gain.target = 0.3"]
    argv = flags(night, run, *own, model=(*TINY_SIZES, *TINY_MLP, *TINY_ENHANCED))
    assert train_script.main(argv) == 0
    last = json.loads((run / "metrics.jsonl").read_text().splitlines()[-1])
    assert last["loss/level"] > 0 and last["grad_norm/enhancement"] > 0
    assert eval_script.main(argv) == 0
    page = (run / "eval" / "index.html").read_text()
    assert "half of the lit scene" in page and (run / "eval" / "halved").is_dir()
    assert render_script.main(argv) == 0
    assert (run / "render" / "auto" / "enhanced" / "0000.png").is_file()


def test_an_unknown_enhancement_is_named():
    with pytest.raises(Exception, match="Glow"):
        load_config([], ["Model.enhancement = @Glow()"])
