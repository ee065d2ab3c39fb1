"""The run's configuration: files, overrides, refusals, and the numbers that were published."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from lndrl.config import (
    REPOSITORY_CONFIGS,
    RunConfig,
    load_config,
    load_scenario,
    parse_config,
)
from lndrl.errors import UserError
from lndrl.models import effective

SCENARIO = {
    "name": "room",
    "size": [10.0, 6.0],
    "pedestrians": {"count": [0, 0]},
    "robot": [{"start": [1, 1, 2, 2], "goal": [8, 4, 9, 5]}],
}


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "run.yaml"
    path.write_text(yaml.safe_dump({"scenario": SCENARIO, "seed": 5, "ppo": {"epochs": 3}}))
    return path


def refusal(path: Path, *overrides: str) -> str:
    with pytest.raises(UserError) as caught:
        load_config(path, overrides)
    # Every refusal says where: the file, or the option that changed it.
    assert str(path) in str(caught.value) or "--set" in str(caught.value)
    return str(caught.value)


def test_a_file_is_read(config_file: Path) -> None:
    config = load_config(config_file)
    assert (config.seed, config.ppo.epochs, config.scenario.name) == (5, 3, "room")
    assert config.ppo.gamma == 0.99


def test_yaml_round_trip(config_file: Path, tmp_path: Path) -> None:
    config = load_config(config_file, ["task.reward.step=-4", "ppo.minibatch_size=null"])
    copy = tmp_path / "copy.yaml"
    copy.write_text(config.to_yaml())
    assert load_config(copy) == config
    assert load_config(copy).to_yaml() == config.to_yaml()


def test_plain_data_round_trip(config_file: Path) -> None:
    config = load_config(config_file)
    assert parse_config(config.model_dump(mode="json"), "a learner") == config
    assert parse_config(config.model_dump(mode="python"), "a learner") == config


def test_overrides_have_yaml_values(config_file: Path) -> None:
    config = load_config(
        config_file,
        [
            "seed=9",
            "ppo.clip=1e-1",
            "ppo.minibatch_size=null",
            "ppo.normalize_advantages=false",
            "world.laser.beams=36",
            "task.linear_velocities=[0.0, 0.5]",
            "localization.kind=perfect",
        ],
    )
    assert config.seed == 9
    assert config.ppo.clip == 0.1
    assert config.ppo.minibatch_size is None
    assert config.ppo.normalize_advantages is False
    assert config.world.laser.beams == 36
    assert config.task.linear_velocities == [0.0, 0.5]
    assert config.localization.kind == "perfect"


def test_the_last_override_wins(config_file: Path) -> None:
    assert load_config(config_file, ["seed=1", "seed=2"]).seed == 2


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("ppo.epoch=4", "unknown key ppo.epoch; did you mean epochs?"),
        ("pppo.epochs=4", "unknown key pppo; did you mean ppo?"),
        ("world.laser.beam=4", "unknown key world.laser.beam; did you mean beams?"),
        ("ppo.epochs", "must be key=value, e.g. ppo.epochs=4"),
        ("=4", "must be key=value"),
        ("seed.more=4", "seed holds a value, not keys"),
        ("ppo.epochs=[1", "is not a YAML value"),
        ("ppo.epochs=many", "ppo.epochs = 'many'"),
        ("ppo.epochs=0", "ppo.epochs = 0: input should be greater than or equal to 1"),
        ("ppo.gamma=1.5", "ppo.gamma = 1.5: input should be less than or equal to 1"),
        ("ppo.actor_learning_rate=-1", "ppo.actor_learning_rate = -1"),
        ("ppo.dual_clip=0.5", "ppo.dual_clip = 0.5"),
        ("ppo.clip=.nan", "ppo.clip = nan"),
        ("world.tick=.inf", "world.tick = inf"),
        ("seed=-1", "seed = -1"),
        ("learner.mode=fast", "input should be 'async' or 'lockstep'"),
        ("localization.min_particles=9000", "min_particles must not exceed max_particles"),
        ("world.laser.z_hit=0.5", "z_hit + z_short + z_max + z_rand must be 1, not 0.52"),
        ("scenario=hybird", "scenario 'hybird' is unknown"),
        ("scenario=null", "scenario is missing"),
    ],
)
def test_refusals_of_overrides(config_file: Path, override: str, sentence: str) -> None:
    assert sentence in refusal(config_file, override)


def test_refusals_of_files(tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text("seed: 1\n")
    assert "scenario is missing" in refusal(path)
    path.write_text("scenario: 3\n")
    assert "scenario = 3" in refusal(path)
    path.write_text("scenario: other.yaml\n")
    assert "other.yaml: no such file" in refusal(path)


def test_a_scenario_file_lies_beside_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(SCENARIO))
    path = tmp_path / "run.yaml"
    path.write_text("scenario: room.yaml\n")
    assert load_config(path).scenario.size == (10.0, 6.0)


def write_map(folder: Path, extra: str = "") -> Path:
    """A hall of 8 x 6 m as ROS has it."""
    floor = np.full((120, 160), 254, np.uint8)
    floor[:4] = floor[-4:] = 0
    floor[:, :4] = floor[:, -4:] = 0
    Image.fromarray(floor).save(folder / "hall.pgm")
    path = folder / "hall-1.yaml"
    path.write_text(
        "image: hall.pgm\nresolution: 0.05\norigin: [1.0, 2.0, 0.0]\nnegate: 0\n"
        f"occupied_thresh: 0.65\nfree_thresh: 0.196\n{extra}"
    )
    return path


def test_places_of_a_mixture_are_named(tmp_path: Path) -> None:
    (tmp_path / "hall-1.yaml").write_text("name: hall-1\nkind: random\nsize: [20, 20]\n")
    both = "mixed: {places: [{scenario: hall}, {scenario: hall-1.yaml, weight: 2}]}"
    (tmp_path / "both.yaml").write_text(f"name: both\nkind: mixed\n{both}\n")
    mixed = load_scenario(str(tmp_path / "both.yaml"))
    assert [part.name for part in mixed.parts] == ["hall", "hall-1"]
    assert mixed.parts[0] == load_scenario("hall")
    run = tmp_path / "run.yaml"
    run.write_text("scenario: both.yaml\n")
    assert load_config(run).scenario == mixed
    copy = tmp_path / "copy.yaml"
    copy.write_text(load_config(run).to_yaml())
    assert load_config(copy) == load_config(run)
    sparse = "scenario.mixed.places=[{scenario: sparse}]"
    assert load_config(run, [sparse]).scenario.parts == (load_scenario("sparse"),)
    with pytest.raises(UserError, match="scenario 'nowhere' is unknown"):
        load_config(run, ["scenario.mixed.places=[{scenario: nowhere}]"])


def test_a_mixture_that_leads_back_to_itself_is_told_so(tmp_path: Path) -> None:
    for one, other in (("a", "b"), ("b", "a"), ("c", "c")):
        places = f"mixed: {{places: [{{scenario: {other}.yaml}}]}}"
        (tmp_path / f"{one}.yaml").write_text(f"name: {one}\nkind: mixed\n{places}\n")
    for name in ("a", "c"):
        with pytest.raises(UserError, match=rf"{name}\.yaml: mixed\.places leads back to itself"):
            load_scenario(str(tmp_path / f"{name}.yaml"))


def test_a_misspelt_key_of_a_place_is_named(tmp_path: Path) -> None:
    place = "{name: x, kind: random, size: [20, 20], pedestrans: {}}"
    text = f"name: b\nkind: mixed\nmixed: {{places: [{{scenario: {place}}}]}}\n"
    (tmp_path / "b.yaml").write_text(text)
    with pytest.raises(UserError, match="did you mean pedestrians"):
        load_scenario(str(tmp_path / "b.yaml"))


def test_a_map_among_the_places_of_a_mixture_is_read(tmp_path: Path) -> None:
    path = write_map(tmp_path)
    places = "[{scenario: hall-1.yaml}, {scenario: {name: m, kind: map, map: hall-1.yaml}}]"
    (tmp_path / "both.yaml").write_text(f"name: b\nkind: mixed\nmixed: {{places: {places}}}\n")
    mixed = load_scenario(str(tmp_path / "both.yaml"))
    assert mixed.parts[0] == load_scenario(str(path))
    assert all(part.cells is not None for part in mixed.parts)
    assert mixed.map_notes == mixed.parts[0].map_notes + mixed.parts[1].map_notes


def test_the_yaml_file_of_a_map_is_a_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_map(tmp_path)
    beside = tmp_path / "scenario.yaml"
    beside.write_text("name: hall-1\nkind: map\nmap: hall-1.yaml\n")
    hall = load_scenario(str(path))
    assert hall == load_scenario(str(beside))
    assert (hall.name, hall.kind, hall.size) == ("hall-1", "map", (8.0, 6.0))
    assert hall.cells is not None and hall.cells.origin == (1.0, 2.0)
    run = tmp_path / "run.yaml"
    run.write_text("scenario: hall-1.yaml\n")
    people = "scenario.pedestrians.count=[1, 1]"
    assert load_config(run).scenario == hall
    assert load_config(run, [people]).scenario.pedestrians.count == (1, 1)
    monkeypatch.chdir(tmp_path)
    assert load_config(REPOSITORY_CONFIGS / "lndrl.yaml", ["scenario=hall-1.yaml"]).scenario == hall


def test_maps_that_are_no_scenario_are_refused_with_a_sentence(tmp_path: Path) -> None:
    path = write_map(tmp_path, "pedestrians: {count: [1, 2]}\nname: hall\n")
    with pytest.raises(UserError) as caught:
        load_scenario(str(path))
    assert str(caught.value) == (
        f"{path}: is a map (image) and a scenario (name, pedestrians) at once; write the "
        "scenario's keys into a file of its own beside it, with kind: map and map: hall-1.yaml"
    )
    path.write_text("image: hall.pgm\nresolution: 0.05\n")
    with pytest.raises(UserError) as caught:
        load_scenario(str(path))
    said = str(caught.value)
    assert said.startswith(f"{path}: origin is missing") and said.count(str(path)) <= 3
    path = write_map(tmp_path)
    (tmp_path / "hall.pgm").unlink()
    with pytest.raises(UserError, match=r"hall-1\.yaml: .*hall\.pgm: no such file"):
        load_scenario(str(path))


def test_the_hash_is_of_the_values(config_file: Path, tmp_path: Path) -> None:
    config = load_config(config_file)
    copy = tmp_path / "copy.yaml"
    copy.write_text("# another text\n" + config.to_yaml())
    assert load_config(copy).content_hash() == config.content_hash()
    changed = {
        load_config(config_file, [override]).content_hash()
        for override in ("seed=6", "ppo.clip=0.3", "world.crowd.see_robot=false")
    }
    assert len(changed | {config.content_hash()}) == 4
    assert len(config.content_hash()) == 12


def test_the_published_configuration_is_the_published_one_whatever_keys_came_later() -> None:
    assert load_config("paper").content_hash() == "ff1826ee80e6"


def test_defaults_are_the_published_ones(config_file: Path) -> None:
    config = load_config(config_file)
    assert len(config.task.linear_velocities) * len(config.task.angular_velocities) == 28
    assert config.task.reward.model_dump() == {
        "approach": 200.0,
        "pose": 400.0,
        "arrive": 500.0,
        "collide": -800.0,
        "lost": -500.0,
        "step": -5.0,
        "pose_limit": None,
        "terms": {},
    }
    assert config.world.tick * config.world.ticks_per_step == pytest.approx(0.4)
    laser, amcl = config.world.laser, config.localization
    assert (laser.beams, laser.range_max, laser.sigma_hit) == (720, 12.0, 0.02)
    assert (amcl.min_particles, amcl.max_particles, amcl.laser_max_beams) == (500, 2000, 60)
    assert (amcl.kld_err, amcl.kld_z) == (0.05, 0.99)
    assert (amcl.recovery_alpha_slow, amcl.recovery_alpha_fast) == (0.001, 0.1)


def test_paper_yaml_has_the_published_numbers() -> None:
    config = load_config(REPOSITORY_CONFIGS / "paper.yaml")
    assert effective(config.ppo) == {  # without keys that came later and do nothing there
        "actor_learning_rate": 5e-5,
        "critic_learning_rate": 1e-3,
        "learning_rate_schedule": "constant",
        "gamma": 0.99,
        "gae_lambda": 0.95,
        "clip": 0.2,
        "dual_clip": 3.0,
        "epochs": 10,
        "batch_size": 1024,
        "minibatch_size": None,
        "entropy": 0.0,
        "value_loss": 0.5,
        "gradient_norm": 0.5,
        "joint_gradient_norm": True,
        "normalize_advantages": False,
        "target_kl": None,
        "reward_scale": 1.0,
        "reward_limit": None,
        "bootstrap_truncated": False,
        "max_importance": 10.0,
        "adam_eps": 1e-8,
    }
    assert config.learner.total_steps == 1_200_000
    count, worlds = config.actor.count, config.actor.worlds
    assert isinstance(count, int) and isinstance(worlds, int) and count * worlds == 8
    assert config.network.pooling == "max"
    assert config.network.turn_reluctance == 0.0
    assert config.scenario.name == "hybrid"


def test_auto_actors_are_two_where_runs_must_repeat() -> None:
    config = load_config(REPOSITORY_CONFIGS / "lndrl.yaml")
    assert (config.actor.count, config.actor.worlds) == ("auto", "auto")
    assert config.fixed_actors == 2
    assert config.fixed_actors * config.worlds_per_actor() * config.actor.horizon == 2048
    fixed = load_config(
        REPOSITORY_CONFIGS / "lndrl.yaml", ["actor.count=5", "actor.worlds=3", "ppo.batch_size=64"]
    )
    assert (fixed.fixed_actors, fixed.worlds_per_actor(), fixed.worlds_per_actor(99)) == (5, 3, 3)


@pytest.mark.parametrize("actors", [1, 2, 5, 14, 64, 1000])
@pytest.mark.parametrize("batch", [64, 1024, 2048, 65536])
def test_auto_worlds_keep_chunks_small_and_fresh(actors: int, batch: int) -> None:
    overrides = [f"ppo.batch_size={batch}", "learner.max_lag=6", "actor.horizon=16"]
    config = load_config(REPOSITORY_CONFIGS / "lndrl.yaml", overrides)
    worlds = config.worlds_per_actor(actors)
    assert 1 <= worlds <= 32
    if worlds > 1:
        assert worlds * 16 <= batch / 2
        assert actors * worlds * 16 <= 3 * batch
    if worlds < 32:
        more = (worlds + 1) * 16
        assert more > batch / 2 or actors * more > 3 * batch, "no fewer than need be"
    lockstep = load_config(REPOSITORY_CONFIGS / "lndrl.yaml", [*overrides, "learner.mode=lockstep"])
    assert lockstep.worlds_per_actor(actors) == config.worlds_per_actor(2)


def test_both_configurations_share_world_and_task() -> None:
    """The two differ in how they learn, never in what is learned."""
    ours = load_config(REPOSITORY_CONFIGS / "lndrl.yaml")
    paper = load_config(REPOSITORY_CONFIGS / "paper.yaml")
    for part in ("scenario", "world", "localization", "task"):
        assert getattr(ours, part) == getattr(paper, part), part
    assert isinstance(ours, RunConfig)


def test_a_base_is_read_below_and_leads_nowhere_twice(tmp_path: Path) -> None:
    (tmp_path / "low.yaml").write_text("scenario: hybrid\nppo: {epochs: 3, gamma: 0.9}\n")
    (tmp_path / "high.yaml").write_text("base: low.yaml\nppo: {gamma: 0.8}\nseed: 4\n")
    config = load_config(tmp_path / "high.yaml", ["ppo.clip=0.3"])
    assert (config.ppo.epochs, config.ppo.gamma, config.ppo.clip, config.seed) == (3, 0.8, 0.3, 4)
    (tmp_path / "round.yaml").write_text("base: round.yaml\n")
    (tmp_path / "odd.yaml").write_text("base: 3\n")
    (tmp_path / "lost.yaml").write_text("base: nowhere.yaml\n")
    for name, sentence in (
        ("round", "leads back to itself"),
        ("odd", "base must name a YAML file"),
        ("lost", "nowhere.yaml: no such file"),
    ):
        with pytest.raises(UserError, match=sentence):
            load_config(tmp_path / f"{name}.yaml")


def test_an_empty_mapping_empties_what_is_below(tmp_path: Path) -> None:
    """As ``--set imitation.settings={}`` does; all else is changed key by key."""
    low = "scenario: hybrid\nimitation: {steps: 9000, settings: {turn: 1, view: 2}}\n"
    (tmp_path / "low.yaml").write_text(low)
    for said, settings in (("{}", {}), ("{view: 3}", {"turn": 1, "view": 3})):
        (tmp_path / "high.yaml").write_text(f"base: low.yaml\nimitation: {{settings: {said}}}\n")
        config = load_config(tmp_path / "high.yaml")
        assert (config.imitation.steps, config.imitation.settings) == (9000, settings)


def test_several_scans_need_the_encoder_that_reads_them(config_file: Path) -> None:
    with pytest.raises(UserError, match=r"needs network\.scan_encoder: fan"):
        load_config(config_file, ["task.scan_frames=3"])


def test_a_record_from_before_a_key_keeps_what_was_so_before(tmp_path: Path) -> None:
    """A run folder that was begun when ROS's one-bin rule and old reports were read otherwise."""
    config = load_config("lndrl")
    data = yaml.safe_load(config.to_yaml())
    for section, key in (
        ("localization", "kld_one_bin"), ("localization", "update_at_start"),
        ("localization", "update_ticks"), ("task", "judged_moment"), ("world", "odometry_draw"),
    ):  # fmt: skip
        del data[section][key]
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(data))
    then = load_config(tmp_path / "config.yaml")
    assert then.localization.kld_one_bin == "min" and not then.localization.update_at_start
    assert then.localization.update_ticks is None and then.world.odometry_draw == "step"
    assert then.task.judged_moment == "present"
    written = tmp_path / "mine.yaml"  # by hand: the defaults of today
    written.write_text(
        "scenario: hybrid\nlocalization: {min_particles: 400}\ntask: {time_limit: 50}"
    )
    now = load_config(written)
    assert now.localization.kld_one_bin == "max" and now.task.judged_moment == "report"
    assert load_config(written, ["localization=best"]).localization.kld_one_bin == "min"


def test_a_teacher_that_the_task_cannot_serve() -> None:
    perfect = load_config("lndrl", ["ppo.teacher=careful", "localization.kind=perfect"])
    assert "careful goes by the belief's variances" in str(perfect.teacher_misfit())
    for teacher in ("predictive", "null"):
        fine = load_config("lndrl", [f"ppo.teacher={teacher}", "localization.kind=perfect"])
        assert fine.teacher_misfit() is None
    with pytest.raises(UserError, match=r"ppo\.teacher.*'predictive' or 'careful'"):
        load_config("lndrl", ["ppo.teacher=dwa"])
    with pytest.raises(UserError, match=r"drive_steps 50,000 must not exceed imitation\.steps"):
        load_config("lndrl", ["imitation.drive_steps=50000", "imitation.steps=40960"])
