# SPDX-License-Identifier: Apache-2.0
"""The paper's user study (LLNeRF Sec. 5.2, LLNeRF Fig. 9): a page, its evaluation.

``page.py`` makes the page, ``answers.py`` reads what people downloaded from it.
"""
