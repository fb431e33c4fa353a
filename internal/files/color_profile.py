# SPDX-License-Identifier: Apache-2.0
"""From the colours that a file states to sRGB.

An ``Encoding`` says which light a stored value means: a curve per channel, then the
primaries. It comes from an ICC profile, from the codes of ITU-T H.273 that videos,
HEIF and PNG carry, from a gamma, or from chromaticities. Stored values and sRGB are
in [0, 1]; linear light is 1 at white. Light outside of sRGB's gamut, or above white,
is clipped.

Tristimulus values of HDR are display light as ITU-R BT.2100 defines it, over the
203 cd/m2 of white in ITU-R BT.2408. There is no tone mapping: it would give the same
light another value in each picture.
"""

import dataclasses
import functools
import struct
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from internal import srgb_curve

LEVELS = 65536  # of a curve: all values of 8 and of 16 bits are among them
ONE_LEVEL = 1.0 / 255.0
HDR_WHITE = 203.0  # cd/m2, BT.2408
PQ_PEAK = 10000.0  # cd/m2, BT.2100
HLG_PEAK = 1000.0  # cd/m2, of BT.2100's reference display
HLG_SYSTEM_GAMMA = 1.2  # of that display
REC2020_LUMA = np.array([0.2627, 0.6780, 0.0593], np.float32)
# XYZ under D50, as ICC profiles state it, of light in sRGB's primaries.
D50_FROM_SRGB = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
D65 = (0.3127, 0.3290)
REC709 = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, *D65)
# Primaries of H.273 that differ visibly: x and y of red, green, blue and white.
WIDE_PRIMARIES = {
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *D65),  # BT.2020
    11: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351),  # DCI-P3
    12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *D65),  # Display P3
}
SMALLEST_GAMUT = 0.01  # twice the area between x and y of three lights
GAMMAS = {4: 2.2, 5: 2.8, 8: 1.0}  # transfer codes of H.273 that are powers
PQ, HLG = 16, 18
HDR = (PQ, HLG)

Curve = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]


class ProfileError(Exception):
    """A profile that is broken, or of a kind that is not understood."""


@dataclasses.dataclass(frozen=True, eq=False)
class Encoding:
    """What stored values mean."""

    name: str  # for messages
    # Light of each level: of all three channels, or of each.
    curves: Float[np.ndarray, "channels 65536"]
    rec709_from_light: Float[np.ndarray, "3 3"]  # to light in sRGB's primaries
    system_gamma: float = 1.0  # of HLG, where light depends on the luminance as well

    @functools.cached_property
    def is_srgb(self) -> bool:
        """Whether no colour would move by a level of 8 bits: then none is moved."""
        if self.system_gamma != 1.0:
            return False
        steps = np.linspace(0.0, 1.0, 18, dtype=np.float32)
        colors = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(1, -1, 3)
        return bool(np.abs(_convert(colors, self) - colors).max() < ONE_LEVEL)


def to_srgb(
    stored: Float[np.ndarray, "h w channels"], encoding: Encoding | None
) -> Float[np.ndarray, "h w channels"]:
    """The sRGB of stored values of one or three channels; None: they are sRGB.

    Grey stays grey: it is taken as three equal channels.
    """
    if encoding is None or encoding.is_srgb:
        return stored
    if stored.shape[-1] == 1:
        return _convert(np.repeat(stored, 3, axis=-1), encoding)[..., 1:2]
    return _convert(stored, encoding)


