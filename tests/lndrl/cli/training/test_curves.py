"""``lndrl curves``: one run as ever, several together."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lndrl.cli.main import run as lndrl
from lndrl.curve import read_curve
from lndrl.evaluation.benchmark.trainings import training_of, write_training
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.transport.messages import COUNTS
from lndrl.view.pictures.learning.curves import save_curves, write_csv, write_validated
from tests.lndrl.evaluation.benchmark.trainings import trained


def write_run(folder: Path, updates: int, validated: bool) -> None:
    rows = [
        {"update": i, "steps": 100 * i, "episodes": {"count": 4, "arrived": 0.25, "lost": 0.5}}
        for i in range(1, updates + 1)
    ]
    counts = {**dict.fromkeys(COUNTS, 0), "episodes": 4, "arrived": 2, "lost": 2}
    mark = {"version": 1, "steps": 200, "unix": 1, "under": "", "sampled": counts, "greedy": counts}
    lines = [json.dumps(row) for row in rows] + [json.dumps({"validation": mark})] * validated
    folder.mkdir(parents=True)
    (folder / "metrics.jsonl").write_text("\n".join(lines) + "\n")


@pytest.fixture(autouse=True)
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_run(Path("runs/a"), 12, True)
    write_run(Path("runs/b"), 7, False)
    Path("empty").mkdir()


def test_one_run_is_drawn_and_told_as_ever(capsys: pytest.CaptureFixture[str]) -> None:
    assert lndrl(["curves", "runs/a"]) == 0
    assert capsys.readouterr().out == (
        "runs/a/curves.png and runs/a/curves.csv: 12 updates, 1 validated version in "
        "curves-validated.csv\nnext: lndrl report runs/a  # all of it as one page\n"
    )
    rows, curve = read_metrics("runs/a/metrics.jsonl"), read_curve(Path("runs/a/metrics.jsonl"))
    save_curves(rows, "own.png", "a: 1,200 steps", validated=curve)
    write_csv(rows, "own.csv")
    write_validated(curve, "own-validated.csv")
    for ending in (".png", ".csv", "-validated.csv"):
        drawn = Path(f"runs/a/curves{ending}").read_bytes()
        assert drawn == Path(f"own{ending}").read_bytes(), ending
    assert lndrl(["curves", "runs/b", "--out", "b"]) == 0
    assert capsys.readouterr().out.startswith("b.png and b.csv: 7 updates\nnext: ")


def test_several_runs_are_one_picture_and_one_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert lndrl(["curves", "runs/a", "runs/b", "runs/a", "--out", "both"]) == 0
    told = "both.png and both.csv: 2 runs, 19 updates, 1 validated version\n"
    told += "next: lndrl runs compare runs/a runs/b  # in what they differ\n"
    assert capsys.readouterr().out == told
    assert sorted(path.name for path in Path().iterdir()) == [
        "both.csv",
        "both.png",
        "empty",
        "runs",
    ]
    assert Path("both.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["runs/a", "runs/c", "--out", "x"], "runs/c: no such run folder"),
        (["runs/a", "runs/b"], "--out: say where the curves of 2 runs go, e.g. --out curves"),
        (["runs/a", "empty", "--out", "x"], "empty/metrics.jsonl: no such file"),
        (["runs/a", "runs/b", "--out", "away/x"], "--out away/x: cannot be written (No such file"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert lndrl(["curves", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error and len(error.splitlines()) == 1


def test_a_folder_of_results_shows_the_trainings_that_it_keeps(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("packed").mkdir()
    Path("packed/benchmark.json").touch()
    assert lndrl(["curves", "packed", "--out", "all"]) == 2
    assert "packed: keeps no training; lndrl benchmark --pack" in capsys.readouterr().err
    for name in ("one", "two"):
        training = training_of(trained.write_run(Path("runs", name)), trained.digits("best"))
        assert training is not None
        write_training(Path("packed"), training)
    assert lndrl(["curves", "packed"]) == 2
    assert "--out: say where the curves of all its runs go" in capsys.readouterr().err
    assert lndrl(["curves", "packed", "--out", "all"]) == 0
    told = "all.png and all.csv: 2 runs, 10 updates, 6 validated versions\n"
    told += "next: lndrl results --from packed  # what the policies were worth\n"
    assert capsys.readouterr().out == told
    assert lndrl(["curves", "packed", "runs/a", "--out", "more"]) == 0
    assert capsys.readouterr().out.startswith("more.png and more.csv: 3 runs, 22 updates")
    names = [line.partition(",")[0] for line in Path("more.csv").read_text().splitlines()[1:]]
    assert list(dict.fromkeys(names)) == ["one", "two", "a"]
    # Runs of one name in several folders are told apart.
    assert lndrl(["curves", "packed", "runs/one", "--out", "more"]) == 0
    names = [line.partition(",")[0] for line in Path("more.csv").read_text().splitlines()[1:]]
    assert list(dict.fromkeys(names)) == ["packed: one", "packed: two", "one"]
