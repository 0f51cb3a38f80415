"""One default agent: settings, experiments, `karma run` and the docs say the same of it."""

import re
from dataclasses import fields
from pathlib import Path

import msgspec
import pytest
from support.paths import ROOT

from karma import registry
from karma.agent.karma import KarmaSettings
from karma.agent.options import settings_of
from karma.bench.engine.experiment_file import kind_of, read_experiment
from karma.cli.talking import RequestOptions
from karma.errors import FileError
from karma.loading.models import PRESETS, Models, Row, for_row
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.roles import Resources

SETTING = ("recall", "recall_k", "paper_prompt")
PAPERS = ("cosine:listing", 10, True)
FILES = [*sorted((ROOT / "eval").glob("*.toml")), *(ROOT / "eval/paper").glob("table*.toml")]
EXPERIMENTS = [
    path
    for path in FILES
    if kind_of(path) != "benchmark" and not path.stem.startswith("guarded")  # of a plug-in
]


def setting(row, models=None):
    """Return how memory comes into the prompt of a row."""
    models = models or Models()
    chosen = PRESETS[row.preset] if row.preset else models
    settings = settings_of(KarmaSettings, row.all_options)
    return chosen.recall, settings.recall_k, settings.paper_prompt


def test_default_agent_is_that_of_settings_presets_and_the_command():
    assert setting(Row(name="x")) == ("stateful", 3, False)
    assert settings_of(KarmaSettings, Row(name="x").all_options) == KarmaSettings()
    given = {one.name: one.default.default for one in fields(RequestOptions)}
    assert (given["preset"], given["sets"]) == ("", None)
    assert given["planner"] == ""  # the best that is here; an experiment that names none: nano
    assert given["profile"] == Models().profile


def test_paper_s_setting_is_one_word_and_options_go_before_it():
    assert setting(Row(name="x", preset="paper")) == PAPERS
    assert setting(Row(name="x", preset="paper", options={"recall_k": 3}))[1] == 3


@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: path.stem)
def test_experiments_measure_the_default_agent_unless_they_say_paper(path):
    experiment = read_experiment(path)
    for row in experiment.rows:
        if row.method != "karma" or "paper_prompt" in row.options:
            continue
        expected = (PAPERS[0], row.options.get("recall_k", 10), PAPERS[2])
        default = ("stateful", 3, False)
        assert setting(row, experiment.models) == (expected if row.preset else default)
        assert row.preset or "recall_k" not in row.options


def test_docs_say_what_the_default_and_the_paper_s_setting_are():
    text = (ROOT / "docs" / "methods.md").read_text()
    lines = re.findall(r"^\| `(\w+)` \| `(\S+)` \| `(\S+)` \|", text, flags=re.M)
    default = setting(Row(name="x"))
    assert {name: (one, other) for name, one, other in lines} == {
        name: (str(one).lower(), str(other).lower())
        for name, one, other in zip(SETTING, default, PAPERS, strict=True)
    }


def row_of(tmp_path, text):
    path = Path(tmp_path / "x.toml")
    path.write_text(f'name = "x"\ntasks = "t"\n[[rows]]\nname = "one"\n{text}\n')
    return read_experiment(path).rows[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('preset = "papers"', "preset = 'papers'; there is 'paper'"),
        ('preset = "paper"\nmethod = "helper"', "unknown option 'paper_prompt'"),
        ("answer_seconds = 0.0", "answer_seconds = 0: more than 0"),
        ('vision = "openai"', "it stands in"),
        ('vision = "eyes"', "row 'one': vision: no vision_models named 'eyes'"),
    ],
)
def test_row_that_names_what_there_is_not_is_refused(tmp_path, text, words):
    with pytest.raises(FileError, match=re.escape(words)):
        row_of(tmp_path, text)


def test_row_takes_its_own_vision_and_recall_and_leaves_the_run_s_alone(tmp_path):
    embedder = registry.load("embedders", "minilm")()
    run = Resources(
        model=ScriptedModel([]), profile="compact", recall=None, vision=MetadataVision(),
        embedder=embedder,
    )  # fmt: skip
    loaded = {"metadata": run.vision}
    plain = for_row(run, row_of(tmp_path, ""), loaded, Models())
    assert plain == run
    blind = for_row(run, row_of(tmp_path, 'vision = "blind"'), loaded, Models())
    assert loaded == {"metadata": run.vision, "blind": blind.vision}  # each is loaded once
    assert (blind.vision.name, run.vision.name) == ("blind", "metadata")
    assert blind.vision.read_states(None, "wash it", [object()]) == {}
    paper = for_row(run, row_of(tmp_path, 'preset = "paper"'), loaded, Models())
    assert type(paper.recall) is registry.load("recalls", "cosine")
    hasty = for_row(run, row_of(tmp_path, "answer_seconds = 5"), loaded, Models())
    assert (plain.decoding.answer_seconds, hasty.decoding.answer_seconds) == (None, 5)
    assert msgspec.structs.asdict(row_of(tmp_path, "")) == msgspec.structs.asdict(Row(name="one"))
