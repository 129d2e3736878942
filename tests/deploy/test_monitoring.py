"""deploy/monitoring: alerts and dashboard name what the exporter serves and no more; promtool holds
the rules and their tests, and a Prometheus that scrapes armd answers the dashboard's queries."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from debian_packages import Unavailable, unpacked
from ruamel.yaml import YAML

from armd import Flag
from armd.daemon.commands.groups import COMMANDS
from armd.daemon.host.metrics import MetricsServer, render
from armd.daemon.state import State
from armd.drivers.identity import Expectation
from armd.drivers.line_health import LineHealth
from armd.drivers.serial.decoder import SerialDecoder
from support.pages import page_path, shell_blocks

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "deploy" / "monitoring"
PAGE = page_path("monitoring")
ALERTS = FOLDER / "armd-alerts.yml"
TESTS = FOLDER / "armd-alerts-test.yml"
#: What Prometheus itself adds.
PROMETHEUS_OWN = {"up", "ALERTS"}
PROMETHEUS_LABELS = {"job", "instance", "alertname", "alertstate"}
PATIENCE_S = 60.0


def health(published: int = 1000) -> dict[str, Any]:
    """A health message with every flag, and the counters of the serial line."""
    counters = SerialDecoder(Expectation("A", 6, 6, (4096,) * 6), 1200.0).counters
    return {
        "serial": "A",
        "state": "READY",
        "points": {
            "published": published,
            "flagged": {str(flag.name): published // 10 for flag in Flag},
        },
        "drops": {**counters, "reconnects": LineHealth("a line", 0).reconnects},
        "latency": {"p50": 0.3, "p99": 1.0, "max": 2.0},
        "temperatures": {"t1": 20.5},
    }


def served() -> dict[str, dict[str, set[str]]]:
    """Of each metric that the exporter serves, its labels and their values."""
    found: dict[str, dict[str, set[str]]] = {}
    for line in render([health()]).splitlines():
        if line and not line.startswith("#"):
            name, _, labels = line.partition("{")
            known = found.setdefault(name, {})
            for label, value in re.findall(r'(\w+)="([^"]*)"', labels):
                known.setdefault(label, set()).add(value)
    return found


def rules() -> list[dict[str, Any]]:
    (group,) = YAML(typ="safe").load(ALERTS)["groups"]
    return list(group["rules"])


def dashboard() -> dict[str, Any]:
    content: dict[str, Any] = json.loads((FOLDER / "armd-dashboard.json").read_text("utf-8"))
    return content


def queries() -> list[str]:
    targets = [target for panel in dashboard()["panels"] for target in panel["targets"]]
    return [target["expr"] for target in targets]


#: Words of an expression that name no metric.
LANGUAGE = {
    "by", "count", "for", "group_left", "increase", "offset", "on", "rate", "sum", "unless",
    "h", "m", "e",
}  # fmt: skip


def selectors(expr: str) -> list[tuple[str, str]]:
    """Each metric of an expression with what stands in its braces."""
    without = re.sub(r"\b(by|on|group_left) \([^)]*\)", " ", expr)
    without = re.sub(r"\[[^]]*\]", " ", without)
    found = re.findall(r"\b([a-zA-Z_]\w*)\b(?:\{([^}]*)\})?", re.sub(r"\b\d\S*", " ", without))
    return [(name, labels) for name, labels in found if name not in LANGUAGE]


def check(expr: str) -> None:
    """Raise `AssertionError` where an expression names what is not served."""
    metrics = served()
    assert selectors(expr), expr
    for name, labels in selectors(expr):
        assert name in metrics or name in PROMETHEUS_OWN, f"{expr}: no metric {name}"
        for label, how, value in re.findall(r'(\w+)(=~|!=|=)"([^"]*)"', labels):
            known = metrics.get(name, {}).get(label)
            if known is None:
                assert name in PROMETHEUS_OWN and label in PROMETHEUS_LABELS, f"{expr}: {label}"
            elif not value.startswith("$"):
                values = value.split("|") if how == "=~" else [value]
                assert set(values) <= known, f"{expr}: {label} is none of {known}"
    for labels in re.findall(r"\b(?:by|on) \(([^)]*)\)", expr):
        known_labels = {label for name, _ in selectors(expr) for label in metrics.get(name, {})}
        assert set(labels.split(", ")) <= known_labels | PROMETHEUS_LABELS | {"serial"}


@pytest.mark.parametrize("rule", rules(), ids=lambda rule: rule["alert"])
def test_an_alert_names_what_is_served_and_what_to_do(rule: dict[str, Any]) -> None:
    check(rule["expr"])
    assert rule["labels"]["severity"] in ("page", "ticket")
    do = rule["annotations"]["do"]
    commands = re.findall(r"`armd (\w+)", do)
    assert set(commands) <= set(COMMANDS)
    pages = re.findall(r"docs/[\w/-]+\.md", do)
    assert all((ROOT / page).is_file() for page in pages)
    assert commands or pages or "`" in do or "cable" in do  # something that a person can do
    assert "{{ $labels." in rule["annotations"]["summary"]


@pytest.mark.parametrize("expr", queries())
def test_a_query_of_the_dashboard_names_what_is_served(expr: str) -> None:
    check(expr)


def test_a_query_of_what_is_not_served_is_found() -> None:
    for wrong in (
        "armd_point_total > 0", 'armd_state{armd_state="BROKEN"} == 1', "rate(armd_latency[5m])",
        'armd_wire_total{which="lost"}', "sum by (arm) (armd_points_total)",
    ):  # fmt: skip
        with pytest.raises(AssertionError):
            check(wrong)


def test_each_state_and_metric_is_on_the_dashboard() -> None:
    shown = {name for expr in queries() for name, _ in selectors(expr)}
    assert shown == {*served(), "ALERTS"}
    (states,) = (panel for panel in dashboard()["panels"] if panel["title"] == "State")
    coloured = [o["matcher"]["options"] for o in states["fieldConfig"]["overrides"]]
    assert coloured == [f"/ {state}$/" for state in State]
    numbers = [panel["id"] for panel in dashboard()["panels"]]
    assert len(set(numbers)) == len(numbers)


def test_the_page_lists_metrics_and_alerts() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert set(re.findall(r"`(armd_\w+)` \| `serial`", text)) == set(served())
    assert set(re.findall(r"`(Armd\w+)`", text)) == {rule["alert"] for rule in rules()}
    assert f"{len(rules())} alert rules" in text


# --- with Prometheus' own programs ----------------------------------------------------------


def program(name: str) -> str:
    """Of Debian's package prometheus, installed or unpacked into the cache."""
    if found := shutil.which(name):
        return found
    try:
        return str(unpacked("prometheus") / "usr" / "bin" / name)
    except Unavailable as error:
        pytest.skip(f"no {name}: {error}")


