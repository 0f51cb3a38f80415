"""Naive scoring of skills, and the prompts and candidates that it is held against."""

import random
from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from karma.goals.files import load_tasks
from karma.models.llama.gguf_model import GgufModel
from karma.types.completion import END
from support.paths import ROOT

TASKS = ROOT / "eval/alfred_l/tasks.jsonl"
THINGS = (
    "Apple", "Bread", "Egg", "Lettuce", "Potato", "Tomato", "Mug", "Cup", "Bowl", "Plate", "Pot",
    "Pan", "Knife", "Fork", "Spoon", "Spatula", "DishSponge", "SoapBottle", "SaltShaker", "Book",
    "Pen", "Pencil", "CellPhone", "CreditCard", "KeyChain", "Laptop", "RemoteControl", "Vase",
)  # fmt: skip
PLACES = (
    "Fridge", "Microwave", "SinkBasin", "CounterTop", "DiningTable", "Cabinet", "Drawer",
    "GarbageCan", "Shelf", "Sofa", "Bed", "Desk", "CoffeeTable", "SideTable",
)  # fmt: skip


def lines(count: int) -> list[str]:
    """Lines of programs, and the end: what the shipped planner says."""
    found = [
        f"{skill}(robot, '{name}')\n"
        for skills, names in (
            (("GoToObject", "PickupObject", "SliceObject"), THINGS),
            (("GoToObject", "OpenObject", "CloseObject"), PLACES),
        )
        for skill, name in product(skills, names)
    ]
    pairs = [f"PutObject(robot, '{a}', '{b}')\n" for a, b in product(THINGS, PLACES)]
    random.Random(0).shuffle(pairs)
    return [END, *found, *pairs][:count]


def prompts(count: int) -> list[tuple[str, ...]]:
    """Instructions of our tasks as the compact profile gives them, some with a line behind them."""
    asked = [sub.instruction for task in load_tasks(TASKS) for sub in task.subtasks]
    found = []
    for number in range(count):
        text = asked[number % len(asked)].lower().rstrip(".!?")
        changing = f"#task {text}\n#memory\n#program\n"
        done = f"GoToObject(robot, '{THINGS[number % len(THINGS)]}')\n"
        found.append(("#areas\nunknown\n", changing, *([done] if number % 2 else [])))
    return found


class Naive:
    """One sequence, and nothing kept between two candidates."""

    def __init__(self, model: GgufModel) -> None:
        import llama_cpp

        self._model, self._context = model, model.sequences(1, cells=model.limit)
        self._batch = llama_cpp.llama_batch_init(model.n_batch, 0, 1)

    def score(self, prompt: Sequence[str], text: str) -> float:
        """Return the sum of the log-probabilities of a candidate's tokens."""
        import llama_cpp

        llama_cpp.llama_memory_clear(llama_cpp.llama_get_memory(self._context.ctx), True)
        given = [
            token
            for number, part in enumerate(prompt)
            for token in self._model.tokens(part, begins=number == 0)
        ]
        tokens = tokens_of(self._model, text)
        whole, first = [*given, *tokens], len(given) - 1
        rows = [
            self._decode(whole[start : start + self._model.n_batch], start, first)
            for start in range(0, len(whole), self._model.n_batch)
        ]
        logits = np.concatenate(rows)[:-1].astype(np.float64)
        top = logits.max(axis=1)
        total = top + np.log(np.exp(logits - top[:, None]).sum(axis=1))
        return float((logits[np.arange(len(tokens)), tokens] - total).sum())

    def _decode(self, part: Sequence[int], place: int, first: int) -> NDArray[np.float32]:
        """Return the logits after every token from a place on."""
        import llama_cpp

        batch = self._batch
        batch.n_tokens = len(part)
        for i, token in enumerate(part):
            batch.token[i], batch.pos[i] = token, place + i
            batch.n_seq_id[i], batch.seq_id[i][0] = 1, 0
            batch.logits[i] = place + i >= first
        assert llama_cpp.llama_decode(self._context.ctx, batch) == 0
        count = max(0, min(len(part), place + len(part) - first))
        if count == 0:
            return np.empty((0, self._model.vocabulary), np.float32)
        pointer = llama_cpp.llama_get_logits(self._context.ctx)
        return np.ctypeslib.as_array(pointer, shape=(count, self._model.vocabulary)).copy()

    def close(self) -> None:
        """Free the context."""
        import llama_cpp

        llama_cpp.llama_batch_free(self._batch)
        self._context.close()


def tokens_of(model: GgufModel, text: str) -> list[int]:
    """Return a candidate's tokens."""
    return [model.end_token] if text == END else model.tokens(text)
