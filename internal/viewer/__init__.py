# SPDX-License-Identifier: Apache-2.0
"""The live viewer: ``server.py`` is where to start reading.

A ``Session`` per browser turns what its panel says into jobs; one thread
(``sharing.py``) computes chunks of them in turn; ``canvas.py`` makes pictures of the
results. Only ``server.py``, ``panel.py`` and ``stage.py`` know viser.
"""
