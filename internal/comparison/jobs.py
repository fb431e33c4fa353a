# SPDX-License-Identifier: Apache-2.0
"""The work behind a comparison of methods on scenes, and where its results lie.

In the folder of the comparison, for each scene:

    photos/clahe/              all photos, enhanced on the fly
    scores/clahe/              test views of these: metrics.json, a folder per picture
    runs/nerf+small_size@clahe/    run folder of a training on these; its eval/ is
                               laid out as scores/clahe/ is

``Job`` is the work that fills one of the last two; methods that look at different
outputs of the same work share it.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from internal import cli, configs, progress
from internal.color import from_uint16
from internal.comparison.enhancers import ENHANCERS, VERSION
from internal.comparison.methods import Method
from internal.comparison.scored_run import scored_run
from internal.configs import Config
from internal.errors import UserError
from internal.files import atomic, image_io
from internal.files.listing import flat_pngs
from internal.files.made_folder import Facts, make_folder
from internal.launching.run import Run
from internal.scene import readers
from internal.scene.masks import filled, hatched, read_mask
from internal.scoring import evaluation
from internal.training import run_folder

RECORD = "comparison.json"
DARK = "dark"  # stands for the dark photos in names of folders
PICTURE_FOLDERS = {"unchanged": "dark"}  # others are called as the output is


@dataclasses.dataclass(frozen=True)
class Job:
    """What is to be scored: photos of a scene, or a model trained on them."""

    data_dir: Path
    photos: str  # as in ``Method``
    train: tuple[str, ...]  # as in ``Method``

    def __str__(self) -> str:
        photos = f"{self.photos or DARK} photos of {scene_name(self.data_dir)}"
        return f"{_stems(self.train)} on {photos}" if self.train else photos


@dataclasses.dataclass(frozen=True)
class Result:
    """One row for one scene: mean scores of the test views, and their pictures."""

    folder: str  # of ``PICTURE_FOLDERS``, below the folder of the comparison
    output: str  # as in ``Method``
    trained: bool
    scores: dict[str, float]  # ``evaluation.DEFINITIONS``; empty without truth
    train_minutes: float  # 0 where nothing was trained

    def pictures(self, out: Path, output: str) -> Path:
        """The folder of one output of all views."""
        return out / self.folder / PICTURE_FOLDERS.get(output, output)

    def picture(self, out: Path, output: str, view: str) -> Path:
        """The file of one output of a view, whose name is given without ending."""
        return self.pictures(out, output) / f"{view}.png"


Results = dict[str, dict[str, Result]]  # by scene, then by method


def scene_name(data_dir: Path) -> str:
    """The name of a scene's folder."""
    return data_dir.resolve().name


def open_comparison(
    out: Path, scenes: Sequence[Path], gin_bindings: Sequence[str]
) -> None:
    """Makes the folder, or checks that it holds a comparison with these bindings.

    Scenes and methods may be added to a comparison; bindings would change its rows.

    Raises:
        UserError: it holds another comparison, or two scenes share a name.
    """
    paths = {scene_name(scene): str(scene.resolve()) for scene in scenes}
    if len(paths) < len(scenes):
        raise UserError(f"scenes: two have the same folder name; of {', '.join(paths)}")
    record = out / RECORD
    old = atomic.read_json(record, "compare.py") if record.is_file() else {}
    if old and old["gin_bindings"] != list(gin_bindings):
        raise UserError(
            f"{record}: made with other bindings ({'; '.join(old['gin_bindings'])}); "
            "give the same ones or choose another --out"
        )
    for name, path in old.get("scenes", {}).items():
        if paths.setdefault(name, path) != path:
            raise UserError(f"{record}: scene {name} was {path}; choose another --out")
    atomic.ensure_folder(out)
    content = {"gin_bindings": list(gin_bindings), "scenes": paths}
    atomic.write_text(record, json.dumps(content, indent=2) + "\n")


def scenes_of(out: Path) -> dict[str, Path]:
    """The scenes of a comparison by name.

    Raises:
        UserError: the folder holds no comparison.
    """
    scenes = atomic.read_json(out / RECORD, "compare.py")["scenes"]
    return {name: Path(path) for name, path in scenes.items()}


def job_of(data_dir: Path, method: Method) -> Job:
    """The work that a method needs."""
    return Job(data_dir, method.photos, method.train)


def dark_photos(data_dir: Path) -> Job:
    """The work that leaves input and truth for the figures, whatever the methods."""
    return Job(data_dir, "", ())


def scored_folder(out: Path, job: Job) -> Path:
    """Where the job leaves ``metrics.json`` and its pictures."""
    return _run(out, job) / "eval" if job.train else _place(out, job, "scores")


def settings(job: Job, gin_bindings: Sequence[str]) -> list[str]:
    """The bindings that change something of a job; photos are told where and how to
    read the scene alone."""
    kept = configs.with_effect(job.train, gin_bindings)
    return kept if job.train else [x for x in kept if x.lstrip().startswith("Config.")]


def check_settings(jobs: Sequence[Job], gin_bindings: Sequence[str]) -> None:
    """Refuses bindings that change nothing of any job.

    Raises:
        UserError: names the first one.
    """
    kept = {binding for job in jobs for binding in settings(job, gin_bindings)}
    for binding in gin_bindings:
        if binding not in kept:
            raise UserError(
                f"gin: {binding} has no effect: no method of the list reads it"
            )


def score_photos(out: Path, job: Job, gin_bindings: Sequence[str]) -> None:
    """Does a job without training, or what is missing of it.

    Raises:
        UserError: anything that the user has to fix.
    """
    _score_photos(out, job, _with_photos(out, job, gin_bindings))


