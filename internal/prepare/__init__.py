# SPDX-License-Identifier: Apache-2.0
"""From a folder of dark photos or a video to a scene that trains.

In order: ``photos`` finds what is usable, ``statistics`` measures it, ``brighten``
makes copies in which features are found, ``matching`` and ``mapping`` recover cameras
from those, ``sharpness`` leaves blurred photos out, ``orient`` chooses the scene's
frame, ``scene.exposures`` compares the photos' light, ``scene_files`` writes the scene,
``checks`` judges it and ``report`` shows it.
``pipeline`` runs them; ``checking`` does so for a scene that has poses.
"""
