"""``lndrl report``: a small run and the program's own results as pages, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from lndrl.cli.main import run as lndrl
from lndrl.machine.threads import kept_threads
from tests.lndrl.cli.reporting.chromium import AXE, CHROMIUM, look
from tests.lndrl.cli.reporting.html_page import HTMLPage
from tests.small import small_run

V2 = Path(__file__).resolve().parents[4] / "docs" / "results" / "v2"
SMALL = small_run(steps=192, time_limit=8.0, validation_episodes=3)
CHAPTERS = [
    "How it stands",
    "Learning curves",
    "Validation",
    "Episodes driven",
    "Trajectories",
    "Why it gets lost",
    "What the network sees",
    "Failure gallery",
    "Configuration",
    "What became of every sample",
    "Machine and versions",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a run that was trained for a moment, its page, and that of the program's results."""
    folder = tmp_path_factory.mktemp("report")
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    with pytest.MonkeyPatch.context() as patch, kept_threads():
        patch.chdir(folder)
        assert lndrl(["train", "small.yaml", "--serial", "--run", "tiny"]) == 0
        drive = ["--episodes", "4", "--worst", "2", "--workers", "0"]
        assert lndrl(["report", "runs/tiny", *drive]) == 0
        results = ["--reference", "dwa", "--worst", "2", "--out", "v2.html"]
        assert lndrl(["report", str(V2), *results]) == 0
    return folder


@pytest.fixture(autouse=True)
def here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def test_the_page_of_a_run_has_all_chapters_and_no_fault() -> None:
    page = HTMLPage(Path("runs/tiny/report.html"))
    assert page.faults() == []
    assert page.titles == CHAPTERS
    assert len(page.of("svg")) >= 6 and len(page.of("img")) == 4 + 1 + 1 + 2
    assert not list(Path("runs/tiny").glob(".*"))


def test_the_page_of_a_run_says_what_its_files_say() -> None:
    said = HTMLPage(Path("runs/tiny/report.html")).said
    totals = json.loads(Path("runs/tiny/summary.json").read_text())
    assert "finished" in said and f"{totals['steps']:,} of 192" in said
    accepted = totals["accounts"]["accepted"]["samples"]
    assert f"Accepted are {accepted:,} samples, and as many were trained on" in said
    assert "ppo.minibatch_size 32" in said and "localization.max_particles 120" in said
    assert "4 validation episodes of seed 0 in hybrid" in said
    assert "version of torch" in said


def test_driven_episodes_are_those_of_evaluate(capsys: pytest.CaptureFixture[str]) -> None:
    with kept_threads():
        assert lndrl("evaluate runs/tiny --episodes 4 --workers 0 --json".split()) == 0
    records = json.loads(capsys.readouterr().out)["records"]
    page = HTMLPage(Path("runs/tiny/report.html"))
    counts = [sum(r["outcome"] == name for r in records) for name in ("arrived", "collided")]
    assert f"arrival rate {counts[0] / 4:.3f}" in page.said
    assert f"collision rate {counts[1] / 4:.3f}" in page.said
    alts = [str(attributes["alt"]) for attributes in page.of("img")]
    off = [f"its belief was {r['position_error']:.2f} m off on average" for r in records]
    assert all(any(words in alt for words in off) for alt in alts[-2:])
    assert [alt.split(",")[0] for alt in alts[:2]] == [
        f"Map of hybrid with the way of episode {k}" for k in range(2)
    ]


