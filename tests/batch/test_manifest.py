import pytest

from gmmjax.batch import pairs_in_folders, read_epochs, read_manifest
from gmmjax.changes import DetectionConfig
from gmmjax.errors import InputError

TABLES = (("m.csv", ","), ("m.tsv", "\t"))


@pytest.fixture
def folder(tmp_path):
    """A folder with files of the names that manifests may name; nobody reads them."""
    for name in ("a.ply", "b.ply", "c.ply", "v.json"):
        (tmp_path / name).write_text("something")
    return tmp_path


def write(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_with_views_and_settings(folder):
    path = write(
        folder,
        "m.csv",
        "name,before,after,views_before,restarts,evidence,crop,tolerance\n"
        "hall 1,a.ply,b.ply,v.json,16,false,0 0 0 1 1 1,0.5\n"
        "hall 2,b.ply,c.ply,,,,,\n",
    )
    first, second = read_manifest(path, DetectionConfig(seed=3))
    assert first.files() == {"before": folder / "a.ply", "after": folder / "b.ply", "views_before": folder / "v.json"}
    assert first.config == DetectionConfig(
        seed=3, restarts=16, evidence=False, crop=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0), tolerance=0.5
    )
    assert (second.name, second.config, second.views_before) == ("hall 2", None, None)


def test_tabs_and_commas_say_the_same(folder):
    text = "name,before,after,method\nx,a.ply,b.ply,transport\n"
    (one,), (other,) = (read_manifest(write(folder, name, text.replace(",", comma))) for name, comma in TABLES)
    assert (one.name, one.files(), one.config) == (other.name, other.files(), other.config)
    assert one.config == DetectionConfig(method="transport")


def test_a_file_of_settings_and_a_column_that_wins_over_it(folder):
    write(folder, "own.toml", 'restarts = 5\nseed = 2\nverdict = "v.json"\n')
    path = write(folder, "m.csv", "name,before,after,config,seed\nx,a.ply,b.ply,own.toml,7\n")
    (pair,) = read_manifest(path)
    assert pair.config == DetectionConfig(restarts=5, seed=7, verdict=str(folder / "v.json"))


def test_paths_are_relative_to_the_manifest(folder, monkeypatch, tmp_path_factory):
    path = write(folder, "m.csv", "name,before,after\nx,a.ply,b.ply\n")
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    (pair,) = read_manifest(path)
    assert pair.files()["before"].is_file()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("name,before,after\n", "has no lines with pairs"),
        ("name,before\nx,a.ply\n", r"line 2: has no after; every line needs name, before, after"),
        ("name,before,after\nx,a.ply,\n", r"line 2: has no after"),
        ("name,before,after,colour\nx,a.ply,b.ply,red\n", r"line 2: unknown column 'colour'; known are after, before"),
        ("name,before,after\nx,a.ply,b.ply,c.ply\n", r"line 2: has more values than there are columns"),
        ("name,name,after\nx,a.ply,b.ply\n", "two columns have one name"),
        ("name,before,after\nx,a.ply,b.ply\nX,a.ply,b.ply\n", r"names that are there more than once: 'x'; give"),
        ("name,before,after\n../x,a.ply,b.ply\n", r"name='../x' must not have slashes"),
        ("name,before,after\n..,a.ply,b.ply\n", r"name='..' must not start or end with a dot"),
        ("name,before,after\na\x1bb,a.ply,b.ply\n", r"must not have slashes or control characters"),
        ("name,before,after\n.hidden,a.ply,b.ply\n", r"must not start or end with a dot"),
        ("name,before,after\n" + "x" * 151 + ",a.ply,b.ply\n", r"has more than 150 bytes"),
        (
            "name,before,after\nx,a.ply,no.ply\ny,b.ply,nope.ply\n",
            r"2 of its 4 files do not exist: .*nope.ply",
        ),
        ("name,before,after,restarts\nx,a.ply,b.ply,many\n", r"line 2: restarts='many' must be a whole number"),
        ("name,before,after,crop\nx,a.ply,b.ply,0 0 1\n", r"line 2: crop=\(0.0, 0.0, 1.0\) must be six finite numbers"),
        ("name,before,after,config\nx,a.ply,b.ply,no.toml\n", r"line 2: .*no.toml: no such file"),
        ('name,before,after\n"x,a.ply,b.ply\n', "is no table"),
    ],
)
def test_what_is_wrong_with_a_table(as_users, folder, text, says):
    with pytest.raises(InputError, match=says) as caught:
        read_manifest(write(folder, "m.csv", text))
    assert "m.csv" in str(caught.value)


