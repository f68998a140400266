#!/usr/bin/env python3
"""Alerts and the dashboard: judged by promtool, and every metric and label in them is one that the server has.

usage: monitoring_test.py STILLMAP METRICS_TABLE TOOLS
"""

import json
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

import support

PROGRAM = sys.argv[1]
TABLE = pathlib.Path(sys.argv[2])
PROMTOOL = support.tool("promtool", sys.argv[3])
FOLDER = support.DEPLOY / "monitoring"
ROW = re.compile(r'MetricInfo\{\s*"(\w+)",\s*"(\w+)",\s*"([\w,]*)"')
SUFFIXES = {"histogram": ("_bucket", "_sum", "_count"), "counter": ("",), "gauge": ("",)}
# Prometheus adds these to everything that it scrapes.
ADDED = {"job", "instance"}


def series_of_table():
    """Labels by name of series."""
    found = {}
    for name, kind, labels in ROW.findall(TABLE.read_text()):
        for suffix in SUFFIXES[kind]:
            found[name + suffix] = set(labels.split(",")) - {""} | ADDED | ({"le"} if suffix == "_bucket" else set())
    return found


def selectors(expression):
    """(name of a series, names of the labels that select it)"""
    for name, braces in re.findall(r"\b((?:stillmap|process)_\w+|up\b)(?:\{(.*?)\})?", expression):
        yield name, set(re.findall(r"(\w+)\s*(?:=~|!~|!=|=)", braces))


def grouped(expression):
    """(labels that are grouped by, names of the series in it)"""
    labels = {label for group in re.findall(r"\b(?:by|on) \(([^)]*)\)", expression) for label in re.split(r",\s*", group)}
    return labels - {""}, [name for name, _ in selectors(expression)]


def rule_expressions():
    import yaml
    groups = yaml.safe_load((FOLDER / "stillmap.rules.yml").read_text())["groups"]
    return [rule["expr"] for group in groups for rule in group["rules"]]


def dashboard_expressions():
    """With what Grafana puts in for its variables."""
    panels = json.loads((FOLDER / "grafana/stillmap.json").read_text())["panels"]
    for panel in panels:
        for target in panel.get("targets", []):
            yield target["expr"].replace("$__rate_interval", "1m").replace("$instance", ".*")


class Alerts(support.FolderTest):
    def promtool(self, *arguments):
        folder = self.folder / "all"
        shutil.copytree(FOLDER, folder)
        shutil.copy(support.HERE / "stillmap.rules.test.yml", folder)
        done = subprocess.run([PROMTOOL, *arguments], capture_output=True, text=True, cwd=folder, timeout=60)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_prometheus_can_read_the_configuration_and_its_rules(self):
        self.promtool("check", "config", "prometheus.yml")

    def test_each_alert_is_silent_when_well_and_fires_when_not(self):
        self.promtool("test", "rules", "stillmap.rules.test.yml")
        text = (support.HERE / "stillmap.rules.test.yml").read_text()
        for alert in re.findall(r"alert: (\w+)", (FOLDER / "stillmap.rules.yml").read_text()):
            self.assertEqual(len(re.findall(rf"\b{alert}\b", text)), 2, alert)

    def test_prometheus_understands_the_dashboard(self):
        rules = [{"record": f"panel:{number}", "expr": expression} for number, expression in enumerate(dashboard_expressions())]
        self.assertGreater(len(rules), 40)
        file = self.folder / "dashboard.rules.yml"
        file.write_text(json.dumps({"groups": [{"name": "dashboard", "rules": rules}]}))
        done = subprocess.run([PROMTOOL, "check", "rules", file], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_what_the_server_tells_is_as_prometheus_wants_it(self):
        store, management = self.folder / "store", support.free_port()
        store.mkdir()
        self.start_server(PROGRAM, store, "--management-port", management)
        status, text = support.get(management, "/metrics")
        self.assertEqual(status, 200)
        # What has labels of its own is told from the first event on.
        told = set(re.findall(r"^# TYPE (\w+)", text, re.MULTILINE))
        with_events = {name for name, _, labels in ROW.findall(TABLE.read_text()) if labels} | {
            "stillmap_tls_certificate_end_timestamp_seconds"}
        for expression in dashboard_expressions():
            for name, _ in selectors(expression):
                self.assertIn(re.sub(r"_(bucket|sum|count)$", "", name), told | with_events | {"up"}, expression)
        done = subprocess.run([PROMTOOL, "check", "metrics"], input=text, capture_output=True, text=True, timeout=60)
        self.assertEqual((done.returncode, done.stderr), (0, ""))


class Names(unittest.TestCase):
    def test_every_metric_and_label_is_one_that_the_server_has(self):
        table = {**series_of_table(), "up": set(ADDED)}
        self.assertGreater(len(table), 30)
        for expression in [*rule_expressions(), *dashboard_expressions()]:
            names = list(selectors(expression))
            self.assertTrue(names or "haproxy_" in expression, expression)  # HAProxy's are looked at in proxy_test.py
            for name, labels in names:
                self.assertIn(name, table, expression)
                self.assertLessEqual(labels, table[name], expression)
            labels, used = grouped(expression)
            for name in used:
                self.assertLessEqual(labels, table[name], expression)


if __name__ == "__main__":
    try:
        import yaml  # noqa: F401
    except ImportError:
        support.skip_program("python3-yaml is not installed")
    unittest.main(argv=sys.argv[:1])
