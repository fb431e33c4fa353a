# SPDX-License-Identifier: Apache-2.0
"""Every equation, figure and section that the tree names, against the papers, and every
file that a document links to.

They are written one way, ``LLNeRF Eq.`` and a number, one at a time and on one line,
so that one grep finds who implements it.
"""

import importlib
import inspect
import itertools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXTS = {".py", ".md", ".gin", ".toml"}
PAPERS = {
    "LLNeRF": {  # numbered by the order of its LaTeX
        "Eq. 1": "MLPs of density and colour",
        "Eq. 2": "volume rendering",
        "Eq. 3": "decomposition c = v r",
        "Eq. 4": "enhanced pixel",
        "Eq. 5": "decomposed picture of 2-D methods",
        "Eq. 6": "enhanced picture of 2-D methods",
        "Eq. 7": "mean of noisy photos, denoising",
        "Eq. 8": "enhancement v_hat = phi(v)",
        "Eq. 9": "colour loss L_c",
        "Eq. 10": "smoothness loss L_s",
        "Eq. 11": "its discrete form L_sa",
        "Fig. 1": "teaser",
        "Fig. 2": "one point from two views",
        "Fig. 3": "network",
        "Fig. 4": "training and losses",
        "Fig. 5": "novel views beside LLE + NeRF",
        "Fig. 6": "decomposition beside URetinexNet",
        "Fig. 7": "dataset samples",
        "Fig. 8": "beside 2-D enhancement",
        "Fig. 9": "user study",
        "Fig. 10": "ablation of the losses",
        "Fig. 11": "colour temperature",
        "Sec. 4.1": "decomposition",
        "Sec. 4.2.1": "denoising",
        "Sec. 4.2.2": "enhancement of v",
        "Sec. 4.3": "optimisation",
        "Sec. 5.1": "dataset",
        "Sec. 5.2": "results",
    },
    "NeRF": {
        "Eq. 4": "positional encoding",
        "Eq. 25": "origin of a ray in NDC",
        "Eq. 26": "direction of a ray in NDC",
        "App. C": "derivation of NDC",
    },
    "mip-NeRF": {
        "Eq. 7": "moments of a conical frustum",
        "Eq. 8": "its Gaussian in the world",
        "Eq. 14": "integrated positional encoding",
        "Eq. 16": "diagonal of the covariance",
        "Eq. 18": "weights filtered for resampling",
        "Sec. 3.1": "cone tracing and its radius",
    },
    "mip-NeRF 360": {
        "Eq. 9": "warped Gaussian",
        "Eq. 10": "contraction",
        "Eq. 11": "normalised distance s",
        "Eq. 13": "loss of proposals",
        "Eq. 15": "distortion of a step function",
    },
    "RawNeRF": {"Eq. 4": "loss linearised around the prediction"},
    "LIME": {
        "Eq. 1": "picture = reflectance * light",
        "Eq. 14": "weights of the smoothness",
        "Eq. 17": "sped-up objective",
    },
    "LLFF": {"Sec. 5": "practical use, spiral paths"},
    "Zip-NeRF": {"Sec. 2": "footprints by downweighting"},
    "Instant NGP": {"Sec. 3": "hash encoding", "Sec. 4": "first values of tables"},
}
IMPLEMENTED = {
    "LLNeRF Eq. 1": ("fields.mlp.MipTrunk", "fields.hash_grid.GridTrunk"),
    "LLNeRF Eq. 2": ("volume.compute_weights", "volume.composite"),
    "LLNeRF Eq. 3": ("heads.DecomposedField", "structs.Decomposed"),
    "LLNeRF Eq. 4": ("enhancements.gamma.GammaNetwork",),
    "LLNeRF Eq. 7": ("scene.noise.expected_photo",),
    "LLNeRF Eq. 8": ("enhancements.gamma.enhance_v",),
    "LLNeRF Eq. 9": (
        "losses.exposure_loss", "losses.gray_world_loss", "losses.gamma_norm_loss",
    ),
    "LLNeRF Eq. 10": ("enhancements.gamma.Gamma.terms",),
    "LLNeRF Eq. 11": ("losses.smoothness_loss",),
    "LLNeRF Sec. 4.2.2": ("enhancements.gamma.Phi",),
    "LLNeRF Sec. 4.3": ("losses.data_loss",),
    "LLNeRF Fig. 11": ("enhancements.gamma.light_v",),
    "NeRF Eq. 4": ("mip.pos_enc",),
    "NeRF Eq. 25": ("coord.world_to_ndc",),
    "mip-NeRF Eq. 7": ("mip.conical_frustum_to_gaussian",),
    "mip-NeRF Eq. 14": ("mip.integrated_pos_enc",),
    "mip-NeRF Eq. 16": ("mip.lift_variance",),
    "mip-NeRF Eq. 18": ("stepfun.blur_weights",),
    "mip-NeRF 360 Eq. 9": ("coord.contracted_variance",),
    "mip-NeRF 360 Eq. 10": ("coord.contract",),
    "mip-NeRF 360 Eq. 11": ("coord.Unbounded.s_to_t",),
    "mip-NeRF 360 Eq. 13": ("stepfun.interlevel",),
    "mip-NeRF 360 Eq. 15": ("stepfun.distortion",),
}  # fmt: skip
ANY = re.compile(
    r"\b(?:Eqs?|Figs?|Secs?|Tabs?|Apps?)\.?[ ~]*\(?[0-9A-Z][0-9.]*"
    r"|\b(?:[Ee]quation|[Ff]igure|[Ss]ection|Table|Appendix)s? \(?[0-9A-Z]\b[0-9.]*"
)
LONGEST_FIRST = "|".join(sorted(PAPERS, key=len, reverse=True))
TRUE = re.compile(
    rf"(?<![\w-])({LONGEST_FIRST}) ((?:Eq|Fig|Sec|App)\. [0-9A-Z][0-9.]*)"
)
RANGE = re.compile(r"\s*(?:-|–|to |and |or |, )\(?[0-9]")


