# SPDX-License-Identifier: Apache-2.0
"""The library behind the scripts at the root of the repository, which run from there;
nothing named ``internal`` is installed.

With the paper open, in its order:

    NeRF and mip-NeRF  ``cameras`` (a pixel's cone), ``coord`` (NDC, contraction),
                       ``stepfun`` (samples along rays), ``mip`` (IPE), ``volume``
                       (LLNeRF Eq. 2), ``models`` (all of it on one screen)
    LLNeRF Sec. 4.1    decomposition: ``fields``, ``heads`` (F1 and F2)
    LLNeRF Sec. 4.2.1  denoising: ``scene.noise``, ``scene.unround``
    LLNeRF Sec. 4.2.2  enhancement: ``enhancements.gamma`` (phi)
    LLNeRF Sec. 4.3    optimisation: ``losses``, ``training.step``
    LLNeRF Sec. 5.1    dataset: ``scene`` reads photos, ``night`` makes them
    LLNeRF Sec. 5.2    results: ``scoring``, ``comparison``, ``study``

``docs/method.md`` goes on from there, equation by equation.
"""
