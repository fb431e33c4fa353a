# SPDX-License-Identifier: Apache-2.0
"""The paper's user study (LLNeRF Sec. 5.2 and Fig. 9): a page that asks, and its evaluation.

``page.py`` makes the page, ``answers.py`` reads what people downloaded from it.
"""
