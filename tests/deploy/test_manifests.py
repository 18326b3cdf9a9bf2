"""What deploy/ declares: valid by the schemas where they are installed, and as closed as its pages say."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

from idic.cli.outcomes import NOT_CONVERGED
from idic.run.workers.dask_settings import KEEP_MEMORY

DEPLOY = Path(__file__).parents[2] / "deploy"
MANIFESTS = sorted((DEPLOY / "kubernetes").glob("*.yaml"))
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
KUBERNETES_VERSION = "1.30"


def documents():
    return [(file.name, document) for file in MANIFESTS for document in yaml.safe_load_all(file.read_text())]


def of_kind(kind):
    return [document for _, document in documents() if document["kind"] == kind]


def pods():
    """(name, pod spec) of everything that runs."""
    found = []
    for name, document in documents():
        if document["kind"] == "DaskCluster":
            found += [(f"{name} {part}", document["spec"][part]["spec"]) for part in ("worker", "scheduler")]
        elif document["kind"] == "Job":
            found.append((f"{name} job", document["spec"]["template"]["spec"]))
    return found


every_pod = pytest.mark.parametrize("pod", [pytest.param(pod, id=name) for name, pod in pods()])


# Kubernetes -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("document", [pytest.param(d, id=f"{name} {d['kind']}") for name, d in documents()])
def test_a_manifest_fits_the_schema_of_its_kind(document):
    if document["kind"] == "DaskCluster":
        if find_spec("dask_kubernetes") is None:
            pytest.skip("dask-kubernetes, which has the schema of DaskCluster, is not installed")
        import jsonschema

        folder = Path(find_spec("dask_kubernetes").submodule_search_locations[0])
        crd = yaml.safe_load(next(folder.rglob("crds/daskcluster.yaml")).read_text())
        schema = _closed(crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"])
        schema["properties"] |= {"apiVersion": {"const": "kubernetes.dask.org/v1"}, "kind": {"const": "DaskCluster"},
                                 "metadata": {"type": "object"}}  # known to Kubernetes itself
        jsonschema.validate(json.loads(json.dumps(document)), schema)
        return
    if find_spec("kubernetes_validate") is None:
        pytest.skip("kubernetes-validate, which has the schemas of Kubernetes, is not installed")
    import kubernetes_validate

    kubernetes_validate.validate(document, KUBERNETES_VERSION, strict=True)


def _closed(schema):
    """The schema with unknown keys refused, as the API server's strict validation does."""
    if isinstance(schema, dict):
        found = {key: _closed(value) for key, value in schema.items()}
        open_ended = "additionalProperties" in found or found.get("x-kubernetes-preserve-unknown-fields")
        if isinstance(found.get("properties"), dict) and not open_ended:
            found["additionalProperties"] = False
        if found.get("x-kubernetes-int-or-string"):
            found.pop("type", None)
        return found
    return [_closed(entry) for entry in schema] if isinstance(schema, list) else schema


@every_pod
def test_a_pod_runs_without_root_and_without_rights(pod):
    assert pod["securityContext"]["runAsNonRoot"] and pod["securityContext"]["runAsUser"] >= 10000
    assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert pod["automountServiceAccountToken"] is False
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(pod)
    for container in pod["containers"]:
        rights = container["securityContext"]
        assert rights["capabilities"] == {"drop": ["ALL"]} and rights["allowPrivilegeEscalation"] is False
        assert rights["readOnlyRootFilesystem"] is True


@every_pod
def test_a_pod_has_limits_a_pinned_image_and_its_key_from_a_secret(pod):
    for container in pod["containers"]:
        assert set(container["resources"]["limits"]) == {"cpu", "memory"}
        assert re.search(r":\d+\.\d+\.\d+$", container["image"])
        assert {"configMapRef": {"name": "dask-tls"}} in container["envFrom"]
    secret = next(volume["secret"] for volume in pod["volumes"] if volume["name"] == "tls")
    assert secret["defaultMode"] & 0o037 == 0, "nobody but owner and group reads the key"


def test_dask_speaks_tls_only_and_shows_its_pages_on_the_loopback_interface():
    settings = of_kind("ConfigMap")[0]["data"]
    assert settings["DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION"] == "true"
    (cluster,) = of_kind("DaskCluster")
    for part in ("worker", "scheduler"):
        arguments = cluster["spec"][part]["spec"]["containers"][0]["args"]
        assert arguments[arguments.index("--protocol") + 1] == "tls"
        assert arguments[arguments.index("--dashboard-address") + 1].startswith("127.0.0.1:")
    assert cluster["spec"]["scheduler"]["service"]["type"] == "ClusterIP"
    assert not re.search(r"tcp://", "".join(file.read_text() for file in MANIFESTS))


def test_the_network_policy_lets_no_pod_in_from_outside_the_namespace():
    (policy,) = of_kind("NetworkPolicy")
    spec = policy["spec"]
    assert spec["podSelector"] == {} and set(spec["policyTypes"]) == {"Ingress", "Egress"}
    assert spec["ingress"] == [{"from": [{"podSelector": {}}]}]
    out = [rule for rule in spec["egress"] if rule["to"] != [{"podSelector": {}}]]
    assert [{port["port"] for port in rule["ports"]} for rule in out] == [{53}]


