# SPDX-License-Identifier: Apache-2.0
"""What light rays carry: surfaces, spherical lamps, mirror images.

World frame: OpenGL, unit one decimetre. Light is linear RGB. Vectors and colours
are component-first, ``[3, rays]``. ``u`` are random numbers in [0, 1).
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import Array
from jaxtyping import Float

from internal.night import raytrace, textures
from internal.night.raytrace import Solids, directions_about, dot, normalize
from internal.night.textures import Material

LIFT = 1e-3  # decimetres between a surface and the rays that start on it
AMBIENT_REACH = 4.0  # decimetres: farther solids do not shade ambient light
MIRRORS = 1  # mirror images of mirror images are left out


@struct.dataclass
class Lamps:
    """Spherical lights that cast ``radiances``, visible only where a solid glows."""

    centers: Float[Array, "*n 3"]
    radii: Float[Array, "*n"]
    radiances: Float[Array, "*n 3"]


@struct.dataclass
class World:
    """Everything that a ray can meet or be lit by."""

    solids: Solids
    materials: Material  # one per solid
    lamps: Lamps
    ambient: Float[Array, "3"]  # radiance from everywhere


@struct.dataclass
class Surface:
    """What each ray meets first."""

    t: Float[Array, " rays"]  # inf where a ray meets nothing
    point: Float[Array, "3 rays"]
    normal: Float[Array, "3 rays"]  # unit length
    albedo: Float[Array, "3 rays"]
    roughness: Float[Array, " rays"]
    metalness: Float[Array, " rays"]
    emission: Float[Array, "3 rays"]


def first_surface(
    world: World, origin: Float[Array, "3 rays"], direction: Float[Array, "3 rays"]
) -> Surface:
    """The nearest surface along each ray."""
    t, index = raytrace.nearest_hit(world.solids, origin, direction)
    point = origin + direction * jnp.where(jnp.isfinite(t), t, 0.0)[None]
    unit = raytrace.unit_point(world.solids, index, point)
    material = jax.tree.map(
        lambda leaf: jnp.moveaxis(leaf, 0, -1)[..., index],
        world.materials,
    )
    half_size = world.solids.half_sizes.T[:, index]
    return Surface(
        t=t,
        point=point,
        normal=raytrace.surface_normals(world.solids, index, unit),
        albedo=textures.albedo(material, unit, unit * half_size),
        roughness=material.roughness,
        metalness=material.metalness,
        emission=material.emission,
    )


def fresnel(surface: Surface, cosine: Float[Array, " rays"]) -> Float[Array, "3 rays"]:
    """Mirror reflectance at an angle of incidence (Schlick 1994)."""
    head_on = 0.04 + surface.metalness[None] * (surface.albedo - 0.04)
    return head_on + (1.0 - head_on) * (1.0 - jnp.clip(cosine, 0.0, 1.0))[None] ** 5


def highlight(
    surface: Surface,
    to_light: Float[Array, "3 rays"],
    to_viewer: Float[Array, "3 rays"],
    spread: Float[Array, " rays"],
) -> Float[Array, "3 rays"]:
    """Specular BRDF: GGX facets, height-correlated Smith shadowing (per steradian).

    Args:
        spread: radius of the lamp over its distance, which widens the lobe
            (Karis 2013): the lamp's centre stands for all of it, without noise.
    """
    half = normalize(to_light + to_viewer)
    n_light = jnp.maximum(dot(surface.normal, to_light), 1e-3)
    n_view = jnp.maximum(dot(surface.normal, to_viewer), 1e-3)
    a2 = jnp.clip(surface.roughness**2 + 0.5 * spread, 0.0, 1.0) ** 2
    facets = a2 / (jnp.pi * (dot(surface.normal, half) ** 2 * (a2 - 1.0) + 1.0) ** 2)
    shadowing = 0.5 / (
        n_light * jnp.sqrt(n_view**2 * (1.0 - a2) + a2)
        + n_view * jnp.sqrt(n_light**2 * (1.0 - a2) + a2)
    )
    return (facets * shadowing)[None] * fresnel(surface, dot(half, to_viewer))


def diffuse(surface: Surface) -> Float[Array, "3 rays"]:
    """Lambert's BRDF (per steradian); metals have none."""
    return surface.albedo * (1.0 - surface.metalness)[None] / jnp.pi


