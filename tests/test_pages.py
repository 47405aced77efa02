"""Every command and block of code of the README and the documentation is run, and every link leads somewhere."""

import ast
import inspect
import re
import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import jax
import numpy as np
import pytest
from PIL import Image

from gmmjax import read_cloud
from gmmjax.cli import main
from gmmjax.cli.application import COMMANDS
from gmmjax.cli.options import parsed
from gmmjax.clouds import write_ply, write_views
from gmmjax.scenes import StorehouseSettings, random_scene, storehouse
from gmmjax.surveys import write_bag
from gmmjax.thesis.laboratory import recorded_run
from tests.pages import PAGES, REASONS, ROOT, anchors, blocks, gmmjax_words, steps

NAMES = [page.name for page in PAGES]


class Supplies:
    """The files that the pages speak of as the reader's own; each is made once."""

    def __init__(self, folder: Path):
        self.folder = folder
        # Of those that are made together, another name.
        self.also = {"before.ply": "after.ply", "monday.bag": "run.bag"}
        self.makers = {
            "before.ply": self.scans,
            "monday.bag": self.bags,
            "depth.png": self.depth_image,
            "pairs.csv": self.pairs,
            "epochs.csv": self.epochs,
            "result/labels.npz": self.result,
        }

    def given(self, text: str, folder: Path) -> None:
        """Copies into a folder what a text needs."""
        for name, make in self.makers.items():
            if name in text or self.also.get(name, name) in text:
                source = self.folder / name.replace("/", "_")
                if not source.exists():
                    source.mkdir(parents=True)
                    make(source)
                shutil.copytree(source, folder, dirs_exist_ok=True)

    def scans(self, folder: Path) -> None:
        scene = storehouse(0, StorehouseSettings(points=8000, rays=10_000)).scene
        for side, points, views in zip(("before", "after"), scene.clouds, scene.views, strict=True):
            write_ply(folder / f"{side}.ply", points)
            write_views(folder / f"{side}_views.json", views)

    def result(self, folder: Path) -> None:
        self.scans(folder)
        scans = [str(folder / f"{side}.ply") for side in ("before", "after")]
        assert main(["detect", *scans, "--out", str(folder / "result"), "--quiet"]) == 0

    def bags(self, folder: Path) -> None:
        for name, run in (("monday", "run5"), ("friday", "run1")):
            survey = recorded_run(run, seed=1, frames=4)
            write_bag(folder / f"{name}.bag", survey.frames, survey.localised, sensor_on_body=survey.sensor_on_body)
        shutil.copy(folder / "friday.bag", folder / "run.bag")

    def depth_image(self, folder: Path) -> None:
        depths = 1500 + 200 * np.sin(np.arange(64) / 7) + np.zeros((48, 1))
        Image.fromarray(depths.astype(np.uint16)).save(folder / "depth.png")
        (folder / "camera.json").write_text('{"fx": 60, "fy": 60, "cx": 32, "cy": 24, "width": 64, "height": 48}')

    def pairs(self, folder: Path) -> None:
        self._clouds(folder, ("first", "second"))
        (folder / "pairs.csv").write_text("name,before,after,restarts\nhall,first.ply,second.ply,2\n")

    def epochs(self, folder: Path) -> None:
        nights = ("night1", "night2", "night3")
        self._clouds(folder, nights)
        rows = "".join(f"{night},{night}.ply,2\n" for night in nights)
        (folder / "epochs.csv").write_text(f"name,cloud,restarts\n{rows}")

    def _clouds(self, folder: Path, names: tuple[str, ...]) -> None:
        scene = random_scene(jax.random.key(0), start=3, appeared=1, disappeared=0, points=100)
        for index, name in enumerate(names):
            write_ply(folder / f"{name}.ply", scene.before if index % 2 == 0 else scene.after)


@pytest.fixture(scope="module")
def supplies(tmp_path_factory):
    return Supplies(tmp_path_factory.mktemp("supplies"))


