"""The other rank of ``test_team.py``: trains along, update by update, and says what it has."""

from __future__ import annotations

from learner.ppo.example.stage import stage_of
from learner.ppo.team import Team
from learner.ppo.update import PPO, DivergedError
from learner.ranks.alike import digest_of
from tests.learner.ppo.team_cases import batches, config_of

if __name__ == "__main__":
    team = Team.of_environment()
    assert team is not None
    while True:
        case = team.hear()["case"]
        config = config_of(case)
        ppo = PPO(config, team=team)
        for batch in batches(case):
            try:
                figures = ppo.update(batch, 0.1, stage_of(config, 0))
            except DivergedError:
                figures = {}
            team.gather({"figures": figures, "digest": digest_of(ppo)})
        ppo.close()
