"""What alerts and the board ask for is there, with the labels they use, on a live /metrics page."""

from __future__ import annotations

import json
import re
import urllib.request
from collections.abc import Iterator

import numpy as np
import orenx
import promql_parser
import pytest
import scene
import yaml
from servers import ROOT, start

MONITORING = ROOT / "deploy/monitoring"
# What Prometheus itself adds: the series `up`, and the labels of a target.
ADDED = {"job", "instance"}


KEY = "0123456789abcdef"


@pytest.fixture(scope="module")
def metrics(tmp_path_factory) -> dict[str, set[str]]:
    """The labels of every sample, by its name, once frames and questions have come."""
    config = tmp_path_factory.mktemp("settings") / "orenx.toml"
    config.write_text(f'[[auth.keys]]\nname = "test"\nrole = "admin"\nkey = "{KEY}"\n')
    server = start(zenoh=True, config=config)
    try:
        with orenx.connect(server.grpc, api_key=KEY) as client:
            m = client.map("default")
            m.stream_frames(scene.frames(2), "rover")
            m.query_points(np.zeros((1, 3)))
        with orenx.connect(server.zenoh) as client:
            client.map("default").query_points(np.zeros((1, 3)))
        ask(f"{server.http}/v1/maps")
        page = ask(f"{server.http}/metrics")
    finally:
        server.stop()
    found: dict[str, set[str]] = {"up": set()}
    for line in page.splitlines():
        sample = re.match(r"(\w+)(?:\{(.*)\})? ", line)
        if sample and not line.startswith("#"):
            labels = re.findall(r'(\w+)="', sample[2] or "")
            found.setdefault(sample[1], set()).update(labels)
    return found


def ask(url: str) -> str:
    with urllib.request.urlopen(urllib.request.Request(url, headers={"api-key": KEY})) as answer:
        return answer.read().decode()


def alerts() -> dict[str, str]:
    groups = yaml.safe_load((MONITORING / "alerts.yml").read_text())["groups"]
    return {rule["alert"]: rule["expr"] for group in groups for rule in group["rules"]}


def board() -> dict[str, str]:
    dashboard = json.loads((MONITORING / "grafana/dashboards/orenx.json").read_text())
    targets = {
        f"{panel['title']} {target['refId']}": target["expr"]
        for panel in dashboard["panels"]
        for target in panel.get("targets", [])
    }
    variables = {
        f"${variable['name']}": re.fullmatch(r"label_values\((.*), (\w+)\)", variable["definition"])
        for variable in dashboard["templating"]["list"]
        if variable["type"] == "query"
    }
    return {**targets, **{name: f"count by ({m[2]}) ({m[1]})" for name, m in variables.items()}}


def legends() -> dict[str, tuple[str, set[str]]]:
    """The expression of each target, and the labels that its legend names."""
    dashboard = json.loads((MONITORING / "grafana/dashboards/orenx.json").read_text())
    return {
        f"{panel['title']} {target['refId']}": (
            target["expr"],
            set(re.findall(r"{{(\w+)}}", target["legendFormat"])),
        )
        for panel in dashboard["panels"]
        for target in panel.get("targets", [])
    }


def asked(expression: object) -> Iterator[tuple[str, set[str]]]:
    """Names of series, and the labels that they are chosen or summed by."""
    if isinstance(expression, promql_parser.VectorSelector):
        yield expression.name, {matcher.name for matcher in expression.matchers.matchers}
    elif isinstance(expression, promql_parser.AggregateExpr):
        by = set(expression.modifier.labels) if expression.modifier else set()
        for name, labels in asked(expression.expr):
            yield name, labels | by
    elif isinstance(expression, (list, tuple)):
        for part in expression:
            yield from asked(part)
    else:
        for name in ("lhs", "rhs", "args", "expr", "vector_selector"):
            yield from asked(getattr(expression, name, ()))


EXPRESSIONS = {**alerts(), **board()}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_what_is_asked_for_is_there(metrics, name):
    series = list(asked(promql_parser.parse(EXPRESSIONS[name])))
    assert series, EXPRESSIONS[name]
    for metric, labels in series:
        assert metric in metrics, f"{metric} is not on /metrics"
        assert labels <= metrics[metric] | ADDED, f"{metric} has the labels {metrics[metric]}"


@pytest.mark.parametrize("name", legends())
def test_legends_name_labels_that_are_left(metrics, name):
    expression, named = legends()[name]
    sums = re.findall(r"by \(([^)]*)\)", expression)
    left = {label.strip() for by in sums for label in by.split(",")} - {"le"}
    if not sums:
        left = set().union(*(metrics[m] for m, _ in asked(promql_parser.parse(expression))))
    assert named <= left, (named, left)


def test_a_name_that_is_not_there_would_be_found(metrics):
    expression = 'sum by (verb) (rate(orenx_frames_received_total{reason="x"}[1m])) / orenx_framez'
    found = dict(asked(promql_parser.parse(expression)))
    assert found == {"orenx_frames_received_total": {"verb", "reason"}, "orenx_framez": set()}
    assert "orenx_framez" not in metrics
    assert (
        not found["orenx_frames_received_total"] <= metrics["orenx_frames_received_total"] | ADDED
    )


def test_the_board_is_where_its_provisioning_looks():
    source = yaml.safe_load(
        (MONITORING / "grafana/provisioning/datasources/prometheus.yaml").read_text()
    )
    dashboard = json.loads((MONITORING / "grafana/dashboards/orenx.json").read_text())
    (variable,) = (v for v in dashboard["templating"]["list"] if v["type"] == "datasource")
    assert variable["current"]["value"] == source["datasources"][0]["uid"]
    ids = [panel["id"] for panel in dashboard["panels"]]
    assert len(ids) == len(set(ids))
    provider = yaml.safe_load(
        (MONITORING / "grafana/provisioning/dashboards/orenx.yaml").read_text()
    )
    compose = yaml.safe_load((ROOT / "deploy/docker/compose.yaml").read_text())
    mounted = [volume.split(":")[1] for volume in compose["services"]["grafana"]["volumes"]]
    assert provider["providers"][0]["options"]["path"] in mounted
