#!/usr/bin/env python3
"""What can be said of the container files without an engine: they parse, and agree with each other and with the server.

usage: containers_test.py STILLMAP
"""

import os
import re
import subprocess
import sys
import unittest

import support

FOLDER = support.DEPLOY / "containers"
INSTRUCTION = re.compile(r"\A(FROM|WORKDIR|COPY|RUN|USER|VOLUME|EXPOSE|ENV|HEALTHCHECK|ENTRYPOINT|CMD) ")


def dockerfile():
    """Its instructions, lines that are continued joined."""
    text = re.sub(r"\\\n", " ", (FOLDER / "Dockerfile").read_text())
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def documents(name):
    import yaml
    return list(yaml.safe_load_all((FOLDER / name).read_text()))


def longest_end_s():
    drain = support.without_comments(support.DEPLOY / "stillmap.json")["drain"]
    return drain["delay_s"] + drain["timeout_s"] + 5


class Containers(unittest.TestCase):
    def test_the_image_is_of_known_instructions_and_runs_as_its_user(self):
        lines = dockerfile()
        for line in lines:
            self.assertRegex(line, INSTRUCTION)
        last_stage = lines[max(number for number, line in enumerate(lines) if line.startswith("FROM")):]
        self.assertEqual([line for line in last_stage if line.startswith("USER")], ["USER 10001:10001"])
        self.assertEqual({line.split()[1] for line in lines if line.startswith("FROM")}, {"debian:12-slim"})

    def test_its_environment_is_a_configuration(self):
        environment = dict(re.findall(r"(STILLMAP_\w+)=(\S+)", " ".join(dockerfile())))
        environment["STILLMAP_SERVE_CONFIG"] = str(support.DEPLOY / "stillmap.json")
        done = subprocess.run([sys.argv[1], "serve", "--print-config"], env={**os.environ, **environment}, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_compose_gives_it_little(self):
        (compose,) = documents("compose.yaml")
        service = compose["services"]["stillmap"]
        self.assertTrue(service["read_only"])
        self.assertEqual(service["cap_drop"], ["ALL"])
        self.assertTrue((FOLDER / service["build"]["context"] / service["build"]["dockerfile"]).exists())
        self.assertGreaterEqual(int(service["stop_grace_period"].rstrip("s")), longest_end_s())
        for port in service["ports"]:
            self.assertTrue(port.startswith("127.0.0.1:"), port)
        self.assertIn(service["volumes"][0].split(":")[0], compose["volumes"])

    def test_kubernetes_parts_name_each_other(self):
        claim, deployment, service = documents("kubernetes.yaml")
        self.assertEqual([each["kind"] for each in (claim, deployment, service)],
                         ["PersistentVolumeClaim", "Deployment", "Service"])
        template = deployment["spec"]["template"]
        pod, (container,) = template["spec"], template["spec"]["containers"]
        self.assertEqual(deployment["spec"]["selector"]["matchLabels"], template["metadata"]["labels"])
        self.assertEqual(service["spec"]["selector"], template["metadata"]["labels"])
        ports = {port["name"]: port["containerPort"] for port in container["ports"]}
        self.assertIn(service["spec"]["ports"][0]["targetPort"], ports)
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            self.assertEqual(container[probe]["httpGet"]["port"], "management")
        self.assertEqual(ports["management"], support.without_comments(support.DEPLOY / "stillmap.json")["management"]["port"])
        self.assertEqual({mount["name"] for mount in container["volumeMounts"]}, {volume["name"] for volume in pod["volumes"]})
        self.assertEqual(pod["volumes"][0]["persistentVolumeClaim"]["claimName"], claim["metadata"]["name"])
        user = [line.split()[1] for line in dockerfile() if line.startswith("USER")]
        self.assertEqual([f"{pod['securityContext']['runAsUser']}:{pod['securityContext']['runAsGroup']}"], user)
        self.assertTrue(pod["securityContext"]["runAsNonRoot"])
        self.assertTrue(container["securityContext"]["readOnlyRootFilesystem"])
        self.assertGreaterEqual(pod["terminationGracePeriodSeconds"], longest_end_s())

    def test_jobs_are_bounded_well_below_the_memory_of_all(self):
        _, deployment, _ = documents("kubernetes.yaml")
        (pod,) = deployment["spec"]["template"]["spec"]["containers"]
        (compose,) = documents("compose.yaml")
        service = compose["services"]["stillmap"]
        for limit, environment in ((pod["resources"]["limits"]["memory"], {each["name"]: each["value"] for each in pod.get("env", [])}),
                                   (service["deploy"]["resources"]["limits"]["memory"], service.get("environment", {}))):
            limit_bytes = int(re.fullmatch(r"(\d+)(Gi|g)", limit)[1]) << 30
            # One job at a time, by default.
            self.assertIn(int(environment["STILLMAP_SERVE_JOBS_MEMORY_BYTES"]), range(1 << 30, limit_bytes // 2 + 1))
            self.assertIn("STILLMAP_SERVE_JOBS_CORES", environment)
            configuration = {"STILLMAP_SERVE_CONFIG": str(support.DEPLOY / "stillmap.json")}
            done = subprocess.run([sys.argv[1], "serve", "--print-config"], env={**os.environ, **configuration, **environment},
                                  capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)

    def test_the_shell_is_beside_the_same_store_as_the_same_user(self):
        claim, deployment, _ = documents("kubernetes.yaml")
        (shell,) = documents("kubernetes-shell.yaml")
        server = deployment["spec"]["template"]["spec"]
        self.assertEqual(shell["spec"]["volumes"][0]["persistentVolumeClaim"]["claimName"], claim["metadata"]["name"])
        for key in ("image", "securityContext"):
            self.assertEqual(shell["spec"]["containers"][0][key], server["containers"][0][key])
        for key in ("runAsNonRoot", "runAsUser", "runAsGroup", "fsGroup"):
            self.assertEqual(shell["spec"]["securityContext"][key], server["securityContext"][key])


if __name__ == "__main__":
    try:
        import yaml  # noqa: F401
    except ImportError:
        support.skip_program("python3-yaml is not installed")
    unittest.main(argv=sys.argv[:1])
