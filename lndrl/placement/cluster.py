"""The file that says which host does what; see deploy/cluster.md."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from lndrl.config.shipped import find
from lndrl.errors import UserError
from lndrl.models import Count, Model, load_yaml, validate

Port = Annotated[int, Field(ge=1, le=65535)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
_AUTO_OR_COUNT = Count | Literal["auto"]


class HostConfig(Model):
    """A machine that is reached by ssh, as ``ssh`` itself would reach it."""

    host: Annotated[str, Field(min_length=1)] = Field(
        description="its name or address, or an alias of ~/.ssh/config"
    )
    user: str | None = Field(None, description="who logs in there; else as ssh finds")
    port: Port | None = Field(None, description="of its ssh; else as ssh finds")
    key: Path | None = Field(None, description="file of the private key; else as ssh finds")
    folder: str = Field("lndrl", description="where lndrl is installed there, from the home on")
    program: str = Field(
        ".venv/bin/lndrl", description="the command, from the folder on or as a whole path"
    )
    options: list[str] = Field([], description="more options for the command there")


class LearnerHost(HostConfig):
    """Where the learner runs."""

    address: str | None = Field(None, description="how the others reach it; else its host")
    listen: Port = Field(7447, description="the port that it listens at")


class SiteHost(HostConfig):
    """The door of a site, for which weights come once."""

    name: Name = Field(description="by which actors name it")
    address: str | None = Field(None, description="how the actors of the site reach it; else host")
    listen: Port = Field(7447, description="the port that it listens at")


def _hosts(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


class ActorHosts(HostConfig):
    """Alike machines with actors."""

    host: Annotated[  # type: ignore[assignment]
        list[str], Field(min_length=1), BeforeValidator(_hosts)
    ] = Field(description="one or several")
    count: _AUTO_OR_COUNT = Field("auto", description="processes on each; auto: one per core")
    site: Name | None = Field(None, description="the site that they belong to")


class SlurmActors(Model):
    """Actors that Slurm places, from where this command runs."""

    jobs: Count = Field(description="how many; each takes a node or a part of one")
    cpus: Count = Field(1, description="per job; as many actors run in it")
    minutes: Count = Field(720, description="that a job may last")
    partition: str | None = Field(None, description="Slurm's partition")
    site: Name | None = Field(None, description="the site that they belong to")
    program: str = Field("lndrl", description="the command on the nodes")
    folder: Path = Field(Path("slurm"), description="where submitit keeps what jobs say")
    cluster: Literal["slurm", "local"] = Field(
        "slurm", description="local: as processes of this machine, to try it"
    )


class ClusterConfig(Model):
    """A run over several machines."""

    run: Name = Field(description="its name in the learner's folder")
    configuration: str = Field(
        "lndrl", description="what to train: a name, or a YAML file beside this one"
    )
    settings: list[str] = Field([], description="KEY=VALUE, as --set takes them")
    certificates: Path | None = Field(
        None, description="folder of certificates, made when it is missing; else RUN.certs"
    )
    learner: LearnerHost
    sites: list[SiteHost] = Field([], description="doors between the learner and some actors")
    actors: list[ActorHosts] = Field([], description="machines with actors")
    slurm: list[SlurmActors] = Field([], description="actors that Slurm places")
    evaluator: HostConfig | None = Field(
        None, description="who validates; nobody if it is left out"
    )

    @model_validator(mode="after")
    def _names_meet(self) -> ClusterConfig:
        names = [site.name for site in self.sites]
        if len(set(names)) < len(names):
            raise ValueError("sites: two have the same name")
        for part in (*self.actors, *self.slurm):
            if part.site is not None and part.site not in names:
                known = ", ".join(names) or "none"
                raise ValueError(f"actors name the site {part.site}, which is not there; {known}")
        if not (self.actors or self.slurm):
            raise ValueError("neither actors nor slurm: nobody would simulate")
        return self


@dataclass(frozen=True)
class Job:
    """One command on one host. ``name`` is unique in the cluster; ``role``: of its certificate."""

    name: str
    role: str
    place: HostConfig
    host: str
    words: tuple[str, ...]


@dataclass(frozen=True)
class Cluster:
    """A cluster file, ``path``, as it is used."""

    path: Path
    config: ClusterConfig

    @property
    def certificates(self) -> Path:
        """Folder of the certificates, on this machine."""
        named = self.config.certificates or Path(f"{self.config.run}.certs")
        return self.path.parent / named.expanduser()

    @property
    def state(self) -> Path:
        """File that remembers what Slurm was asked for."""
        return self.path.parent / f"{self.config.run}.up.json"

    @property
    def configuration(self) -> Path:
        """The YAML file of what is trained; raises UserError where there is none."""
        return find("configuration", self.config.configuration, self.path.parent)

    def learner_address(self) -> str:
        """How the others reach the learner."""
        return self.config.learner.address or self.config.learner.host

    def site_addresses(self) -> list[str]:
        """How actors reach the doors of their sites."""
        return [site.address or site.host for site in self.config.sites]

    def endpoint(self, site: str | None = None) -> str:
        """Where actors connect to: the learner, or the door of ``site``."""
        for each in self.config.sites:
            if each.name == site:
                return f"tls/{each.address or each.host}:{each.listen}"
        return f"tls/{self.learner_address()}:{self.config.learner.listen}"

    def learner(self, configuration: str, resume: bool) -> Job:
        """The learner's command; ``configuration`` is the file's name there."""
        place, config = self.config.learner, self.config
        words = ["learner", "--run", config.run, "--listen", f"tls/0.0.0.0:{place.listen}"]
        words += ["--resume"] if resume else [configuration]
        words += [part for each in config.settings for part in ("--set", each)]
        return Job("learner", "learner", place, place.host, (*words, *place.options))

    def others(self) -> Iterator[Job]:
        """Doors first, then everybody who connects to them."""
        for door in self.config.sites:
            words = ("site", "--connect", self.endpoint(), "--listen", f"tls/0.0.0.0:{door.listen}")
            yield Job(f"site-{door.name}", "site", door, door.host, (*words, *door.options))
        number = 0
        for part in self.config.actors:
            for host in part.host:
                to = self.endpoint(part.site)
                words = ("actor", "--connect", to, "--count", str(part.count))
                yield Job(f"actors-{number}", "actor", part, host, (*words, *part.options))
                number += 1
        if (place := self.config.evaluator) is not None:
            words = ("evaluator", "--connect", self.endpoint())
            yield Job("evaluator", "evaluator", place, place.host, (*words, *place.options))


def load_cluster(path: Path) -> Cluster:
    """Read a cluster file; raises UserError naming file, key and mend."""
    if not path.is_file():
        raise UserError(f"{path}: no such cluster file; deploy/cluster.yaml is one to begin with")
    return Cluster(path.absolute(), validate(ClusterConfig, load_yaml(path), str(path)))