def promtool(*words: str, folder: Path = FOLDER) -> subprocess.CompletedProcess[str]:
    command = [program("promtool"), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


needs_prometheus = pytest.mark.skipif(
    shutil.which("promtool") is None, reason="promtool is not installed; make test-all fetches it"
)


@needs_prometheus
def test_promtool_takes_the_rules_and_their_tests() -> None:
    """The page's own commands."""
    (block,) = shell_blocks(PAGE.read_text(encoding="utf-8"))
    enter, *commands = block.splitlines()
    assert enter == "cd deploy/monitoring" and len(commands) == 3
    for line in commands:
        first, *words = line.split()
        done = promtool(*words)
        assert first == "promtool" and done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_promtool_takes_them_wherever_it_can_be_had(tmp_path: Path) -> None:
    """And the dashboard's queries, as rules that record them."""
    for words in (["check", "rules", ALERTS.name], ["test", "rules", TESTS.name]):
        done = promtool(*words)
        assert done.returncode == 0, done.stdout + done.stderr
    records = [
        {"record": f"armd:panel{i}", "expr": plain(expr)} for i, expr in enumerate(queries())
    ]
    groups = {"groups": [{"name": "panels", "rules": records}]}
    (tmp_path / "panels.yml").write_text(json.dumps(groups))  # JSON is YAML
    done = promtool("check", "rules", "panels.yml", folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", [rule["alert"] for rule in rules()])
def test_the_tests_of_the_rules_miss_each_alert_that_is_gone_or_never_waits(
    tmp_path: Path, name: str
) -> None:
    """So each has a time at which it must fire, and, where it waits, one at which it must not."""
    shutil.copy(TESTS, tmp_path)
    for change in ("gone", "hasty"):
        content = YAML(typ="safe").load(ALERTS)
        (group,) = content["groups"]
        (rule,) = (rule for rule in group["rules"] if rule["alert"] == name)
        if change == "gone":
            group["rules"].remove(rule)
        elif "for" not in rule:
            continue
        else:
            del rule["for"]
        (tmp_path / ALERTS.name).write_text(json.dumps(content))
        assert promtool("test", "rules", TESTS.name, folder=tmp_path).returncode == 1, change


def plain(expr: str) -> str:
    """A panel's query with Grafana's variables as Grafana would fill them."""
    return expr.replace("$serial", ".*").replace("$__rate_interval", "1m")


@contextmanager
def prometheus(folder: Path, metrics_port: int) -> Iterator[str]:
    """One that scrapes this port each second by the folder's configuration; its address."""
    shutil.copy(ALERTS, folder)
    text = (FOLDER / "prometheus.yml").read_text().replace("15s", "1s")
    (folder / "prometheus.yml").write_text(
        text.replace("127.0.0.1:9470", f"127.0.0.1:{metrics_port}")
    )
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    command = [program("prometheus"), "--config.file=prometheus.yml"]
    command += [f"--web.listen-address={address}", "--storage.tsdb.path=data"]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL) as process:
        try:
            yield f"http://{address}"
        finally:
            process.terminate()
            process.wait(PATIENCE_S)


def answer(address: str, query: str) -> list[dict[str, Any]]:
    url = f"{address}/api/v1/query?{urllib.parse.urlencode({'query': query})}"
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as reply:
        found: list[dict[str, Any]] = json.load(reply)["data"]["result"]
    return found


@pytest.mark.slow
def test_a_prometheus_that_scrapes_armd_answers_the_dashboard(tmp_path: Path) -> None:
    """`ALERTS` apart: nothing fires within seconds."""
    published = [0]

    def healths() -> list[dict[str, Any]]:
        published[0] += 1000
        return [health(published[0])]

    with (
        closing(MetricsServer(0, healths)) as server,
        prometheus(tmp_path, server.port) as address,
    ):
        asked = [plain(expr) for expr in queries() if "ALERTS" not in expr and "> 0" not in expr]
        waiting, end_s = set(asked), time.monotonic() + PATIENCE_S
        while waiting:
            assert time.monotonic() < end_s, waiting
            time.sleep(0.5)
            try:
                waiting = {query for query in waiting if not answer(address, query)}
            except OSError:  # it starts
                continue
        (state,) = answer(address, "armd_state == 1")
        assert state["metric"]["armd_state"] == "READY" and state["metric"]["job"] == "armd"
        (rate,) = answer(address, "rate(armd_points_total[1m])")
        assert float(rate["value"][1]) > 0
        assert answer(address, 'up{job="armd"}')[0]["value"][1] == "1"
