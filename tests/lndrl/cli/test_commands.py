"""train, learner and actor: what they hand to the services, and what they refuse before that."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from lndrl.cli.main import run
from lndrl.cli.signals import stop_on_signals
from lndrl.config import REPOSITORY_CONFIGS, load_config
from lndrl.machine.cores import usable_cores
from lndrl.machine.lock import FolderLock
from lndrl.transport import Security

SCENARIO = {
    "name": "room",
    "size": [10.0, 6.0],
    "pedestrians": {"count": [0, 0]},
    "robot": [{"start": [1, 1, 2, 2], "goal": [8, 4, 9, 5]}],
}


class Summary:
    """Of a run that was stopped."""

    finished = False

    def __str__(self) -> str:
        return "finished after 10 steps"


class Services:
    """Stands where learner and actors would start; remembers the calls."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []
        self.exit_code = 0
        self.signals: list[int] = []

    def service(self, name: str) -> Any:
        def called(*arguments: Any, **options: Any) -> Any:
            self.calls.append((name, arguments, options))
            for number in self.signals:
                os.kill(os.getpid(), number)
            return self.exit_code if name == "fleet" else Summary()

        return called


@pytest.fixture
def services(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Services:
    """Fake services, and a working folder with run.yaml."""
    fake = Services()

    def stand_in(module: str, **names: str) -> None:
        fakes = SimpleNamespace(
            **{function: fake.service(name) for function, name in names.items()}
        )
        monkeypatch.setitem(sys.modules, module, fakes)
        monkeypatch.setattr(module, fakes, raising=False)

    stand_in("learner.service", run_learner="learner")
    stand_in("actors.fleet", run_fleet="fleet")
    stand_in("lndrl.cli.training.local", train_locally="local", train_serially="serial")
    monkeypatch.chdir(tmp_path)
    Path("run.yaml").write_text(yaml.safe_dump({"scenario": SCENARIO, "seed": 5}))
    return fake


def existing_run(name: str = "first", **changes: Any) -> Path:
    folder = Path("runs") / name
    folder.mkdir(parents=True)
    data = {**load_config("run.yaml").model_dump(mode="json"), **changes}
    (folder / "config.yaml").write_text(yaml.safe_dump(data))
    return folder


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    before = sorted(Path().rglob("*"))
    assert run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert sorted(Path().rglob("*")) == before
    return captured.err


def test_train_starts_learner_and_actors(services: Services, capsys) -> None:
    line = "train run.yaml --actors 3 --steps 500 --run first --set seed=7 ppo.epochs=2"
    assert run([*line.split(), "--listen", "tcp/127.0.0.1:7555"]) == 0
    [(name, (config, folder, resume, checkpoint, drawn, stop), _)] = services.calls
    assert (name, folder, resume, checkpoint) == ("local", Path("runs/first"), False, None)
    assert (config.seed, config.ppo.epochs) == (7, 2)
    assert config.learner.total_steps == 500
    assert config.actor.count == 3
    assert config.transport.endpoint == "tcp/127.0.0.1:7555"
    assert drawn is False
    assert not stop.is_set()
    assert capsys.readouterr().out == "finished after 10 steps\n"
    assert not folder.exists()


def test_train_names_a_run_by_file_and_time(services: Services) -> None:
    assert run(["train", "run.yaml", "--dashboard"]) == 0
    [(_, (config, folder, _, _, drawn, _), _)] = services.calls
    assert folder.parent == Path("runs")
    assert folder.name.startswith("run-2")
    assert config == load_config("run.yaml")
    assert config.actor.count == "auto"
    assert drawn is True


def test_train_with_actors_auto_overrules_a_number(services: Services) -> None:
    assert run("train run.yaml --set actor.count=7 --actors auto --run first".split()) == 0
    assert services.calls[0][1][0].actor.count == "auto"


def test_train_serial(services: Services) -> None:
    assert run("train run.yaml --serial --actors 1 --steps 64 --run s".split()) == 0
    [(name, (config, folder, resume, checkpoint, _), _)] = services.calls
    assert (name, folder, resume, checkpoint) == ("serial", Path("runs/s"), False, None)
    assert (config.learner.total_steps, config.actor.count) == (64, 1)


def test_learner(services: Services) -> None:
    assert run("learner run.yaml --listen tcp/0.0.0.0:7000 --run far --steps 9".split()) == 0
    [(name, (config, folder, resume, endpoint, stop, checkpoint), options)] = services.calls
    assert (name, folder, resume, checkpoint) == ("learner", Path("runs/far"), False, None)
    assert (endpoint or config.transport.endpoint) == "tcp/0.0.0.0:7000"
    assert config.learner.total_steps == 9
    assert not stop.is_set()
    assert options == {
        "security": Security("learner"),
        "team": None,
        "metrics": None,
        "trackers": (),
    }


@pytest.mark.parametrize("command", ["learner", "train"])
def test_metrics_are_for_this_machine_unless_asked(
    command: str, services: Services, capsys: pytest.CaptureFixture[str]
) -> None:
    for options in ("", " --metrics-address ::"):
        assert run(f"{command} run.yaml --metrics-port 9464{options}".split()) == 0
    served = [call[2]["metrics"] for call in services.calls]
    assert served == [("127.0.0.1", 9464), ("::", 9464)]
    assert run(f"{command} run.yaml --metrics-address ::".split()) == 2
    assert "--metrics-address goes with --metrics-port" in capsys.readouterr().err


def test_learner_listens_on_loopback_unless_asked(services: Services) -> None:
    assert run(["learner", "run.yaml"]) == 0
    assert services.calls[0][1][0].transport.endpoint == "tcp/127.0.0.1:7447"


def test_learner_device(services: Services) -> None:
    assert run("learner run.yaml --run a --device auto".split()) == 0
    assert run("learner run.yaml --run b".split()) == 0
    assert [call[1][0].learner.device for call in services.calls] == ["auto", "cpu"]


def test_actor(services: Services) -> None:
    services.exit_code = 1
    line = "actor --connect tcp/learner.example:7447 --count 2 --worlds 4 --device cuda:0"
    assert run(line.split()) == 1
    assert run(["actor", "--connect", "tcp/[::1]:7447"]) == 1
    assert run(["actor", "--connect", "tcp/[::1]:7447", "--count", "auto"]) == 1
    assert [call[1] for call in services.calls] == [
        ("tcp/learner.example:7447", 2, 4, "cuda:0"),
        ("tcp/[::1]:7447", 1, None, "cpu"),
        ("tcp/[::1]:7447", usable_cores(), None, "cpu"),
    ]


def test_the_learners_doors(services: Services, monkeypatch) -> None:
    Path("password").touch(0o600)
    Path("password").write_text("secret\n")
    lines = (
        "learner run.yaml --run a --listen tls/0.0.0.0:7000 --certs certs --users users",
        "train run.yaml --run b --certs certs --zenoh more.json5 --namespace 7 --insecure",
        "learner run.yaml --run c --router tls/r:1 --user learner --password-file password",
    )
    for line in lines:
        assert run(line.split()) == 0
    certs = Path("certs")
    assert [call[2]["security"] for call in services.calls] == [
        Security("learner", certs, users=Path("users")),
        Security("learner", certs, overlay=Path("more.json5"), insecure=True),
        Security("learner", user="learner", password="secret"),
    ]
    wires = [call[1][0].transport for call in services.calls]
    assert [wire.router for wire in wires] == [False, False, True]
    assert [wire.namespace for wire in wires] == ["", "7", ""]
    assert wires[2].endpoint == "tls/r:1"
    assert all("secret" not in str(call[1]) for call in services.calls)


def test_a_resumed_run_comes_from_behind_its_router(services: Services) -> None:
    behind = {"endpoint": "tcp/r:1", "router": True, "namespace": "lab/one"}
    existing_run(transport={**load_config("run.yaml").transport.model_dump(), **behind})
    for line in ("", "--listen tcp/127.0.0.1:7000"):
        assert run(f"learner --run first --resume {line}".split()) == 0
    wires = [call[1][0].transport for call in services.calls]
    assert [(w.endpoint, w.router) for w in wires] == [
        ("tcp/r:1", True),
        ("tcp/127.0.0.1:7000", False),
    ]


def test_an_actors_password_comes_from_a_file_or_the_environment(services, monkeypatch) -> None:
    Path("password").touch(0o600)
    Path("password").write_text("filed\n")
    monkeypatch.setenv("LNDRL_PASSWORD", "set")
    for options in ("--user actor-1 --password-file password", "--user actor-1", ""):
        assert run(f"actor --connect tcp/h:80 --namespace lab/1 {options}".split()) == 0
    assert [call[2]["namespace"] for call in services.calls] == ["lab/1"] * 3
    assert [call[2]["security"] for call in services.calls] == [
        Security("actor", user="actor-1", password="filed"),
        Security("actor", user="actor-1", password="set"),
        Security("actor"),
    ]


@pytest.mark.parametrize("command", ["train", "learner"])
def test_an_existing_run_is_not_overwritten(command: str, services: Services, capsys) -> None:
    existing_run()
    message = refused(capsys, command, "run.yaml", "--run", "first")
    assert "runs/first exists already; continue it with --resume" in message
    assert services.calls == []


@pytest.mark.parametrize("command", ["train", "learner"])
def test_resume_takes_the_runs_own_configuration(command: str, services: Services, capsys) -> None:
    existing_run(seed=99)
    line = f"{command} run.yaml --run first --resume --steps 800 --set ppo.clip=0.3"
    assert run([*line.split(), "--checkpoint", "step-000000064"]) == 0
    config, folder, resume = services.calls[0][1][:3]
    assert "step-000000064" in services.calls[0][1][3:]
    assert (config.seed, config.ppo.clip, config.learner.total_steps) == (99, 0.3, 800)
    assert (folder, resume) == (Path("runs/first"), True)
    assert "goes on with its own runs/first/config.yaml, not run.yaml" in capsys.readouterr().err


def test_resume_needs_no_configuration_and_says_nothing_if_equal(services, capsys) -> None:
    existing_run()
    assert run("train --run first --resume".split()) == 0
    assert run("train run.yaml --run first --resume".split()) == 0
    assert capsys.readouterr().err == ""
    assert [call[1][2] for call in services.calls] == [True, True]


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("train", "lndrl"),
        ("train paper", "paper"),
        ("learner", "lndrl"),
        ("learner paper", "paper"),
    ],
)
def test_a_configuration_is_known_by_name_and_lndrl_without_one(
    line: str, name: str, services: Services
) -> None:
    assert run(line.split()) == 0
    config, folder = services.calls[0][1][:2]
    assert config == load_config(REPOSITORY_CONFIGS / f"{name}.yaml")
    assert folder.parent == Path("runs") and folder.name.startswith(f"{name}-")


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("train lndlr", "'lndlr' is unknown; did you mean lndrl? known by name: drl_laser, "),
        ("train benchmark", "configuration 'benchmark' is unknown; known by name: drl_laser, "),
        ("learner ppo", "configuration 'ppo' is unknown; known by name: "),
        ("train nowhere.yaml", "nowhere.yaml: no such file"),
        ("train run.yaml --set ppo.epoch=3", "unknown key ppo.epoch; did you mean epochs?"),
        ("train run.yaml --set ppo.epochs=-3", "ppo.epochs = -3"),
        ("train run.yaml --actors 0", "'0' is neither auto nor a whole number, at least 1"),
        ("actor --connect tcp/h:80 --count many", "'many' is neither auto nor a whole number"),
        ("train run.yaml --set actor.worlds=0", "actor.worlds: 0 must be auto or a whole number"),
        ("train run.yaml --set actor.count=1.5", "actor.count: 1.5 must be auto or a whole"),
        ("train run.yaml --run ../away", "--run ../away: must be one folder name"),
        ("train run.yaml --run a/b", "--run a/b: must be one folder name"),
        ("train run.yaml --resume", "--resume needs --run NAME; runs that exist: known"),
        ("train --run other --resume", "runs/other does not exist, so it cannot be resumed"),
        ("learner --run other --resume", "runs that exist: known"),
        ("train run.yaml --checkpoint step-000000064", "--checkpoint goes with --resume"),
        ("learner run.yaml --checkpoint step-000000064", "--checkpoint goes with --resume"),
        ("train run.yaml --serial --dashboard", "--dashboard does not go with --serial"),
        ("train run.yaml --serial --listen tcp/0.0.0.0:1", "--listen does not go with --serial"),
        ("train run.yaml --serial --certs certs", "--certs does not go with --serial"),
        ("train run.yaml --listen 7447", "--listen 7447: not an endpoint; write it like tcp/"),
        ("learner run.yaml --listen tcp/0.0.0.0", "needs a host and a port 1 to 65535"),
        ("learner run.yaml --listen tcp/h:99999", "needs a host and a port 1 to 65535"),
        ("learner run.yaml --device gpu", "device gpu: not a device; write cpu, cuda"),
        ("learner run.yaml --device cuda:63", "device cuda:63: "),
        ("train run.yaml --set learner.device=gpu", "learner.device: gpu is not a device"),
        ("actor --connect http/h:80", "--connect http/h:80: not an endpoint"),
        ("actor --connect tcp/:80", "needs a host and a port"),
        ("actor --connect quic/h:80", "--connect quic/h:80: not an endpoint"),
        ("actor --connect tls/h:80", "endpoint tls/h:80 needs certificates"),
        ("actor --connect tls/h:80 --certs no", "no: no such folder of certificates"),
        ("actor --connect tcp/h:80 --user actor", "user actor has no password"),
        ("actor --connect tcp/h:80 --user dashboard --password-file run.yaml", "run.yaml: others"),
        ("actor --connect tcp/h:80 --namespace a//b", "'a//b' is not a namespace"),
        ("dashboard --connect tcp/h:80 --user actor", "user actor has no password"),
        ("learner run.yaml --namespace a/**", "'a/**' is not a namespace"),
        ("learner run.yaml --listen tcp/h:1 --router tcp/r:1", "--listen does not go with"),
        ("learner run.yaml --router 7447", "--router 7447: not an endpoint"),
        ("learner run.yaml --router tcp/r:1 --users u", "--users does not go with a router"),
        ("learner run.yaml --router tcp/r:1 --insecure", "--insecure does not go with a router"),
        ("learner run.yaml --user learner", "--user and --password-file go with --router"),
        ("actor --connect tcp/h:80 --device gpu", "--device gpu: not a device; write cpu"),
    ],
)
def test_bad_input(line: str, sentence: str, services: Services, capsys) -> None:
    existing_run("known")
    assert sentence in refused(capsys, *line.split())
    assert services.calls == []


