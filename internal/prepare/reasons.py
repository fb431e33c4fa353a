# SPDX-License-Identifier: Apache-2.0
"""Why photos found no place in a scene, and photos that show two scenes.

``matches`` counts verified matches of pairs of views (``matching.match_counts``).
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

FEW_FEATURES = 60
LINK = 25  # matches: chance alone reaches COLMAP's 15 now and then in noise
SECOND_SCENE = 0.2  # of all photos

Matches = Mapping[tuple[int, int], int]


def why_unplaced(
    view: int, matches: Matches, feature_counts: Int[np.ndarray, " views"]
) -> str:
    """One view's reason, with what to do."""
    if feature_counts[view] < FEW_FEATURES:
        return (
            f"only {feature_counts[view]} features: too dark, blurred or without "
            "texture; expose longer, on a tripod"
        )
    partners = [pair for pair, count in matches.items() if view in pair and count]
    if not partners:
        return "shares nothing with another photo; take photos in between"
    return (
        f"matches {len(partners)} photos, but too weakly to be placed; take photos in "
        "between, or in more light"
    )


def linked_groups(matches: Matches, count: int) -> list[list[int]]:
    """Views that are linked by matches, directly or not; the largest group first."""
    strong = [pair for pair, number in matches.items() if number >= LINK]
    first, second = np.array(strong, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(first)), (first, second)), (count, count))
    _, labels = connected_components(graph, directed=False)
    groups = [np.flatnonzero(labels == label).tolist() for label in np.unique(labels)]
    return sorted(groups, key=lambda group: (-len(group), group))


def second_scene(
    matches: Matches, count: int, placed: tuple[int, ...], fewest: int
) -> list[int]:
    """Views of another scene than the placed one; [] if there is none.

    A group that nothing links to the placed views, large enough for a scene.
    """
    for group in linked_groups(matches, count):
        large = len(group) >= max(fewest, SECOND_SCENE * count)
        if large and not set(group) & set(placed):
            return group
    return []
