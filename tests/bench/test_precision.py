"""Seeds are added until success rates are as sure as they are wanted, and no seed for nothing."""

import json
import time
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.made_records import plain
from support.run_files import TASKS, files, karma, lines_in, plant_plugin, started, write_experiment
from support.tiny import export_tiny
from support.written_tasks import write_tasks

from karma.agent.goals.files import load_tasks
from karma.agent.journal.header import EPISODES, RESULTS
from karma.agent.journal.records import read_records
from karma.agent.journal.run_folder import read_run
from karma.bench.engine.run import Run
from karma.bench.figures.columns import figures
from karma.bench.figures.precision import Precision, reached, takes_another
from karma.errors import FileError, KarmaError
from karma.seeds import stream


def drawn(seeds, chances, row="KARMA"):
    """Episodes of tasks with these chances to be solved."""
    return [
        plain(bool(stream(seed, row, str(task)).random() < chance), task=f"t{task}", seed=seed,
              row=row)
        for seed in range(seeds)
        for task, chance in enumerate(chances)
    ]  # fmt: skip


# ----------------------------------------------------------------- the rule


@pytest.mark.parametrize("half_width", [0.2, 0.1])
def test_seeds_are_taken_until_the_half_width_and_then_no_more(half_width):
    wanted = Precision(half_width=half_width, max_seeds=200)
    seeds = 1
    while takes_another(drawn(seeds, [0.5] * 10), wanted, seeds):
        seeds += 1
    (line,) = reached(drawn(seeds, [0.5] * 10), wanted)
    assert line.reached
    assert line.success.interval.half_width <= half_width
    (before,) = reached(drawn(seeds - 1, [0.5] * 10), wanted)
    assert before.success.interval.half_width > half_width
    assert 10 * seeds == pytest.approx(0.25 * (1.96 / half_width) ** 2, rel=0.5)


COINS = [(1, 1)] * 4 + [(0, 0)] * 2 + [(0, 1), (1, 0)] * 2
AGREEING = [
    plain(bool(solved), task=f"t{task}", seed=seed)
    for task, pair in enumerate(COINS)
    for seed, solved in enumerate(pair)
]  # as coins do now and then: if tasks did differ as much as they seem to, seeds were no use


@pytest.mark.parametrize(
    ("records", "width", "most", "takes_tasks", "another"),
    [
        (drawn(3, [0.5] * 10), 0.05, 4, False, True),
        (drawn(4, [0.5] * 10), 0.05, 4, False, False),  # the maximum
        (drawn(2, [0, 1] * 5), 0.05, 20, True, False),  # tasks that never change take tasks
        (drawn(1, [0, 1] * 5), 0.05, 20, False, True),  # one seed says nothing about seeds
        (drawn(2, [1] * 10, row="expert"), 0.1, 20, True, False),
        (drawn(2, [1] * 10, row="expert") + drawn(2, [0.5] * 10), 0.1, 20, True, True),
        (AGREEING, 0.1, 20, False, True),
    ],
)
def test_another_seed_is_taken_where_it_is_allowed_and_of_use(
    records, width, most, takes_tasks, another
):
    wanted, seeds = Precision(half_width=width, max_seeds=most), {one.seed for one in records}
    line = reached(records, wanted)[0]
    assert (line.takes_tasks, line.reached, line.seeds) == (takes_tasks, False, len(seeds))
    assert takes_another(records, wanted, len(seeds)) == another


def test_one_task_alone_is_as_sure_as_its_seeds_make_it():
    wanted, seeds = Precision(half_width=0.2), 1
    while takes_another(drawn(seeds, [1]), wanted, seeds):
        seeds += 1
    (line,) = reached(drawn(seeds, [1]), wanted)
    assert line.reached
    assert 2 < seeds < 12


def test_kind_is_judged_by_itself_and_one_that_nobody_asked_is_not_there():
    hard = [plain(seed % 2 == task % 2, kind="complex", task=f"c{task}", seed=seed)
            for seed in range(2) for task in range(3)]  # fmt: skip
    lines = reached(drawn(2, [1] * 100) + hard, Precision(half_width=0.1))
    assert [(line.kind, line.tasks, line.reached) for line in lines] == [
        ("simple", 100, True), ("complex", 3, False),
    ]  # fmt: skip


