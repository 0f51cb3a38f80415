"""The full prompt fits a context of 2,048 tokens, by the command that the documents give."""

import re
import subprocess
import sys

from support.paths import ROOT


def test_full_prompt_with_ten_units_fits_2048_tokens_in_the_median_room(tmp_path):
    told = subprocess.run(
        [sys.executable, "scripts/measure_prompts.py", "--rooms", "8"],
        cwd=ROOT, env={"KARMA_SHARED": str(tmp_path)}, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    medians = dict(re.findall(r"^(\w+, first request), .*?^\| all \| (\d+) \|", told, re.M | re.S))
    compact, full, goals = (
        int(medians[f"{name}, first request"]) for name in ("compact", "full", "goals")
    )
    assert 0 < compact < 300
    assert 1000 < full <= 2048
    assert goals < 0.7 * full
    assert "8 generated rooms, tokens of planner.gguf" in told