def test_a_driver_that_found_no_scheduler_is_tried_again():
    """A scheduler that is lost or not up yet is code 2, as bad input; what did not converge does not get better."""
    for job in of_kind("Job"):
        final = [code for rule in job["spec"]["podFailurePolicy"]["rules"] for code in rule["onExitCodes"]["values"]]
        assert final == [NOT_CONVERGED] and job["spec"]["backoffLimit"] > 0


# compose --------------------------------------------------------------------------------------------
def test_the_compose_file_fits_its_schema():
    if find_spec("compose") is None:
        pytest.skip("docker-compose (the Python one), which has the schema of the file, is not installed")
    import jsonschema

    folder = Path(find_spec("compose").submodule_search_locations[0])
    jsonschema.validate(COMPOSE, json.loads(next(folder.rglob("compose_spec.json")).read_text()))


@pytest.mark.parametrize("name", COMPOSE["services"])
def test_a_service_has_few_rights_and_a_limit(name):
    service = COMPOSE["services"][name]
    assert service["cap_drop"] == ["ALL"] and service["security_opt"] == ["no-new-privileges:true"]
    assert service["read_only"] is True and "mem_limit" in service and "user" in service


def test_ports_are_published_on_this_machine_only():
    ports = [port for service in COMPOSE["services"].values() for port in service.get("ports", ())]
    assert ports and all(port.startswith("127.0.0.1:") for port in ports)
    assert COMPOSE["networks"]["cluster"] == {"internal": True}


def test_secrets_are_files_and_stand_nowhere_else():
    assert all(set(secret) == {"file"} for secret in COMPOSE["secrets"].values())
    text = (DEPLOY / "compose.yaml").read_text()
    assert "BEGIN" not in text and not re.search(r"AUTH_STRING: ", text)
    ignored = (DEPLOY.parent / ".gitignore").read_text().split()
    assert "deploy/secrets/" in ignored, "nobody commits a key by mistake"


def test_a_user_without_rights_can_write_into_every_named_volume():
    """Docker makes a new volume with the rights of its folder in the image, and as root's where there is none."""
    mounted = [volume.split(":") for service in COMPOSE["services"].values() for volume in service.get("volumes", ())]
    places = [place for name, place, *_ in mounted if name in COMPOSE["volumes"]]
    image = (DEPLOY / "Dockerfile").read_text().rpartition("\nFROM ")[2]
    assert places and all(re.search(rf"install -d -m 1777 (.* )?{place}\b", image) for place in places)


def test_dask_in_compose_speaks_tls_only():
    for name in ("scheduler", "worker"):
        service = COMPOSE["services"][name]
        assert any(str(word).startswith("tls://") for word in service["command"])
        assert service["environment"]["DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION"] == "true"


# workers that idic does not start -------------------------------------------------------------------
@pytest.mark.parametrize("file", ["Dockerfile", "README.md"])
def test_workers_everywhere_keep_their_memory_as_those_of_idic_do(file):
    """Read by glibc when a process starts; `slurm_cluster.py` takes the values from idic itself."""
    text = (DEPLOY / file).read_text()
    assert dict(re.findall(r"(MALLOC_\w+_)=(\d+)", text)) == KEEP_MEMORY
    assert "DASK_DISTRIBUTED__WORKER__MEMORY__PAUSE=false" in text


# image ----------------------------------------------------------------------------------------------
def test_the_image_is_pinned_runs_without_root_and_says_whether_it_is_healthy():
    lines = (DEPLOY / "Dockerfile").read_text().splitlines()
    bases = [line.split()[1] for line in lines if line.startswith("FROM ")]
    assert bases and all(re.fullmatch(r"python:3\.\d+\.\d+-slim-\w+", base) for base in bases)
    users = [line.split()[1] for line in lines if line.startswith("USER ")]
    assert users and users[-1].split(":")[0].isdigit() and int(users[-1].split(":")[0]) >= 10000
    assert any(line.startswith("HEALTHCHECK ") for line in lines)
    copies = [line.split() for line in lines if line.startswith("COPY ") and "--from" not in line]
    copied = [word for words in copies for word in words[1:-1]]
    assert all((DEPLOY.parent / name).exists() for name in copied)
    assert "." not in copied and "deploy" not in copied, "no secret of the working folder gets into the image"


def test_commands_of_the_page_that_need_prefect_know_its_password():
    """`run` and `exec` replace the command of the service, which exports it."""
    page = (DEPLOY / "compose.md").read_text()
    commands = re.findall(r"^    docker compose .* (?:run|exec) (?:.*\\\n)*.*$", page, re.MULTILINE)
    assert len(commands) == 2
    assert all("PREFECT_API_AUTH_STRING=$(cat /run/secrets/prefect_auth)" in command for command in commands)
