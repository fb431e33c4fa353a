# SPDX-License-Identifier: Apache-2.0
"""ICC profiles for tests: curves and primaries, as cameras and editors embed them."""

import struct

import numpy as np

SRGB_FORMULA = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
# Columns: XYZ of red, green and blue under D50, as the published profiles state them.
PRIMARIES = {
    "sRGB": (
        (0.43607, 0.38515, 0.14307),
        (0.22249, 0.71687, 0.06061),
        (0.01392, 0.09708, 0.71410),
    ),
    "Display P3": (
        (0.51512, 0.29198, 0.15710),
        (0.24120, 0.69225, 0.06657),
        (-0.00105, 0.04189, 0.78407),
    ),
    "Adobe RGB": (
        (0.60974, 0.20528, 0.14919),
        (0.31111, 0.62567, 0.06322),
        (0.01947, 0.06087, 0.74457),
    ),
    "ProPhoto": (
        (0.79767, 0.13519, 0.03134),
        (0.28804, 0.71188, 0.00009),
        (0.0, 0.0, 0.82510),
    ),
}
GAMMAS = {"Adobe RGB": 563 / 256, "ProPhoto": 1.8}


def rgb_profile(name: str, sampled: bool = False) -> bytes:
    """One of ``PRIMARIES``, its curve as a formula or gamma, or sampled."""
    curve = formula(3, *SRGB_FORMULA)
    if name in GAMMAS:
        curve = samples(round(GAMMAS[name] * 256))
    elif sampled:
        v = np.linspace(0.0, 1.0, 1024)
        light = np.where(v > 0.04045, ((v + 0.055) / 1.055) ** 2.4, v / 12.92)
        curve = samples(*np.round(light * 65535).astype(int).tolist())
    columns = np.array(PRIMARIES[name]).T
    tags = {f"{c}XYZ": xyz(*column) for c, column in zip("rgb", columns, strict=True)}
    return profile({**tags, **{f"{c}TRC": curve for c in "rgb"}})


def grey_profile(gamma: float) -> bytes:
    return profile({"kTRC": samples(round(gamma * 256))}, b"GRAY")


def profile(tags: dict[str, bytes], space: bytes = b"RGB ") -> bytes:
    tags = {"wtpt": xyz(0.9642, 1.0, 0.8249), **tags}
    table, body, start = b"", b"", 132 + 12 * len(tags)
    for name, tag in tags.items():
        tag += bytes(-len(tag) % 4)
        table += struct.pack(">4sII", name.encode(), start + len(body), len(tag))
        body += tag
    head = bytearray(128)
    head[0:4] = struct.pack(">I", start + len(body))
    head[8:28] = b"\x04\x30\0\0mntr" + space + b"XYZ " + bytes(4)
    head[36:40] = b"acsp"
    head[68:80] = fixed(0.9642, 1.0, 0.8249)
    return bytes(head) + struct.pack(">I", len(tags)) + table + body


def formula(kind: int, *values: float) -> bytes:
    return b"para\0\0\0\0" + struct.pack(">HH", kind, 0) + fixed(*values)


def samples(*values: int) -> bytes:
    count = len(values)
    return b"curv\0\0\0\0" + struct.pack(f">I{count}H", count, *values)


def xyz(*values: float) -> bytes:
    return b"XYZ \0\0\0\0" + fixed(*values)


def fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(v * 65536) for v in values))
