"""Finding parts of one's own: names, trust, entry points, contracts, and what goes wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from lndrl import extensions
from lndrl.errors import UserError
from lndrl.extensions import HOOKS, METRIC, PLANNER, calling, find, fingerprint, make, trust_modules

Write = Callable[..., str]
Install = Callable[[str, str, str, str], None]
METRICS = """
    class Count:
        def __call__(self, records):
            return len(records)
"""


def refusal(name: str, **more: object) -> str:
    with pytest.raises(UserError) as caught:
        find(METRIC, name, **more)  # type: ignore[arg-type]
    sentence = str(caught.value)
    assert "\n" not in sentence
    return sentence


def test_a_trusted_module_is_imported(own_module: Write) -> None:
    name = own_module(METRICS)
    found = find(METRIC, f"{name}:Count")
    assert found is not None and make(METRIC, found, name)([1, 2]) == 2


def test_nothing_of_another_module_runs(own_module: Write, tmp_path: Path) -> None:
    name = own_module(f"open({str(tmp_path / 'ran')!r}, 'w')\n", trusted=False)
    sentence = refusal(f"{name}:Count", where="--metric")
    assert sentence.startswith(f"--metric: metric {name}:Count is refused: importing it runs code")
    assert sentence.endswith(f"add --trust-modules {name}")
    assert name not in sys.modules and not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("prefix", "module", "trusted"),
    [
        ("my", "my", True),
        ("my", "my.inner", True),
        ("my.inner", "my.inner", True),
        ("my", "myevil", False),
        ("my.inner", "my", False),
        ("my.inner", "my.innerevil", False),
        ("my.inner", "my.other", False),
    ],
)
def test_trust_ends_where_a_name_ends(
    own_module: Write, prefix: str, module: str, trusted: bool
) -> None:
    trust_modules(prefix)
    sentence = refusal(f"{module}:Count")
    assert ("there is no module" in sentence) is trusted
    assert ("is refused" in sentence) is not trusted


@pytest.mark.parametrize("prefix", ["", ".", "my.", "my-package", "my:Class", "*", "a b"])
def test_only_modules_can_be_trusted(own_module: Write, prefix: str) -> None:
    with pytest.raises(UserError, match="is no module to trust"):
        trust_modules(prefix)
    assert extensions.trusted_modules() == ()


def test_an_installed_entry_point_is_trusted(own_module: Write, install: Install) -> None:
    name = own_module(METRICS, trusted=False)
    install("their-metrics", "lndrl.metrics", "count", f"{name}:Count")
    found = find(METRIC, "count")
    assert found is not None and found.__name__ == "Count"
    assert find(METRIC, f"{name}:Count") is found
    with pytest.raises(UserError, match="is refused"):  # it was installed as a metric
        find(PLANNER, f"{name}:Count")


def test_a_built_in_part_wins_and_says_so(own_module: Write, install: Install, capsys) -> None:
    name = own_module(METRICS, trusted=False)
    install("their-planners", "lndrl.planners", "dwa", f"{name}:Count")
    extensions._say_once.cache_clear()
    assert find(PLANNER, "dwa", ("dwa",)) is None
    assert find(PLANNER, "dwa", ("dwa",)) is None
    note = "note: planner dwa is the built-in one; their-planners installs another\n"
    assert capsys.readouterr().err == note
    assert name not in sys.modules


def test_two_packages_of_one_name_are_refused(own_module: Write, install: Install) -> None:
    install("one", "lndrl.metrics", "count", "one:Count")
    install("two", "lndrl.metrics", "count", "two:Count")
    assert "one and two install entry points of that name; write module:Class" in refusal("count")


def test_an_unknown_name_suggests_the_nearest(own_module: Write, install: Install) -> None:
    install("their-metrics", "lndrl.metrics", "slowest", "x:Y")
    sentence = refusal("slowst", builtin=("fast",))
    assert "did you mean slowest? known: fast, slowest" in sentence
    assert sentence.endswith("a class of your own is written module:Class")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x = 1\n", "has no class Count"),
        ("class Counts: pass\n", "has no class Count; did you mean Counts?"),
        ("Count = 3\n", "is int, not a class"),
        ("class Count: pass\n", "has no method __call__(records)"),
        ("class Count:\n    def __call__(self): pass\n", "its __call__ must take (records)"),
        ("class Count:\n    def __call__(self, a, b): pass\n", "its __call__ must take (records)"),
        ("def f(:\n", "cannot be imported: SyntaxError"),
        ("import no_such_package\n", "cannot be imported: ModuleNotFoundError: No module named"),
        ("1 / 0\n", "cannot be imported: ZeroDivisionError: division by zero (own_"),
        ("import sys\nsys.exit(3)\n", "cannot be imported: SystemExit"),
    ],
)
def test_what_a_module_lacks_is_said(own_module: Write, text: str, sentence: str) -> None:
    assert sentence in refusal(f"{own_module(text)}:Count")


def test_a_class_must_take_what_its_place_gives(own_module: Write) -> None:
    name = own_module("""
        class Alone:
            def __init__(self): pass
            def reset(self, seed, worlds): pass
            def act(self, observation, rows): pass
    """)
    with pytest.raises(UserError, match=r"must be made with \(config, \*\*settings\)"):
        find(PLANNER, f"{name}:Alone")


def test_a_module_that_is_not_there(own_module: Write) -> None:
    trust_modules("nowhere_at_all")
    sentence = refusal("nowhere_at_all.inner:Count")
    assert "there is no module nowhere_at_all; install its package" in sentence


def test_settings_must_fit(own_module: Write) -> None:
    name = own_module("""
        class Count:
            def __init__(self, base=0):
                self.base = int(base)
            def __call__(self, records):
                return self.base
    """)
    found = find(METRIC, f"{name}:Count")
    assert found is not None and make(METRIC, found, name, base=3)([]) == 3
    with pytest.raises(UserError, match=r"settings \{'bass': 3\} do not fit \(got an unexpected"):
        make(METRIC, found, name, bass=3)
    with pytest.raises(UserError, match=rf"metric {name} failed: ValueError: invalid literal"):
        make(METRIC, found, name, base="three")


def test_what_a_part_raises_is_one_sentence_with_its_line(own_module: Write) -> None:
    name = own_module("def fail():\n    raise RuntimeError('two\\nlines')\n")
    module = __import__(name)
    with pytest.raises(UserError) as caught, calling(PLANNER, "my:Part"):
        module.fail()
    assert str(caught.value) == (
        f"planner my:Part failed: RuntimeError: two lines ({name}.py, line 2)"
    )
    with pytest.raises(UserError, match=r"^as it is$"), calling(PLANNER, "my:Part"):
        raise UserError("as it is")


def test_a_part_does_not_end_the_program_unsaid() -> None:
    said = r"^planner my:Part failed: SystemExit: 0 \("
    with pytest.raises(UserError, match=said), calling(PLANNER, "my:Part"):
        sys.exit(0)


def test_another_text_has_another_fingerprint(own_module: Write) -> None:
    texts = (METRICS, METRICS, METRICS.replace("len(records)", "1.0"))
    prints = [fingerprint(find(METRIC, f"{own_module(text)}:Count") or object) for text in texts]
    assert prints[0] == prints[1] != prints[2]


def test_every_hook_has_a_group_of_its_own() -> None:
    assert len({hook.group for hook in HOOKS}) == len({hook.what for hook in HOOKS}) == 6


def test_what_is_installed_is_named_in_the_order_of_its_numbers(
    install: Callable[[str, str, str, str], None],
) -> None:
    for number in (10, 2, 1):
        install(f"many{number}", "lndrl.planners", f"part{number}", "somewhere:Planner")
    assert extensions.installed(extensions.PLANNER) == ("part1", "part2", "part10")