def faults(text: str) -> list[str]:
    """References of a text that are bare, in ranges, or in no paper."""
    found = []
    for line in text.splitlines():
        good = {m.end(2): m for m in TRUE.finditer(line)}
        for match in ANY.finditer(line):
            cited = good.get(match.end())
            known = cited and cited[2].rstrip(".") in PAPERS[cited[1]]
            if not known or RANGE.match(line, match.end()):
                found.append(line.strip())
    return found


def tree() -> dict[str, str]:
    """The text of every file of ours by its path."""
    folders = ("internal", "tests", "configs", "docs", "benchmarks", "experiments")
    files = itertools.chain(ROOT.glob("*"), *((ROOT / x).rglob("*") for x in folders))
    kept = (x for x in files if x.name == "Makefile" or x.suffix in TEXTS)
    names = {x.relative_to(ROOT).as_posix(): x for x in kept if x != Path(__file__)}
    return {name: file.read_text(encoding="utf-8") for name, file in names.items()}


@pytest.mark.parametrize(
    "text",
    ["Eq. 4", "(Eqs. 7, 8)", "NeRF, Eq. 4", "LLNeRF Eqs. 9-10", "LLNeRF Eq. 9-10",
     "LLNeRF Eq. 9 and 10", "LLNeRF Fig. 12", "LLNeRF Sec. 3.3.1", "LLNeRF Figure 8",
     "equation 8", "mip-NeRF 360 Eq. 7", "LLNeRF\nEq. 4", "Section 4.1", "XNeRF Eq. 4"],
)  # fmt: skip
def test_bare_and_wrong_references_are_found(text):
    assert faults(text)


def test_right_references_pass():
    assert not faults("(LLNeRF Eq. 9). mip-NeRF 360 Eq. 10, NeRF App. C; 4 equations")


def test_every_reference_is_in_its_paper():
    wrong = [f"{name}: {x}" for name, text in tree().items() for x in faults(text)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("document", [x for x in tree() if x.endswith(".md")])
def test_what_a_document_links_to_is_there(document):
    links = re.findall(r"\]\(([^)#\s]+)", tree()[document])
    files = [ROOT / document / ".." / x for x in links if "://" not in x]
    assert not [file for file in files if not file.resolve().exists()]


@pytest.mark.parametrize("equation", IMPLEMENTED)
def test_who_implements_an_equation_says_so(equation):
    method = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
    row = "".join(re.findall(rf"^\| {re.escape(equation)} \|.*$", method, re.MULTILINE))
    for name in IMPLEMENTED[equation]:
        assert re.search(rf"(?<![\w-]){equation}(?!\d)", docstring(name)), name
        assert name.split(".")[-1] in row, name


def docstring(name: str) -> str:
    """Of a thing inside ``internal``, by dotted name."""
    parts = name.split(".")
    modules = [n for n in range(1, len(parts)) if _is_module(parts[:n])]
    found = importlib.import_module(".".join(["internal", *parts[: modules[-1]]]))
    for part in parts[modules[-1] :]:
        found = getattr(found, part)
    return inspect.getdoc(found) or ""


def _is_module(parts: list[str]) -> bool:
    path = ROOT.joinpath("internal", *parts)
    return path.is_dir() or path.with_suffix(".py").is_file()