def test_all_that_is_wrong_is_said_at_once(as_users, folder):
    """Up to ten, what is wrong in many lines once, and the files that are not there."""
    rows = "x,a.ply,b.ply,2\n,a.ply,b.ply,2\ny,a.ply,no.ply,2\nX,a.ply,b.ply,many\nz,,b.ply,2\n,a.ply,b.ply,2\n"
    path = write(folder, "m.csv", f"name,before,after,restarts\n{rows}")
    with pytest.raises(InputError) as caught:
        read_manifest(path)
    told = str(caught.value).removeprefix(f"{path}: ").split("; ")
    assert told[0].startswith("4 errors: line 3: has no name")
    assert told[1].endswith("(the same in 1 more)")
    assert told[2].startswith("line 5: restarts='many' must be a whole number")
    assert told[3].startswith("line 6: has no before") and told[5].startswith("1 of its 4 files do not exist: y: after")
    path.write_text("name,before,after,restarts\n" + "".join(f"x,a.ply,b.ply,{'a' * n}\n" for n in range(1, 14)))
    with pytest.raises(InputError, match=r"13 errors: line 2: restarts='a'.* line 11: .*; and 3 more$"):
        read_manifest(path)


def test_the_ending_says_the_format(folder):
    with pytest.raises(InputError, match=r"m\.txt: is no manifest by its ending; name it \.csv"):
        read_manifest(write(folder, "m.txt", "name,before,after\n"))


def test_names_that_only_look_bad_are_names(folder):
    names = ["<b>bold", "50 % & more", 'say "x"', "Büro 東京", "a.b", "#1?", "a;b,c"]
    lines = [f'"{name.replace(chr(34), 2 * chr(34))}",a.ply,b.ply\n' for name in names]
    path = write(folder, "m.csv", "".join(["name,before,after\n", *lines]))
    assert [pair.name for pair in read_manifest(path)] == names


def test_folders_with_a_pair_each(tmp_path):
    for name in ("monday", "tuesday"):
        place = tmp_path / name
        place.mkdir()
        for file in ("before.ply", "after.LAZ", "before_views.json", "truth_before.npy", "notes.txt"):
            (place / file).write_text("something")
    pairs = pairs_in_folders(f"{tmp_path}/*/")
    assert [pair.name for pair in pairs] == ["monday", "tuesday"]
    place = tmp_path / "monday"
    assert pairs[0].files() == {
        "before": place / "before.ply",
        "after": place / "after.LAZ",
        "views_before": place / "before_views.json",
    }


def test_folders_without_a_pair(tmp_path):
    with pytest.raises(InputError, match="matches no folder; quote it"):
        pairs_in_folders(f"{tmp_path}/*/")
    (tmp_path / "monday").mkdir()
    with pytest.raises(InputError, match=r"monday: has no before\.ply"):
        pairs_in_folders(f"{tmp_path}/*/")
    for file in ("before.ply", "before.pcd"):
        (tmp_path / "monday" / file).write_text("something")
    with pytest.raises(InputError, match=r"monday: has several clouds before\.pcd, before\.ply; leave"):
        pairs_in_folders(f"{tmp_path}/*/")


def test_epochs(folder):
    path = write(folder, "m.csv", "name,cloud,views,restarts\nMonday,a.ply,v.json,\nTuesday,b.ply,,4\n")
    monday, tuesday = read_epochs(path)
    assert (monday.cloud, monday.views, monday.config) == (folder / "a.ply", folder / "v.json", None)
    assert tuesday.config == DetectionConfig(restarts=4)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name,cloud\nMonday,a.ply\n", "a single epoch"),
        ("name,before,after\nx,a.ply,b.ply\n", "line 2: has no cloud"),
        ("name,cloud\nMonday,a.ply\nTuesday,no.ply\n", "1 of its 2 files do not exist: Tuesday: cloud"),
        ("name,cloud\n" + "x" * 80 + ",a.ply\nTuesday,b.ply\n", "is too long"),
    ],
)
def test_what_is_wrong_with_epochs(folder, text, says):
    with pytest.raises(InputError, match=says):
        read_epochs(write(folder, "m.csv", text))