@given(order=st.randoms(), seeds=st.integers(1, 4), chances=st.lists(st.floats(0, 1), min_size=1))
def test_figures_are_the_table_s_and_no_order_of_records_changes_them(order, seeds, chances):
    records = drawn(seeds, chances)
    wanted = Precision(half_width=0.1)
    lines = reached(records, wanted)
    order.shuffle(records)
    assert reached(records, wanted) == lines
    (table,) = [line for line in figures(records, {}) if line.kind == "simple"]
    assert lines[0].success == table.values["success"]


def test_interval_of_a_run_that_stopped_when_it_was_sure_still_holds_the_truth():
    """Fifteen tasks with success rates of their own, 0.5 on average, 60 runs of them."""
    wanted, held = Precision(half_width=0.15), 0
    for run in range(60):
        chances, seeds = stream(run, "chances").beta(2, 2, size=15), 1
        while takes_another(drawn(seeds, chances, row=f"run {run}"), wanted, seeds):
            seeds += 1
        (line,) = reached(drawn(seeds, chances, row=f"run {run}"), wanted)
        held += 0.5 in line.success.interval
    assert held / 60 > 0.85


@pytest.mark.parametrize(("width", "seeds"), [(0, 5), (0.5, 5), (-1, 5), (0.1, 0)])
def test_precision_that_makes_no_sense_is_refused(width, seeds):
    with pytest.raises(ValueError, match="it is"):
        Precision(half_width=width, max_seeds=seeds)


# ----------------------------------------------------------------- runs


COIN = """
from karma.bench.methods.expert import ExpertEpisode
from karma.contracts import Outcome
from karma.seeds import stream

class Coin:
    name = "coin"

    @classmethod
    def build(cls, resources, options):
        return cls()

    def begin(self, world, scene, *, seed, folder):
        return Toss(world, scene, seed)

class Toss(ExpertEpisode):
    def __init__(self, world, scene, seed):
        super().__init__(world, scene)
        self._seed, self._works = seed, None

    def do(self, subtask):
        if self._works is None:
            self._works = stream(self._seed, "flip", subtask.instruction).random() < 0.5
        if self._works:
            yield from super().do(subtask)
        else:
            yield Outcome(finished=True, resident=(), handled_ids=())
"""
ONLY = ("simple-11", "simple-12", "simple-13", "simple-14")
ROWS = '[[rows]]\nname = "coin"\nmethod = "coin"\n[[rows]]\nname = "expert"\nmethod = "expert"\n'
WIDTH, MOST = 0.25, 12


@pytest.fixture(scope="module")
def coin(tmp_path_factory):
    """An installed method that does as the expert does, or nothing, by the toss of a coin."""
    place = tmp_path_factory.mktemp("plugin")
    plant_plugin(place, "coin", COIN, "methods", "coin = coin:Coin")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(place))
        yield


@pytest.fixture(scope="module")
def whole(coin, tmp_path_factory):
    """An undisturbed run: (experiment, folder, how many episodes)."""
    folder = tmp_path_factory.mktemp("whole")
    planner = export_tiny(folder / "tiny.gguf")
    more = f"half_width = {WIDTH}\nmax_seeds = {MOST}"
    path = write_experiment(folder / "x.toml", planner, rows=ROWS, only=ONLY, more=more)
    return path, folder / "run", len(list(Run(path, folder / "run").episodes()))


def test_run_adds_seeds_until_it_is_sure_enough(whole):
    path, folder, number = whole
    run = Run(path, folder)
    seeds = run.seeds
    assert seeds == tuple(range(len(seeds)))
    assert 2 < len(seeds) < MOST
    assert (number, run.left, run.total) == (8 * len(seeds), 0, number)
    coin, expert = reached(run.records, run.precision)
    assert coin.reached
    assert coin.success.interval.half_width <= WIDTH
    assert expert.success.value > 0.9  # starts are not chosen for it
    earlier = [record for record in run.records if record.seed < len(seeds) - 1]
    assert not reached(earlier, run.precision)[0].reached
    assert [record.seed for record in run.records] == sorted(r.seed for r in run.records)
    assert {line["episodes"] for line in json.loads((folder / RESULTS).read_text())} == {
        4 * len(seeds)
    }


def test_run_cut_within_and_between_seeds_ends_in_the_same_bytes(whole, tmp_path):
    path, folder, _ = whole
    for more in (3, 5):  # amid the first seed, and at its end
        going = Run(path, tmp_path / "run").episodes()
        for _ in range(more):
            next(going)
        going.close()
    list(Run(path, tmp_path / "run").episodes())
    assert files(tmp_path / "run") == files(folder)