def training(out: Path, job: Job, gin_bindings: Sequence[str]) -> Run:
    """What is to be run for a job that trains; its photos are enhanced first.

    Raises:
        UserError: anything that the user has to fix.
    """
    bindings = _with_photos(out, job, gin_bindings)
    return scored_run(str(job), _run(out, job), job.train, bindings)


def _with_photos(out: Path, job: Job, gin_bindings: Sequence[str]) -> list[str]:
    """The bindings of a job with those of its photos, which are there afterwards."""
    data_dir = str(job.data_dir.resolve())
    bindings = [*settings(job, gin_bindings), f"Config.data_dir = {data_dir!r}"]
    images = job.photos
    if images in ENHANCERS:
        images = str(_enhanced_photos(out, job, configs.load_config([], bindings)))
    elif images:  # enhancers call 1.JPG enh_1.png; what the user binds still wins
        bindings.insert(0, "Config.pair_by = 'number'")
    if images:
        bindings.append(f"Config.images_dir = {images!r}")
    return bindings


def is_scored(out: Path, job: Job) -> bool:
    """Whether a job was done, be it with other settings."""
    return (scored_folder(out, job) / "metrics.json").is_file()


def read_results(out: Path, chosen: Mapping[Path, Sequence[Method]]) -> Results:
    """What is done so far of the methods chosen for each scene, in their order."""
    return {
        scene_name(data_dir): {
            method.name: read_result(out, job_of(data_dir, method), method.output)
            for method in methods
            if is_scored(out, job_of(data_dir, method))
        }
        for data_dir, methods in chosen.items()
    }


def read_result(out: Path, job: Job, output: str) -> Result:
    """What a job that is done found of one output."""
    folder = scored_folder(out, job)
    mean = atomic.read_json(folder / "metrics.json", "compare.py")["mean"]
    seconds = run_folder.training_seconds(_run(out, job)) if job.train else 0.0
    return Result(
        folder=folder.relative_to(out).as_posix(),
        output=output,
        trained=bool(job.train),
        scores=mean.get(output, {}),
        train_minutes=seconds / 60.0,
    )


def _place(out: Path, job: Job, kind: str) -> Path:
    name = job.photos.replace("/", "-") or DARK
    return out / scene_name(job.data_dir) / kind / name


def _run(out: Path, job: Job) -> Path:
    photos = _place(out, job, "runs")
    return photos.with_name(f"{_stems(job.train)}@{photos.name}")


def _stems(files: Sequence[str]) -> str:
    return "+".join(Path(file).stem for file in files)


def _enhanced_photos(out: Path, job: Job, config: Config) -> Path:
    """The folder of all views' photos, enhanced on the fly or before."""
    folder = _place(out, job, "photos").resolve()
    scene = str(job.data_dir.resolve())
    settings = {"scene": scene, "enhancer": job.photos, "version": VERSION}

    def fill(partial: Path) -> Facts:
        files = readers.read_files(
            job.data_dir, config.dataset_loader, config.images_dir
        )
        count = len(files.names)
        if len({Path(name).with_suffix("") for name in files.names}) < count:
            raise UserError(
                f"{job.data_dir}: two of its pictures differ only in their ending; "
                "rename one"
            )
        for view in progress.track(range(count), count, job.photos, "photo"):
            inside = Path(files.names[view]).relative_to(Path(files.names[view]).anchor)
            target = (partial / inside).with_suffix(".png")
            target.parent.mkdir(parents=True, exist_ok=True)
            mask = read_mask(files, view)
            srgb = image_io.read_srgb(files.image_paths[view], files.upright)
            enhanced = ENHANCERS[job.photos](filled(srgb, mask))
            image_io.write(target, image_io.with_alpha(enhanced, mask))
        return {"photos": float(count)}

    make_folder(folder, settings, fill, overwrite=False)
    return folder


def _score_photos(out: Path, job: Job, bindings: Sequence[str]) -> None:
    """Scores the photos of the test views, as they are and under each baseline."""
    folder = scored_folder(out, job)
    settings = {"bindings": list(bindings)}

    def fill(partial: Path) -> Facts:
        scene = cli.load_split(configs.load_config([], bindings), "test")
        views: dict[str, evaluation.Scores] = {}
        if not scene.images:
            raise UserError(
                f"{job.data_dir}: its test views have no dark photos to score; "
                "compare methods on a scene that has them"
            )
        names = scene.view_names
        pngs = flat_pngs(names)
        for index, name in enumerate(
            progress.track(names, len(names), "scoring", "photo")
        ):
            photo, mask = from_uint16(scene.images[index]), scene.mask(index)
            shown = evaluation.brightened(photo, mask)
            if index in scene.truth:
                truth = from_uint16(scene.truth[index])
                if mask.any():
                    views[name] = evaluation.score_pictures(shown, truth, mask)
                shown["truth"] = truth
            hidden = {kind: hatched(srgb, mask) for kind, srgb in shown.items()}
            _write_pictures(partial, pngs[index], hidden)
        mean = evaluation.mean_scores(views)
        result = {"masked": scene.masked, "views": views, "mean": mean}
        atomic.write_text(partial / "metrics.json", json.dumps(result, indent=2) + "\n")
        return {"views": float(len(names))}

    make_folder(folder, settings, fill, overwrite=False)


def _write_pictures(folder: Path, name: str, pictures: dict[str, np.ndarray]) -> None:
    for output, picture in pictures.items():
        kind = folder / PICTURE_FOLDERS.get(output, output)
        kind.mkdir(exist_ok=True)
        image_io.write(kind / name, picture)
