"""``lndrl results``: what it shows, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from lndrl.cli.main import run as lndrl
from lndrl.evaluation.benchmark import Identity, ResultsFolder, load_benchmark
from lndrl.evaluation.benchmark.results import Results, page
from lndrl.evaluation.benchmark.trainings import training_of, write_training
from lndrl.view.pictures import rates
from tests.lndrl.evaluation.benchmark.results.rows import record
from tests.lndrl.evaluation.benchmark.trainings.trained import MACHINE, digits, write_run

PLACES = ("hall", "sparse")
METHODS = {"careful": "aaal", "dwa": "acla", "lndrl": "aaaa", "drl_laser": "a"}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Some rows of a bench of two places in results/mine; four episodes of each are all."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "EPISODES", 4)
    bench = load_benchmark()
    found = ResultsFolder(tmp_path / "results/mine")
    names = {name: {"identity": name} for name in METHODS}
    frozen = {place: bench.frozen[place] for place in PLACES}
    found.claim(Identity(0, "0.1", frozen, names, bench_version=bench.version))
    for method, outcomes in METHODS.items():
        for place in PLACES:
            found.keep(method, place, [record(o, k) for k, o in enumerate(outcomes)])
    rows = "dwa: {planner: dwa}\n  careful: {planner: careful}\n  lndrl: {planner: runs/l}\n"
    rows += "  drl_laser: {planner: runs/d}\n  paper: {planner: runs/p}\n"
    frozen_lines = "".join(f"  {place}: {digits}\n" for place, digits in frozen.items())
    Path("bench.yaml").write_text(
        f"version: {bench.version}\nscenarios: [hall, sparse]\nfrozen:\n{frozen_lines}"
        f"kernel_revision: {bench.kernel_revision}\nmethods:\n  {rows}"
    )
    return found.path


HERE = ["results", "--from", "results/mine", "--spec", "bench.yaml"]


def figures(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert lndrl([*HERE, "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out)


def test_rows_come_in_the_order_of_the_bench(capsys: pytest.CaptureFixture[str]) -> None:
    found = figures(capsys)
    assert [row["method"] for row in found["rows"]] == ["dwa", "careful", "lndrl", "drl_laser"]
    assert found["rows"][0]["paper"]["ar"] == 0.631 and found["rows"][1]["paper"] is None
    assert found["rows"][0]["mean_intervals"]["position_error"] == [10.0, 10.0]
    assert [(row["method"], row["scenarios"]) for row in found["by_scenario"]][:2] == [
        ("dwa", ["hall"]), ("dwa", ["sparse"]),
    ]  # fmt: skip


def test_ours_is_compared_with_all_others(capsys: pytest.CaptureFixture[str]) -> None:
    found = figures(capsys)
    assert found["reference"] == found["goals"]["method"] == "lndrl"
    paired = {each["method"]: each for each in found["paired"]}
    assert list(paired) == ["dwa", "careful", "drl_laser"]
    assert paired["dwa"]["arrived"]["difference"] == 0.5
    assert paired["dwa"]["lost"]["only_second"] == 2
    assert paired["drl_laser"]["episodes"] == 2


def test_rows_that_are_not_there_or_not_whole_are_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = figures(capsys)
    assert found["missing"] == ["paper"]
    assert found["notes"] == [
        "Not tested yet, and left out: paper.",
        "Of 8 episodes drl_laser has 2; the goals take such rows as not there yet.",
    ]
    verdicts = [each["verdict"] for each in found["goals"]["verdicts"]]
    assert verdicts == ["met"] * 3 + ["not there yet", "met", "not there yet"]


def test_without_ours_the_first_row_is_the_reference_and_no_goal_is_judged(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = figures(capsys, "--methods", "careful,dwa")
    assert found["reference"] == "careful" and found["goals"]["method"] == "lndrl"
    assert {each["verdict"] for each in found["goals"]["verdicts"]} == {"not there yet"}
    assert found["notes"] == ["The goals are for lndrl, which is not there yet."]
    found = figures(capsys, "--reference", "dwa", "--methods", "careful")
    assert [row["method"] for row in found["rows"]] == ["careful", "dwa"]
    assert found["goals"]["verdicts"][0]["verdict"] == "not met"


def test_what_is_seen_of_a_row_that_is_not_whole_decides_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    first = figures(capsys, "--reference", "drl_laser")["goals"]["verdicts"][0]
    assert (first["seen"], first["verdict"]) == ("1.0000", "not there yet")


def test_a_row_that_is_not_whole_decides_for_no_other(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in PLACES:
        ResultsFolder(folder).keep("dwa", place, [record("a"), record("l", 1)])
    ratio = figures(capsys)["goals"]["verdicts"][4]
    assert (ratio["seen"], ratio["verdict"]) == ("1.0000; no dwa yet", "not there yet")


def test_tables_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert lndrl(HERE) == 0
    out = capsys.readouterr().out
    for words in ("0.500", "published", "50.0 / 25.0 / 25.0 / 0.0", "4 : 0", "not there yet"):
        assert words in out
    assert out.splitlines()[-2].startswith("Of 8 episodes drl_laser has 2")


def test_a_document_is_written_between_its_marks(capsys: pytest.CaptureFixture[str]) -> None:
    document = Path("page.md")
    document.write_text("# Page\n\n<!-- results mine -->\nold\n<!-- end -->\n\nAfter.\n")
    for _ in range(2):
        assert lndrl([*HERE, "--markdown", "page.md"]) == 0
    text = document.read_text()
    assert text.startswith("# Page\n\n<!-- results mine -->\n\nVersion ")
    assert text.endswith("<!-- end -->\n\nAfter.\n") and "old" not in text
    assert "| dwa | 8 | 0.500 (0.215–0.785) |" in text
    assert "| _published_ | 2,500 | 0.631 |" in text
    assert "| dwa | 8 | +50.0 (" in text


def test_a_picture_has_the_rows_that_are_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn: list[str] = []
    draw = rates.results_figure

    def watched(results: Results) -> Figure:
        drawn.extend(row.method for row in results.rows)
        return draw(results)

    monkeypatch.setattr(rates, "results_figure", watched)
    assert lndrl([*HERE, "--methods", "lndrl,dwa", "--picture", "rates.png"]) == 0
    assert drawn == ["lndrl", "dwa"]
    assert "rates.png" in capsys.readouterr().out.splitlines()
    assert Path("rates.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--picture", "rates.txt"], "--picture rates.txt: must end in .png"),
        (["--picture", "nowhere/rates.png"], "--picture nowhere/rates.png: folder nowhere does"),
        (["--from", "nowhere"], "nowhere: holds no results of lndrl benchmark"),
        (["--reference", "paper"], "--reference paper: results/mine has no episode of it; it has"),
        (["--reference", "lndr"], "method 'lndr' is unknown; did you mean lndrl"),
        (["--methods", "dwaa"], "did you mean dwa"),
        (["--methods", "paper"], "holds no finished episode of what was asked for"),
        (["--markdown", "page.txt"], "--markdown page.txt: must end in .md"),
        (["--markdown", "away/page.md"], "the folder away does not exist"),
        (["--markdown", "full.md"], "full.md: has no place for the results; put the lines <!-- re"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("full.md").write_text("words\n")
    assert lndrl([*HERE, *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error and len(error.splitlines()) == 1
    assert Path("full.md").read_text() == "words\n"


def test_how_rows_were_trained_is_a_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert figures(capsys)["trainings"] == []
    training = training_of(write_run(Path("runs/l")), digits("best"))
    assert training is not None
    write_training(folder, training)
    identity = Identity.read(folder / "benchmark.json")
    sampled = {"actions": "sampled"}
    lndrls = {"planner": "runs/l", "identity": f"{digits('best')} at 0.25"}
    identity.methods["lndrl"] = sampled | lndrls
    identity.methods["drl_laser"] = sampled | {"planner": "runs/d", "identity": digits("gone")}
    identity.write(folder / "benchmark.json")
    found = figures(capsys)
    [told] = found["trainings"]
    assert told["methods"] == ["lndrl"] and told["steps"] == 500 and told["machine"] == MACHINE
    assert "How they were trained is not kept there: drl_laser." in found["notes"]
    assert lndrl([*HERE, "--markdown", "page.md"]) == 0
    row = f"| lndrl | 7 | 500 | 5 | 200 | 0.750 (4 episodes) | {MACHINE} |"
    assert row in Path("page.md").read_text("utf-8")
    capsys.readouterr()
    assert lndrl(["report", "results/mine", "--spec", "bench.yaml", "--out", "page.html"]) == 0
    html = Path("page.html").read_text("utf-8")
    assert "the last of each: lndrl 25.0 %, 25.0 %, 50.0 %." in html
    assert "How the rows were trained" in html and "0.750 (4 episodes)" in html


def test_rows_under_other_seeds_are_taken_together(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = Path("bench.yaml")
    second = "  lndrl-two: {planner: runs/l2, config: lndrl, seed: 2}\n"
    bench.write_text(bench.read_text() + second)
    assert figures(capsys)["repeated"] == []  # it is not tested yet
    identity = Identity.read(folder / "benchmark.json")
    identity.methods["lndrl-two"] = {"identity": "two"}
    identity.write(folder / "benchmark.json")
    kept = ResultsFolder(folder)
    for place in PLACES:
        kept.keep("lndrl-two", place, [record(o, k) for k, o in enumerate("aal")])
    assert figures(capsys)["repeated"] == []  # nor here, as far as it shall be
    for place in PLACES:
        kept.keep("lndrl-two", place, [record(o, k) for k, o in enumerate("aall")])
    [told] = figures(capsys)["repeated"]
    assert told["methods"] == ["lndrl", "lndrl-two"]
    assert told["arrived"]["mean"] == 0.75 and told["lost"]["mean"] == 0.25
    # Two rates, 1 and 0.5: their deviation is half the root of one half.
    assert told["arrived"]["chance"] == pytest.approx(12.7062 * 0.5, abs=1e-3)
    Path("page.md").write_text("<!-- results mine -->\n<!-- end -->\n")
    assert lndrl([*HERE, "--markdown", "page.md"]) == 0
    row = "| lndrl, lndrl-two | 0.750 (0.000–1.000) | 100.0 | 0.000 (0.000–0.000) | 0.0 |"
    assert row in Path("page.md").read_text("utf-8")
    capsys.readouterr()
    assert lndrl(["report", "results/mine", "--spec", "bench.yaml", "--out", "page.html"]) == 0
    html = Path("page.html").read_text("utf-8")
    assert "What chance is worth in training" in html and "chance (arrived)" in html
