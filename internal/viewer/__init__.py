# SPDX-License-Identifier: Apache-2.0
"""The live viewer: ``server.py`` is where to start reading.

A ``Session`` per browser turns what its panel says into jobs; one thread
(``sharing.py``) computes chunks of them in turn; ``canvas.py`` makes pictures of the
results. ``baking.py`` makes splats to walk on, ``lit_splats.py`` colours them. Only
``server.py``, ``gate.py``, ``stage.py``, ``border.py``, ``walk.py`` and the panel with
its parts (``panel.py``, ``output_chooser.py``, ``light_controls.py``,
``path_editor.py``) know viser.
"""