def from_icc(profile: bytes, channels: int) -> Encoding:
    """The encoding that an ICC profile states by curves and primaries.

    Args:
        profile: the whole profile.
        channels: 1 or 3, of the pixels it belongs to.

    Raises:
        ProfileError: it is broken, of colour tables, or of another kind of colours.
    """
    space = profile[16:20].decode("latin-1").strip()
    wanted = ("RGB",) if channels == 3 else ("RGB", "GRAY")
    if space not in wanted:
        raise ProfileError(f"its colour profile is for {space or 'nothing'}")
    try:
        tags = _tags(profile)
        if space == "GRAY":
            curve = _curve(tags["kTRC"])(_levels())
            return Encoding("a grey profile", curve[None], np.eye(3))
        if "rXYZ" not in tags and "A2B0" in tags:
            raise ProfileError("its colour profile is a table")
        curves = np.stack([_curve(tags[f"{c}TRC"])(_levels()) for c in "rgb"])
        primaries = np.stack([_xyz(tags[f"{c}XYZ"]) for c in "rgb"], axis=-1)
    except (KeyError, struct.error, ValueError, IndexError) as error:
        raise ProfileError(f"its colour profile is broken ({error!r})") from error
    if not (np.isfinite(curves).all() and np.ptp(curves, axis=-1).min() > 0.0):
        raise ProfileError("its colour profile is broken (a flat curve)")
    matrix = np.linalg.inv(D50_FROM_SRGB) @ primaries
    return Encoding("an ICC profile", curves, matrix)


def from_codes(primaries: int, transfer: int) -> Encoding | None:
    """The encoding of H.273's codes; None for sRGB and what is displayed like it:
    Rec. 709, the primaries of older television, codes that state nothing."""
    wide = WIDE_PRIMARIES.get(primaries)
    hdr = {PQ: ("PQ", _pq_light), HLG: ("HLG", _hlg_light)}
    if not wide and transfer not in hdr and transfer not in GAMMAS:
        return None
    matrix = _rec709_from(wide or REC709)
    if transfer in hdr:
        name, light = hdr[transfer]
        gamma = HLG_SYSTEM_GAMMA if transfer == HLG else 1.0
        return Encoding(name, light(_levels())[None], matrix, gamma)
    return from_primaries(wide or REC709, GAMMAS.get(transfer, 0.0))


def from_gamma(gamma: float, chromaticities: tuple[float, ...] = REC709) -> Encoding:
    """Light is the ``gamma``-th power of the stored value; x and y of primaries."""
    curve = (_levels() ** gamma)[None]
    return Encoding(f"gamma {gamma:g}", curve, _rec709_from(chromaticities))


def from_primaries(chromaticities: tuple[float, ...], gamma: float = 0.0) -> Encoding:
    """x and y of red, green, blue and white; sRGB's curve unless a gamma is given."""
    if gamma:
        return from_gamma(gamma, chromaticities)
    curve = srgb_curve.decode(_levels(), np)[None]
    return Encoding("wide primaries", curve, _rec709_from(chromaticities))


def are_primaries(chromaticities: tuple[float, ...]) -> bool:
    """Whether they are those of three lights and of a white that is made of them."""
    if len(chromaticities) != len(REC709) or min(chromaticities[1::2]) <= 0.0:
        return False
    x, y = np.reshape(chromaticities, (4, 2)).T
    sides = np.stack([x[:3], y[:3], np.ones(3)])
    if abs(np.linalg.det(sides)) < SMALLEST_GAMUT:
        return False
    return bool((np.linalg.solve(sides, [x[3], y[3], 1.0]) > 0.0).all())


def adobe_rgb() -> Encoding:
    """Adobe RGB (1998), for files that name it without a profile."""
    return from_gamma(563 / 256, (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *D65))


def _convert(
    stored: Float[np.ndarray, "h w 3"], encoding: Encoding
) -> Float[np.ndarray, "h w 3"]:
    place = np.round(np.clip(stored, 0.0, 1.0) * (LEVELS - 1)).astype(np.uint16)
    curves = np.broadcast_to(encoding.curves, (3, LEVELS)).astype(np.float32)
    light = np.stack([curves[c][place[..., c]] for c in range(3)], axis=-1)
    if encoding.system_gamma != 1.0:
        luminance = np.maximum(light @ REC2020_LUMA, 1e-9)[..., None]
        light = light * luminance ** np.float32(encoding.system_gamma - 1.0)
        light *= np.float32(HLG_PEAK / HDR_WHITE)
    return encode_srgb(light @ encoding.rec709_from_light.T.astype(np.float32))


