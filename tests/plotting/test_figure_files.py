import numpy as np
import pytest

from gmmjax import Fit, FitStatus, InputError
from gmmjax.clouds import PointCloud
from gmmjax.plotting import check_figure_file, fit_figure, overview_figure, write_figure
from tests.plotting.test_mixtures import mixture


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["png", "SVG", "pdf", "jpg"])
def test_a_figure_is_the_same_file_each_time(changes, tmp_path, ending):
    for name in ("a", "b"):
        write_figure(tmp_path / f"{name}.{ending}", overview_figure(changes, changes.clouds, 120))
    first, second = ((tmp_path / f"{name}.{ending}").read_bytes() for name in ("a", "b"))
    assert first == second and first[:4] in (b"\x89PNG", b"<?xm", b"%PDF", b"\xff\xd8\xff\xe0")
    assert len(list(tmp_path.iterdir())) == 2


def test_what_cannot_be_written_is_said_before_the_work(tmp_path):
    for path, message in (
        (tmp_path / "x.xyz", r"no figures with the ending '.xyz'; choose one of .*\.pdf.*\.png.*\.svg"),
        (tmp_path / "none", "ending ''"),
        (tmp_path / "missing" / "x.png", "its folder is missing"),
    ):
        with pytest.raises(InputError, match=message):
            check_figure_file(path)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        check_figure_file(tmp_path / "folder.png")


def test_a_figure_that_fails_leaves_the_old_file(tmp_path):
    class Broken:
        def savefig(self, file, **options):
            file.write(b"half")
            raise OSError(28, "No space left on device")

    (tmp_path / "x.png").write_bytes(b"old")
    with pytest.raises(InputError, match=r"x\.png: cannot be written: No space left on device"):
        write_figure(tmp_path / "x.png", Broken())
    assert (tmp_path / "x.png").read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


def test_a_fit_is_drawn_with_its_gaussians():
    points = np.random.default_rng(0).normal(size=(60, 3))
    numbers = np.array(12.5), np.array(0.0), np.array(1)
    found = Fit(mixture([[0, 0, 0], [1, 0, 0]]), *numbers, FitStatus.converged, np.array(64), np.array(0.0))
    figure = fit_figure(found, PointCloud.from_rows(points, source="a/$x$.ply"), 120)
    assert figure.get_suptitle() == "2 Gaussians, message length 12.5 nats\n$x$.ply"
    figure.canvas.draw()
