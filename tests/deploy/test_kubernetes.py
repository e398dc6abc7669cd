"""The kustomize bases: valid by the published schemas, and their names, ports, images and arguments agree."""

import copy
import re
import subprocess
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml
from typer.main import get_command

from agent.config import ProcessConfig
from deploy import cli
from deploy.config import RunConfig
from protocol.configuration import load

REPO = Path(__file__).parents[2]
BASE = REPO / "deploy" / "kubernetes"
SCHEMAS = "1.37"


class Base:
    """A folder for `kubectl apply --kustomize`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.kustomization = yaml.safe_load((folder / "kustomization.yaml").read_text())
        files = self.kustomization["resources"]
        self.resources = [one for file in files for one in yaml.safe_load_all((folder / file).read_text())]

    def the(self, kind: str, name: str) -> dict[str, Any]:
        (found,) = (one for one in self.resources if (one["kind"], one["metadata"]["name"]) == (kind, name))
        return dict(found)

    def pods(self) -> list[dict[str, Any]]:
        return [one["spec"]["template"]["spec"] for one in self.resources if "template" in one.get("spec", {})]


RUN, SWEEP = Base(BASE), Base(BASE / "sweep")
BASES = pytest.mark.parametrize("base", [RUN, SWEEP], ids=lambda base: base.folder.name)
KUSTOMIZATION, the = RUN.kustomization, RUN.the


WORLD, AGENTS, SERVICE = the("StatefulSet", "world"), the("Job", "agents"), the("Service", "world")
PODS = {"world": WORLD["spec"]["template"], "agent": AGENTS["spec"]["template"]}


@pytest.mark.parametrize(
    "resource", RUN.resources + SWEEP.resources, ids=lambda one: f"{one['kind']}-{one['metadata']['name']}"
)
def test_resources_are_valid(resource: dict[str, Any]) -> None:
    kubernetes_validate.validate(resource, SCHEMAS, strict=True)
    wrong = copy.deepcopy(resource) | {"spce": {}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, SCHEMAS, strict=True)


def test_certificates_are_neither_committed_nor_in_an_image() -> None:
    assert "certs/" in (REPO / ".gitignore").read_text().splitlines()
    assert "deploy/kubernetes" in (REPO / ".dockerignore").read_text().splitlines()


@BASES
def test_a_base_holds_each_file_of_its_folder(base: Base) -> None:
    assert {file.name for file in base.folder.glob("*.yaml")} == {
        *base.kustomization["resources"],
        "kustomization.yaml",
    }
    names = [one["metadata"]["name"] for one in base.resources if one["kind"] == "Namespace"]
    assert names == [base.kustomization["namespace"]]


def parsed(command: str, words: list[str]) -> dict[str, Any]:
    """Options as the command line would take them; an error where it would not."""
    context = get_command(cli.app).commands[command].make_context(command, words)  # type: ignore[attr-defined]
    return dict(context.params)


def test_arguments_are_those_of_the_command_line_and_agree() -> None:
    (world,), (agent,) = (pod["spec"]["containers"] for pod in PODS.values())
    (begins,) = re.findall(r'wireswarm world (.*) "\$@" &', world["command"][2])
    told = parsed("world", [*begins.split(), "--out=/runs/run", *world["args"]])
    settings = load(RunConfig, None, {"robots": told["robots"], "world": told["world"]}, told["set_"])
    joins = parsed("agent", agent["args"])
    assert joins["certs"] == told["certs"] == Path("/certs")
    load(ProcessConfig, None, {}, joins["set_"])
    assert settings.robots == AGENTS["spec"]["completions"] == AGENTS["spec"]["parallelism"]
    port = SERVICE["spec"]["ports"][0]["port"]
    assert told["listen"] == f"tls/0.0.0.0:{port}" and joins["connect"] == f"tls/{WORLD['spec']['serviceName']}:{port}"
    assert world["ports"][0]["containerPort"] == port
    assert f":{port:04X} 01" in agent["readinessProbe"]["exec"]["command"]
    identities = {one["name"]: {Path(file).name for file in one["files"]} for one in KUSTOMIZATION["secretGenerator"]}
    assert identities["robot-identities"] == {
        "ca.pem", *(f"{robot}.{kind}" for robot in settings.robot_ids for kind in ("pem", "key")),
    }  # fmt: skip
    secrets = {
        volume["secret"]["secretName"]
        for pod in PODS.values()
        for volume in pod["spec"]["volumes"]
        if "secret" in volume
    }
    assert secrets == set(identities)


def test_who_may_reach_whom() -> None:
    port = SERVICE["spec"]["ports"][0]["port"]
    into, out_of = the("NetworkPolicy", "world")["spec"], the("NetworkPolicy", "agent")["spec"]
    assert into["policyTypes"] == out_of["policyTypes"] == ["Ingress", "Egress"]
    assert "egress" not in into and "ingress" not in out_of
    for name, pod in PODS.items():
        assert pod["metadata"]["labels"] == the("NetworkPolicy", name)["spec"]["podSelector"]["matchLabels"]
    assert SERVICE["spec"]["selector"] == PODS["world"]["metadata"]["labels"]
    assert into["ingress"] == [
        {"from": [{"podSelector": out_of["podSelector"]}], "ports": [{"protocol": "TCP", "port": port}]}
    ]
    assert out_of["egress"][0] == {"to": [{"podSelector": into["podSelector"]}], "ports": into["ingress"][0]["ports"]}


@BASES
def test_containers_have_no_rights_and_bounds(base: Base) -> None:
    targets = re.findall(r"^FROM .* AS (\S+)$", (REPO / "deploy" / "Dockerfile").read_text(), re.MULTILINE)
    images = {one["name"] for one in base.kustomization["images"]}
    for pod in base.pods():
        assert pod["securityContext"]["runAsNonRoot"] and not pod["automountServiceAccountToken"]
    for container in (one for pod in base.pods() for one in (*pod.get("initContainers", []), *pod["containers"])):
        assert container["image"] in images and container["image"].removeprefix("wireswarm-") in targets
        rights = container["securityContext"]
        assert rights["readOnlyRootFilesystem"] and not rights["allowPrivilegeEscalation"]
        assert rights["capabilities"] == {"drop": ["ALL"]}
        assert set(container["resources"]["limits"]) == set(container["resources"]["requests"]) == {"cpu", "memory"}


@pytest.mark.parametrize(
    ("left", "called"),
    [
        ([], "world --listen=tls/0.0.0.0:7447 --certs=/certs --out=RUNS/run --robots=3"),
        (["manifest.json"], "world --listen=tls/0.0.0.0:7447 --certs=/certs --out=RUNS/run --robots=3"),
        (["manifest.json", "checkpoint.msgpack"], "world --listen=tls/0.0.0.0:7447 --certs=/certs --resume=RUNS/run"),
        (["manifest.json", "summary.json"], ""),
    ],
)
def test_a_world_begins_goes_on_or_has_ended(left: list[str], called: str, tmp_path: Path) -> None:
    run = tmp_path / "runs" / "run"
    for name in left:
        run.mkdir(parents=True, exist_ok=True)
        (run / name).touch()
    ends = f"mkdir -p {run}; touch {run}/summary.json; rm -f {run}/checkpoint.msgpack"
    assert world_container(tmp_path, ends) == (0, called.replace("RUNS", str(tmp_path / "runs")))


def test_a_world_that_is_killed_is_started_again_and_goes_on(tmp_path: Path) -> None:
    """Its container stayed, without a world. A summary may be there before the run has ended."""
    run = tmp_path / "runs" / "run"
    dies = f"mkdir -p {run}; touch {run}/summary.json {run}/checkpoint.msgpack; false"
    for told in ("--out", "--resume"):
        status, called = world_container(tmp_path, dies)
        assert status == 1 and f"{told}={run}" in called


@pytest.mark.parametrize(("last_s", "is_again"), [("0.0", True), ("12.4", False)])
def test_a_run_that_never_began_is_tried_again(last_s: str, is_again: bool, tmp_path: Path) -> None:
    """A world whose robots came too late stayed as if its run had ended."""
    run = tmp_path / "runs" / "run"
    metrics = f"printf 't,robot\\n{last_s},team\\n' > {run}/metrics.csv"
    status, _ = world_container(tmp_path, f"mkdir -p {run}; touch {run}/summary.json; {metrics}; return 1")
    assert (status, run.exists()) == (int(is_again), not is_again)


def world_container(folder: Path, world: str) -> tuple[int, str]:
    """Status of the world's container with runs in a folder, and how it called `wireswarm`, which does as told."""
    calls = folder / "calls"
    shell, option, script, name = PODS["world"]["spec"]["containers"][0]["command"]
    stand_ins = f'wireswarm() {{ echo "$@" > {calls}; {world}; }}\nsleep() {{ :; }}\n'
    command = [shell, option, stand_ins + script.replace("/runs", str(folder / "runs")), name, "--robots=3"]
    status = subprocess.run(command, timeout=20, check=False).returncode
    return status, calls.read_text().strip() if calls.exists() else ""


