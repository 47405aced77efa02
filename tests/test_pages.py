"""Every command and block of code of the README and the documentation is run, and every link leads somewhere."""

import ast
import contextlib
import hashlib
import io
import os
import re
import shutil
from pathlib import Path

import jax
import numpy as np
import pytest
from PIL import Image

from gmmjax import read_cloud
from gmmjax.cli import main
from gmmjax.clouds import write_ply, write_views
from gmmjax.evaluation import read_pair
from gmmjax.scenes import StorehouseSettings, random_scene, storehouse
from gmmjax.surveys import write_bag
from gmmjax.thesis.laboratory import recorded_run
from tests.pages import PAGES, REASONS, ROOT, anchors, bind_arguments, blocks, gmmjax_words, steps

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
        scene = storehouse(0, StorehouseSettings(points=3000, rays=4000)).scene
        for side, points, views in zip(("before", "after"), scene.clouds, scene.views, strict=True):
            write_ply(folder / f"{side}.ply", points)
            write_views(folder / f"{side}_views.json", views)

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


class Commands:
    """Runs commands of the pages; what several pages do with the same files is done once, and copied after that."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.written: dict[tuple[str, ...], Path] = {}

    def run(self, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
        """Run a command, which finds no output of an earlier one in its way."""
        outputs = self.outputs(words)
        for path in outputs:
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        given = [hashlib.sha256(Path(word).read_bytes()).hexdigest() for word in words if Path(word).is_file()]
        key = (*(word for word in words if word != "--overwrite"), *given)
        if key not in self.written:
            capsys.readouterr()
            assert main(words) == 0, capsys.readouterr().err
            self.written[key] = self.keep(outputs)
        shutil.copytree(self.written[key], ".", dirs_exist_ok=True)

    def outputs(self, words: list[str]) -> list[Path]:
        """The files and folders that a command may write."""
        if "--out" not in words:
            return [Path("gmmjax-demo")] if words == ["demo"] else []
        out = Path(words[words.index("--out") + 1])
        return [out, out.with_name(f"{out.stem}_views.json")]

    def keep(self, outputs: list[Path]) -> Path:
        """A new folder with copies of what was written."""
        folder = self.folder / str(len(self.written))
        folder.mkdir()
        for path in outputs:
            if path.is_dir():
                shutil.copytree(path, folder / path)
            elif path.exists():
                shutil.copy(path, folder / path)
        return folder


@pytest.fixture(scope="module")
def demonstration(tmp_path_factory):
    """The folder of `gmmjax demo` and what it printed; of `.ci/run`, which has run it as users do, where that is."""
    made = Path(os.environ.get("GMMJAX_DEMO", tmp_path_factory.mktemp("demo") / "gmmjax-demo"))
    if made.exists():
        return made, made.with_suffix(".txt").read_text(encoding="utf-8")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(["demo", "--out", str(made)]) == 0
    return made, printed.getvalue()


@pytest.fixture(scope="module")
def commands(tmp_path_factory, demonstration):
    found = Commands(tmp_path_factory.mktemp("commands"))
    shutil.copytree(demonstration[0], found.folder / "demo" / "gmmjax-demo")
    found.written["demo",] = found.folder / "demo"
    return found


def given_names(page: str, supplies: Supplies, folder: Path) -> dict[str, object]:
    """What the text around a page's Python code says that the reader has."""
    if page == "batch.md":
        return {"nights": ["night1", "night2", "night3"]}
    if page == "python-api.md":
        supplies.given("before.ply", folder)
        return {side: read_cloud(folder / f"{side}.ply").points for side in ("before", "after")}
    return {}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_blocks_that_are_not_run_say_why(page):
    for block in blocks(page):
        if block.language in ("sh", "python"):
            assert block.reason is None or block.reason in REASONS, block.text


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_blocks_of_a_page_run_one_after_the_other(
    page, supplies, commands, tmp_path, monkeypatch, capsys, no_workers
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    # tests/test_readme.py runs the Python code of the README, in a process of its own.
    languages = ("sh",) if page.name == "README.md" else ("sh", "python")
    run = [block for block in blocks(page) if block.reason is None and block.language in languages]
    text = " ".join(block.text for block in run)
    if "result/labels.npz" in text:
        supplies.given("before.ply", tmp_path)
        commands.run(["detect", "before.ply", "after.ply", "--out", "result"], capsys)
    supplies.given(text, tmp_path)
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
            commands.run(arguments, capsys)


@pytest.mark.slow
def test_the_demo_compares_what_was_found_with_the_truth_and_keeps_the_scans(demonstration):
    folder, printed = demonstration
    assert printed.startswith("6 changes: 2 appeared, 2 disappeared, 2 moved\n")
    assert "not found" not in printed
    assert "No false changes." in printed
    assert (folder / "result" / "report.html").as_uri() in printed.replace("\n", "")
    pair = read_pair(folder / "scene")
    assert pair.after.views is not None and set(pair.after.truth) == {-1, 0, 1, 4, 5}
    assert read_cloud(folder / "scene" / "after.ply").colors is not None


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_that_are_not_run_can_be_parsed(page):
    for block in blocks(page):
        if block.language == "sh" and block.reason not in (None, "synopsis", "of the repository"):
            for words in steps(block):
                if (arguments := gmmjax_words(words)) is not None:
                    bind_arguments(arguments)


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