def test_run_with_half_widths_that_is_killed_ends_in_the_same_bytes(whole, tmp_path):
    path, folder, _ = whole
    process = started(path, tmp_path / "run")
    while process.is_alive() and lines_in(tmp_path / "run" / EPISODES) < 10:
        time.sleep(0.002)
    process.kill()
    process.join()
    assert process.exitcode < 0
    list(Run(path, tmp_path / "run").episodes())
    assert files(tmp_path / "run") == files(folder)


def test_two_workers_add_the_same_seeds_as_one(whole, tmp_path):
    path, folder, number = whole
    assert len(list(Run(path, tmp_path / "run").episodes(workers=2))) == number
    assert files(tmp_path / "run") == files(folder)


def test_folder_of_listed_seeds_is_gone_on_with_and_nothing_is_thrown_away(whole, tmp_path):
    path, folder, number = whole
    listed = path.with_name("listed.toml")
    listed.write_text(path.read_text().replace("half_width", "# half_width"))
    run = Run(listed, tmp_path / "run")
    assert (run.precision, run.total, run.seeds) == (None, 8, (0,))
    list(run.episodes())
    more = Run(listed, tmp_path / "run", half_width=WIDTH, max_seeds=MOST)
    assert (len(more.records), more.left) == (8, 8)  # the next seed is begun
    going = more.episodes()
    next(going)
    going.close()
    assert not read_run(tmp_path / "run").finished
    begun = Run(listed, tmp_path / "run")  # without: what was begun is finished, and no more
    assert (begun.seeds, begun.left) == ((0, 1), 7)
    list(Run(listed, tmp_path / "run", half_width=WIDTH, max_seeds=MOST).episodes())
    assert files(tmp_path / "run") == files(folder)
    assert Run(listed, tmp_path / "run").total == number


def test_run_stops_at_the_maximum_and_says_what_was_reached(whole, tmp_path):
    path, *_ = whole
    json_path = tmp_path / "figures.json"
    asked = ["--half-width", "0.1", "--max-seeds", "2", "--workers", "1", "--json", str(json_path)]
    result = karma("eval", path, "--out", tmp_path / "run", *asked)
    assert {r.seed for r in read_records(tmp_path / "run" / EPISODES)} == {0, 1}
    said = " ".join(result.split())
    assert "success to ± 0.1" in said
    assert "takes more tasks, not seeds" in said  # the expert, who always succeeds
    assert {line["episodes"] for line in json.loads(json_path.read_text())} == {8}


def test_maximum_without_a_half_width_is_refused(whole, tmp_path):
    path, *_ = whole
    listed = path.with_name("listed2.toml")
    listed.write_text(path.read_text().replace("half_width", "# half_width"))
    with pytest.raises(KarmaError, match="--max-seeds is for runs with --half-width"):
        Run(listed, tmp_path / "run", max_seeds=3)
    with pytest.raises(KarmaError, match=r"half-width 0\.7: it is between 0 and 0\.5"):
        Run(listed, tmp_path / "run", half_width=0.7)
    path.with_name("wrong.toml").write_text(path.read_text().replace(str(WIDTH), "0.9"))
    with pytest.raises(FileError, match=r"wrong\.toml: half-width 0\.9: it is between"):
        Run(path.with_name("wrong.toml"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_sequences_have_one_seed_so_a_half_width_is_refused(whole, tmp_path):
    path, *_ = whole
    one = next(task for task in load_tasks(TASKS) if task.id == ONLY[0])
    write_tasks(tmp_path / "tasks.jsonl", [replace(one, kind="sequence")])
    rows = '[[rows]]\nname = "expert"\nmethod = "expert"\n'
    other = write_experiment(
        tmp_path / "x.toml", path.with_name("tiny.gguf"), rows=rows, only=ONLY[:1], more=""
    )
    other.write_text(other.read_text().replace(str(TASKS), str(tmp_path / "tasks.jsonl")))
    with pytest.raises(
        KarmaError, match=r"is a sequence, which has one seed.*\n.*more sequences into"
    ):
        Run(other, tmp_path / "run", half_width=0.1)
    assert len(list(Run(other, tmp_path / "run").episodes())) == 1