def encode_srgb(light: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """sRGB of linear light, clipped to [0, 1], in NumPy: reading needs no JAX."""
    return srgb_curve.encode(np.clip(light, 0.0, 1.0), np).astype(np.float32)


def _levels() -> Float[np.ndarray, " 65536"]:
    return np.linspace(0.0, 1.0, LEVELS)


def _pq_light(v: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """BT.2100's EOTF of PQ, 1 at HDR_WHITE."""
    m1, m2 = 2610 / 16384, 2523 / 4096 * 128
    c1, c2, c3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
    power = v ** (1 / m2)
    light = (np.maximum(power - c1, 0.0) / (c2 - c3 * power)) ** (1 / m1)
    return light * (PQ_PEAK / HDR_WHITE)


def _hlg_light(v: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """BT.2100's inverse OETF of HLG: light of the scene, 1 at the peak."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(v <= 0.5, v**2 / 3.0, (np.exp((v - c) / a) + b) / 12.0)


def _rec709_from(chromaticities: tuple[float, ...]) -> Float[np.ndarray, "3 3"]:
    """From light in the stated primaries and white to sRGB's, white to white."""
    xyz = [_xyz_from_rgb(which) for which in (REC709, chromaticities)]
    whites = [BRADFORD @ matrix.sum(axis=-1) for matrix in xyz]
    adapt = np.linalg.inv(BRADFORD) @ np.diag(whites[0] / whites[1]) @ BRADFORD
    return np.linalg.inv(xyz[0]) @ adapt @ xyz[1]


def _xyz_from_rgb(chromaticities: tuple[float, ...]) -> Float[np.ndarray, "3 3"]:
    x, y = np.reshape(chromaticities, (4, 2)).T
    columns = np.stack([x / y, np.ones(4), (1.0 - x - y) / y])
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])


def _tags(profile: bytes) -> dict[str, bytes]:
    """The tagged elements of an ICC profile."""
    (count,) = struct.unpack_from(">I", profile, 128)
    tags = {}
    for entry in range(min(count, 100)):
        name, start, size = struct.unpack_from(">4sII", profile, 132 + 12 * entry)
        if start + size > len(profile):
            raise ValueError("cut short")
        tags[name.decode("latin-1")] = profile[start : start + size]
    return tags


def _xyz(tag: bytes) -> Float[np.ndarray, " 3"]:
    return np.array(struct.unpack_from(">3i", tag, 8)) / 65536.0


def _curve(tag: bytes) -> Curve:
    """ICC's two kinds of curves: samples or a gamma, and a formula."""
    if tag[:4] == b"para":
        return _parametric(tag)
    if tag[:4] != b"curv":
        raise ValueError(f"curve {tag[:4]!r}")
    (count,) = struct.unpack_from(">I", tag, 8)
    samples = np.array(struct.unpack_from(f">{count}H", tag, 12), np.float64)
    if count == 0:
        return lambda v: v
    if count == 1:
        return lambda v: v ** (samples[0] / 256.0)
    places = np.linspace(0.0, 1.0, count)
    return lambda v: np.interp(v, places, samples / 65535.0)


def _parametric(tag: bytes) -> Curve:
    """ICC.1:2022, 10.18: (a x + b)^g + e from d on, c x + f below."""
    (kind,) = struct.unpack_from(">H", tag, 8)
    count = (1, 3, 4, 5, 7)[kind]
    g, *rest = (n / 65536.0 for n in struct.unpack_from(f">{count}i", tag, 12))
    a, b, c, d, e, f = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if kind in (1, 2):
        a, b = rest[:2]
        e = f = rest[2] if kind == 2 else 0.0
        d = -b / a
    elif kind >= 3:
        a, b, c, d = rest[:4]
        e, f = rest[4:] if kind == 4 else (0.0, 0.0)

    def curve(v: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        power = np.maximum(a * v + b, 0.0) ** g + e
        return np.clip(np.where(v >= d, power, c * v + f), 0.0, 1.0)

    return curve