def test_the_page_of_results_is_what_lndrl_results_says(
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = HTMLPage(Path("v2.html"))
    assert page.faults() == []
    assert page.titles == [
        "The table beside the paper's",
        "Scenarios",
        "Paired differences",
        "What chance is worth in training",
        "Goals",
        "How the rows were trained",
        "Failure gallery",
        "What was tested",
        "Machine and versions",
    ]
    assert lndrl(["results", "--from", str(V2), "--reference", "dwa", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    for row in told["rows"]:
        assert f"{row['method']} {row['episodes']:,} {row['ar']:.3f} (" in page.said
    assert "dwa, published 2,500 0.631 0.322" in page.said
    for verdict in told["goals"]["verdicts"]:
        assert f"{verdict['goal']} {verdict['seen']} {verdict['verdict']}" in page.said
    pictures = page.of("img")
    assert len(pictures) == 2 and all("lost: " in str(a["alt"]) for a in pictures)
    assert "(recorded:" not in page.said  # they are the episodes that were recorded


def test_without_episodes_nothing_is_driven(capsys: pytest.CaptureFixture[str]) -> None:
    assert lndrl(["report", "runs/tiny", "--episodes", "0", "--out", "none.html"]) == 0
    printed = capsys.readouterr()
    assert printed.err == "" and "none.html: 6 chapters" in printed.out
    page = HTMLPage(Path("none.html"))
    assert page.faults() == [] and "Episodes driven" not in page.titles


def test_a_run_whose_policy_is_gone_still_has_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    for name in ("run.json", "config.yaml", "metrics.jsonl"):
        (bare / name).write_bytes(Path("runs/tiny", name).read_bytes())
    assert lndrl(["report", str(bare)]) == 0
    assert "note: no episode is driven: " in capsys.readouterr().err
    page = HTMLPage(bare / "report.html")
    assert page.faults() == [] and "empty" in page.said and "notes no checkpoint yet" in page.said


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["runs/none"], "runs/none: no such run or results folder"),
        (["runs"], "runs: is neither a run folder (it has no run.json) nor results"),
        (["runs/tiny", "--out", "page.pdf"], "--out page.pdf: must end in .html"),
        (["runs/tiny", "--out", "away/page.html"], "--out away/page.html: folder away does not"),
        (["runs/tiny", "--reference", "dwa"], "--reference dwa: goes with results of"),
        (["runs/tiny", "--checkpoint", "step-9"], "step-9"),
        ([str(V2), "--episodes", "3", "--out", "x.html"], "--episodes 3: goes with a run folder"),
        ([str(V2), "--reference", "nobody", "--out", "x.html"], "nobody"),
        (["untrained"], "untrained/metrics.jsonl: no such file; a run writes it after its first"),
        (["hurt"], "hurt/metrics.jsonl, line 1: not a JSON object"),
        (["wrong"], "wrong/config.yaml: "),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    good = {name: Path("runs/tiny", name).read_text() for name in ("run.json", "config.yaml")}
    texts = {
        "untrained": good,
        "hurt": {**good, "metrics.jsonl": "nonsense\n{}\n"},
        "wrong": {**good, "config.yaml": "learner: {total_stepz: 1}\n"},
    }
    for name, files in texts.items():
        Path(name).mkdir(exist_ok=True)
        for file, text in files.items():
            Path(name, file).write_text(text)
    before = sorted(Path().rglob("*.html"))
    assert lndrl(["report", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error and len(error.splitlines()) == 1
    assert sorted(Path().rglob("*.html")) == before


def test_ctrl_c_while_driving_leaves_no_page(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("lndrl.evaluation.filmed.film", interrupted)
    assert lndrl(["report", "runs/tiny", "--out", "half.html"]) == 130
    assert "stopped: no page was written; begin again with: " in capsys.readouterr().err
    assert not list(Path().glob("*half*"))


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (apt-get install chromium)")
@pytest.mark.parametrize(
    ("name", "width", "dark"),
    [
        *(("runs/tiny/report.html", w, dark) for w in (390, 1440) for dark in (False, True)),
        # Of the same style: what is narrow and what is dark is seen once.
        *(("v2.html", w, dark) for w, dark in ((390, True), (1440, False))),
    ],
)
def test_chromium_shows_it_whole(name: str, width: int, dark: bool, tmp_path: Path) -> None:
    found = look(Path(name), tmp_path, width, dark, axe=bool(AXE))
    assert found["width"] == width and found["dark"] == dark
    assert found["background"] == ("rgb(20, 23, 28)" if dark else "rgb(243, 245, 248)")
    assert found["console"] == [] and found["faults"] == []
    assert found["wide"] <= width and found["outside"] == []
    assert found["images"] == found["loaded"] >= 2
    assert found["charts"] == found["drawn"] >= 3
    assert [each for each in found.get("axe", []) if each[0] in ("serious", "critical")] == []


@pytest.mark.skipif(not AXE, reason="needs AXE_CORE=axe.min.js of axe-core (npm pack axe-core)")
def test_axe_was_asked(tmp_path: Path) -> None:
    """That a page with a fault is seen: else the checks above would say nothing."""
    page = tmp_path / "bad.html"
    page.write_text('<html><head></head><body><img src="data:,"></body></html>')
    found = look(page, tmp_path, 390, False, axe=True)
    assert "image-alt" in [each[1] for each in found["axe"]]