def test_a_run_folder_without_configuration(services: Services, capsys) -> None:
    Path("runs/empty").mkdir(parents=True)
    assert "runs/empty/config.yaml: no such file" in refused(
        capsys, *"train --run empty --resume".split()
    )


@pytest.mark.parametrize("command", ["learner", "train", "train --serial"])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_first_signal_asks_for_an_orderly_end(
    command: str, number: int, code: int, services: Services, capsys
) -> None:
    services.signals = [number]
    before = signal.getsignal(number)
    assert run([*command.split(), "run.yaml"]) == code
    assert any(getattr(a, "is_set", bool)() for a in services.calls[0][1])
    captured = capsys.readouterr()
    assert "stopping: the learner writes a checkpoint" in captured.err
    assert captured.out == "finished after 10 steps\n"
    name = services.calls[0][1][1].name
    assert captured.err.endswith(f"go on with: lndrl {command} run.yaml --run {name} --resume\n")
    assert signal.getsignal(number) is before


def test_the_second_signal_ends_at_once() -> None:
    with pytest.raises(KeyboardInterrupt), stop_on_signals("soon") as stop:
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.wait(60)
        os.kill(os.getpid(), signal.SIGINT)
        pytest.fail("the second signal was swallowed")


@pytest.mark.parametrize("command", ["train", "learner", "train --serial"])
def test_a_run_that_is_at_work_is_refused_before_a_port_is_asked_for(
    command: str, services: Services, capsys: pytest.CaptureFixture[str]
) -> None:
    with FolderLock(existing_run(), "a learner", "stop it"):
        error = refused(capsys, *command.split(), "--run", "first", "--resume")
    words = f"runs/first: a learner is still at work there, process {os.getpid()} on "
    assert words in error and error.rstrip().endswith("stop it there, or choose another --run")
    assert not services.calls


def test_a_start_inside_a_wall_is_refused_before_anything_is_written(
    services: Services, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walled = {**SCENARIO, "obstacles": [{"box": [0.5, 0.5, 3.0, 3.0]}]}
    (tmp_path / "walled.yaml").write_text(yaml.safe_dump({"scenario": walled}))
    assert run(["train", "walled.yaml", "--run", "w"]) == 2
    message = capsys.readouterr().err
    assert len(message.strip().splitlines()) == 1
    assert "start" in message
    assert not services.calls
    assert not (tmp_path / "runs").exists()