def test_a_robot_takes_its_own_identity_only(tmp_path: Path) -> None:
    (tmp_path / "certs").mkdir()
    (tmp_path / "identities").mkdir()
    for name in ("ca.pem", "r1.pem", "r1.key", "r2.pem", "r2.key"):
        (tmp_path / "identities" / name).touch()
    shell, option, script = PODS["agent"]["spec"]["initContainers"][0]["command"]
    for folder in ("identities", "certs"):
        script = script.replace(f"/{folder}", f"{tmp_path}/{folder}")
    subprocess.run([shell, option, script], env={"JOB_COMPLETION_INDEX": "1", "PATH": "/bin"}, timeout=20, check=True)
    assert {file.name for file in (tmp_path / "certs").iterdir()} == {"ca.pem", "r2.pem", "r2.key"}


def test_a_scheduler_and_its_workers_are_those_of_compose_and_reach_each_other_only() -> None:
    services = yaml.safe_load((REPO / "deploy" / "compose.yaml").read_text())["services"]
    (identity,) = SWEEP.kustomization["secretGenerator"]
    for name in ("scheduler", "worker"):
        template = SWEEP.the("Deployment", name)["spec"]["template"]
        (container,) = template["spec"]["containers"]
        assert container["command"] + container["args"] == services[name]["entrypoint"]
        assert container["readinessProbe"]["exec"]["command"] == services[name]["healthcheck"]["test"][1:]
        assert {volume["secret"]["secretName"] for volume in template["spec"]["volumes"] if "secret" in volume} == {
            identity["name"]
        }
        assert {word.split("=")[1] for word in container["args"] if word.startswith("--tls")} == {
            file.replace("certs/", "/certs/") for file in identity["files"]
        }
    (port,) = SWEEP.the("Service", "scheduler")["spec"]["ports"]
    assert f"--port={port['port']}" in services["scheduler"]["entrypoint"]
    assert f"tls://scheduler:{port['port']}" in services["worker"]["entrypoint"]
    assert f":{port['port']:04X} 01" in services["worker"]["healthcheck"]["test"]
    scheduler, worker = (SWEEP.the("NetworkPolicy", name)["spec"] for name in ("scheduler", "worker"))
    for one, other, at in ((scheduler, worker, port["port"]), (worker, scheduler, 8788)):
        ports = [{"protocol": "TCP", "port": at}]
        assert one["ingress"] == [{"from": [{"podSelector": other["podSelector"]}], "ports": ports}]
        assert other["egress"][0] == {"to": [{"podSelector": one["podSelector"]}], "ports": ports}
    assert "--worker-port=8788" in services["worker"]["entrypoint"]
