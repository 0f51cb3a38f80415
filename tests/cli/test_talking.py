"""`karma run` from outside: what a big planner is asked, and how the command ends."""

import json
from pathlib import Path

import pytest
from support.hosted_server import chat, plant_key, wire_server
from typer.testing import CliRunner

from karma.cli import app

USAGE = {"prompt_tokens": 9, "completion_tokens": 9}


@pytest.fixture
def told(tmp_path, monkeypatch):
    """A function that runs the command with a hosted planner; returns its result and requests."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    plant_key(monkeypatch)

    def run(answer, instruction, *options):
        with wire_server(lambda *_: chat(answer, usage=USAGE)) as (url, requests):
            arguments = [
                "run",
                instruction,
                "--planner",
                "openai",
                "--base-url",
                url,
                "--mode=full",
            ]
            arguments += [
                "--model",
                "big",
                "--set",
                "models.constraint=free",
                "--json",
                "reply.json",
                *options,
            ]
            return CliRunner().invoke(app, arguments), requests

    return run


def test_big_planner_is_asked_to_refuse_and_its_refusal_ends_with_a_status_of_its_own(told):
    result, requests = told("refuse('impossible')", "slice the bread")
    assert result.exit_code == 3, result.output
    assert "refuse('impossible')" in json.dumps(requests[0][1])  # told how
    assert "not done: That cannot be done with these things, or would do harm." in result.output
    assert "?" in result.output.split("not done:")[1].splitlines()[1]
    (kept,) = json.loads(Path("reply.json").read_text())["instructions"]
    assert kept["refused"] == "That cannot be done with these things, or would do harm."
    assert kept["calls"] == []


def test_big_planner_that_may_not_refuse_is_not_told_how(told):
    _, requests = told(
        "ToggleOn(robot, 'Faucet')", "turn the water tap on", "--set", "models.refusing=false"
    )
    assert "refuse(" not in json.dumps(requests[0][1])


def test_what_was_done_is_told_with_its_cost_and_leaves_a_run_for_the_report(told):
    result, _ = told("ToggleOn(robot, 'Faucet')", "turn on the tap")
    assert result.exit_code == 0, result.output
    rows = [row.strip() for row in result.output.splitlines()]
    assert "I will switch on the faucet" in rows
    assert "the faucet is on: seen" in rows
    assert any(row.startswith("planner wire-1: 1 requests") for row in rows)
    page = CliRunner().invoke(app, ["report", "runs/talks/kitchen_1-1"])
    assert page.exit_code == 0, page.output
    assert "actions went as logged" in page.output
    assert Path("runs/talks/kitchen_1-1/report.html").exists()