def lamp_light(
    solids: Solids,
    lamp: Lamps,
    surface: Surface,
    to_viewer: Float[Array, "3 rays"],
    u: Float[Array, "2 rays"],
) -> Float[Array, "3 rays"]:
    """Light of one lamp that surfaces send to the viewer, by one shadow ray each.

    The ray goes to a uniform direction within the cone that the lamp fills.
    """
    to_center = lamp.centers[:, None] - surface.point
    distance = jnp.sqrt(dot(to_center, to_center))
    to_center = to_center / distance[None]
    spread = lamp.radii / distance
    cos_max = jnp.sqrt(jnp.maximum(1.0 - spread**2, 0.0))
    to_light = directions_about(to_center, 1.0 - u[0] * (1.0 - cos_max), u[1])
    start = surface.point + LIFT * surface.normal
    clear = raytrace.is_clear(solids, start, to_light, distance - 1.01 * lamp.radii)
    cosine = jnp.maximum(dot(surface.normal, to_light), 0.0)
    brdf = diffuse(surface) + highlight(surface, to_center, to_viewer, spread)
    solid_angle = 2.0 * jnp.pi * (1.0 - cos_max)
    received = jnp.where(clear, cosine * solid_angle, 0.0)
    return lamp.radiances[:, None] * brdf * received[None]


def ambient_light(
    world: World, surface: Surface, u: Float[Array, "2 rays"]
) -> Float[Array, "3 rays"]:
    """Diffuse light of the ambient, by one cosine-weighted ray per surface."""
    outward = directions_about(surface.normal, jnp.sqrt(1.0 - u[0]), u[1])
    start = surface.point + LIFT * surface.normal
    clear = raytrace.is_clear(world.solids, start, outward, AMBIENT_REACH)
    ambient = jnp.where(clear[None], world.ambient[:, None], 0.0)
    return diffuse(surface) * jnp.pi * ambient


def shade(
    world: World,
    surface: Surface,
    to_viewer: Float[Array, "3 rays"],
    u: Float[Array, "lights 2 rays"],
) -> Float[Array, "3 rays"]:
    """Light that surfaces send to the viewer, mirror images apart.

    ``u`` has one row per lamp and a last one for the ambient.
    """
    ambient = ambient_light(world, surface, u[-1])

    def add_lamp(light, lamp_and_u):
        lamp, lamp_u = lamp_and_u
        lit = lamp_light(world.solids, lamp, surface, to_viewer, lamp_u)
        return light + lit, None

    light, _ = jax.lax.scan(add_lamp, surface.emission + ambient, (world.lamps, u[:-1]))
    empty = jnp.broadcast_to(world.ambient[:, None], light.shape)
    return jnp.where(jnp.isfinite(surface.t)[None], light, empty)


def radiance(
    world: World,
    origin: Float[Array, "3 rays"],
    direction: Float[Array, "3 rays"],
    u: Float[Array, "lights 2 rays"],
) -> Float[Array, "3 rays"]:
    """Light along rays: first surfaces and what is mirrored in them."""

    def bounce(carry, _):
        origin, forward, weight, light = carry
        surface = first_surface(world, origin, forward)
        light = light + weight * shade(world, surface, -forward, u)
        cosine = -dot(surface.normal, forward)
        mirror = _clarity(surface)[None] * fresnel(surface, cosine)
        reflected = forward + 2.0 * cosine[None] * surface.normal
        start = surface.point + LIFT * surface.normal
        return (start, reflected, weight * mirror, light), None

    start = (
        origin,
        normalize(direction),
        jnp.ones_like(origin),
        jnp.zeros_like(origin),
    )
    (_, _, _, light), _ = jax.lax.scan(bounce, start, length=1 + MIRRORS)
    return light


def _clarity(surface: Surface) -> Float[Array, " rays"]:
    """How clear mirror images are: one ray that fades stands for their blur."""
    clarity = jnp.maximum(1.0 - surface.roughness / 0.6, 0.0) ** 2
    return jnp.where(jnp.isfinite(surface.t), clarity, 0.0)