class Demonstration:
    """What `gmmjax demo` wrote, and the commands that were run on it: each once, although several pages have them."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.done: set[tuple[str, ...]] = set()

    def needs(self, words: list[str]) -> bool:
        """Whether a command is still to be run; the scene is given to the pages that it is not run for."""
        if words[:1] == ["demo"] and self.folder.exists():
            shutil.copytree(self.folder, "gmmjax-demo", dirs_exist_ok=True)
            return False
        return tuple(words) not in self.done

    def keep(self, words: list[str]) -> None:
        """Notes that a command was run, if it is one on the demo's files."""
        if words[:1] == ["demo"]:
            shutil.copytree("gmmjax-demo", self.folder)
        elif any(word.startswith("gmmjax-demo/") for word in words):
            self.done.add(tuple(words))


@pytest.fixture(scope="module")
def demonstration(tmp_path_factory):
    return Demonstration(tmp_path_factory.mktemp("demo") / "gmmjax-demo")


def given_names(page: str, supplies: Supplies, folder: Path) -> dict[str, object]:
    """What the text around a page's Python code says that the reader has."""
    if page == "batch.md":
        return {"nights": ["night1", "night2", "night3"]}
    if page == "python-api.md":
        supplies.given("before.ply", folder)
        return {side: read_cloud(folder / f"{side}.ply").points for side in ("before", "after")}
    return {}


def run_gmmjax(words: list[str], demonstration: Demonstration, capsys: pytest.CaptureFixture[str]) -> None:
    """Runs a command, which finds no output of an earlier one in its way."""
    if not demonstration.needs(words):
        return
    if "--out" in words:
        out = Path(words[words.index("--out") + 1])
        for written in (out, out.with_name(f"{out.stem}_views.json")):
            shutil.rmtree(written) if written.is_dir() else written.unlink(missing_ok=True)
    capsys.readouterr()
    assert main(words) == 0, capsys.readouterr().err
    demonstration.keep(words)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_blocks_that_are_not_run_say_why(page):
    for block in blocks(page):
        if block.language in ("sh", "python"):
            assert block.reason is None or block.reason in REASONS, block.text


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_blocks_of_a_page_run_one_after_the_other(page, supplies, demonstration, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    # tests/test_readme.py runs the Python code of the README, in a process of its own.
    languages = ("sh",) if page.name == "README.md" else ("sh", "python")
    run = [block for block in blocks(page) if block.reason is None and block.language in languages]
    supplies.given(" ".join(block.text for block in run), tmp_path)
    variables = {"__name__": "__main__"} | (given_names(page.name, supplies, tmp_path) if run else {})
    for block in run:
        if block.language == "python":
            # As for users: optax promotes types.
            with jax.numpy_dtype_promotion("standard"):
                exec(compile(block.text, page.name, "exec"), variables)
            continue
        for words in steps(block):
            arguments = gmmjax_words(words)
            assert arguments is not None, f"{' '.join(words)}: only gmmjax is run; say why this is not"
            run_gmmjax(arguments, demonstration, capsys)


def command_of(words: list[str]) -> tuple[Callable[..., int], list[str]]:
    """The function of a command, and its own words."""
    name = next(command for command in COMMANDS if " ".join(words).startswith(command))
    module = import_module(f"gmmjax.cli.{COMMANDS[name][0]}")
    return getattr(module, name.replace(" ", "_")), words[len(name.split()) :]


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_that_are_not_run_can_be_parsed(page):
    for block in blocks(page):
        if block.language == "sh" and block.reason not in (None, "synopsis", "of the repository"):
            for words in steps(block):
                if (arguments := gmmjax_words(words)) is not None:
                    command, own = command_of(arguments)
                    inspect.signature(command).bind(**parsed(command, own))


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_code_that_is_not_run_imports_what_is_there(page):
    for block in blocks(page):
        if block.language == "python" and block.reason is not None:
            imports = [line for line in ast.parse(block.text).body if isinstance(line, (ast.Import, ast.ImportFrom))]
            assert imports
            exec(compile(ast.Module(imports, []), page.name, "exec"), {})


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_to_files_and_headings(page):
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            assert re.fullmatch(r"https://[\w.-]+(/\S*)?", target), target
            continue
        file, _, anchor = target.partition("#")
        path = page.parent / file if file else page
        assert path.exists(), target
        if anchor:
            assert anchor in anchors(path), target


def test_every_picture_is_shown_somewhere():
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    unused = [path.name for path in (ROOT / "docs" / "images").iterdir() if f"images/{path.name})" not in text]
    assert unused == []


def test_the_navigation_has_every_page():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    assert set(re.findall(r"[\w-]+\.md", navigation)) == {page.name for page in PAGES[2:]}
