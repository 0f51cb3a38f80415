"""Choose from a closed list by the chances that a llama-server tells, the best prefix first.

A request tells the likeliest next tokens with their log-probabilities. What is not among them is
no likelier than the last of them, and is asked for by name only when that could matter: a grammar
of that one token has the server take it, and its log-probability is from before the grammar.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from karma.contracts import END, AnswerSpec, Choice, Completion, Listener, Prompt, Scoring
from karma.errors import ModelError
from karma.infer.choosing.best_first import Race
from karma.infer.choosing.token_trie import Floats, Node, path_to, trie_of
from karma.infer.hosted.model import HostedLanguageModel, sendable
from karma.infer.hosted.session import Endpoint, Session

_TOLD = 256  # likeliest next tokens in an answer
_EMPTY = '""'
_LEAST = -1e4  # of a log-probability; a server writes 0.0 as the smallest number there is


class HostedScorer:
    """A hosted planner that is a `ScoringModel` too.

    Chat templates are not applied: what is scored is a continuation of plain text.

    Args:
        model: answers prompts.
        endpoint: where it is: a llama-server.
        session: the run's.
    """

    def __init__(self, model: HostedLanguageModel, endpoint: Endpoint, session: Session) -> None:
        self.name = model.name
        self._model, self._endpoint, self._session = model, endpoint, session
        self._trie = lru_cache(maxsize=8)(self._made_trie)
        self._ending = str((session.look(endpoint, "../props") or {}).get("eos_token", ""))

    def complete(
        self,
        prompt: Prompt,
        *,
        spec: AnswerSpec | None = None,
        max_tokens: int = 512,
        max_seconds: float | None = None,
        temperature: float = 0.0,
        seed: int = 0,
        listen: Listener | None = None,
    ) -> Completion:
        """Continue the prompt; see `HostedLanguageModel.complete`."""
        return self._model.complete(
            prompt, spec=spec, max_tokens=max_tokens, max_seconds=max_seconds,
            temperature=temperature, seed=seed, listen=listen,
        )  # fmt: skip

    def choose(
        self, prompt: Sequence[str], continuations: Sequence[str], *, scoring: Scoring = "sum"
    ) -> Choice:
        """Return the likeliest of the texts that may follow the prompt, given in segments.

        Raises:
            ModelError: the endpoint failed, or its answer has another form.
            ValueError: there is no continuation, one without tokens, or no prompt.
        """
        segments = [self._tokens(text, begins=number == 0) for number, text in enumerate(prompt)]
        tokens = [token for segment in segments for token in segment]
        if not tokens:
            raise ValueError("there is no prompt")
        trie = self._trie(tuple(continuations))
        end = self._end()[0] if END in continuations else None
        search = _Search(self._endpoint, self._session, tokens, trie, end)
        race = Race(trie, search.found, average=scoring == "average", settle=search.settle)
        score, one, number = race.run(search.look_below)
        return Choice(
            number=one,
            score=score,
            prompt_tokens=len(tokens),
            reused_tokens=0,
            completion_tokens=trie[number].depth,
            run_tokens=search.requests,
            total_s=search.seconds,
        )

    def _made_trie(self, continuations: tuple[str, ...]) -> Sequence[Node]:
        return trie_of([self._end() if one == END else self._tokens(one) for one in continuations])

    def _end(self) -> list[int]:
        """Return the token that ends an answer."""
        tokens = self._tokens(self._ending, special=True)
        if len(tokens) != 1:
            raise _odd(self._endpoint, "no token that ends an answer")
        return tokens

    def _tokens(self, text: str, *, begins: bool = False, special: bool = False) -> list[int]:
        body = {"content": sendable(text), "add_special": begins, "parse_special": special}
        said = self._session.ask(
            "planner", self._endpoint, "../tokenize", body, shared=True, billed=False
        )
        try:
            return [int(token) for token in (said.reply.answer or {})["tokens"]]
        except (KeyError, TypeError, ValueError) as error:
            raise _odd(self._endpoint, "no tokens") from error


class _Search:
    """Fills in the scores of a trie's nodes; some are at first the most that they can be."""

    def __init__(
        self,
        endpoint: Endpoint,
        session: Session,
        prompt: list[int],
        trie: Sequence[Node],
        end: int | None,
    ) -> None:
        self.found: Floats = np.zeros(len(trie), np.float64)
        self.requests, self.seconds = 0, 0.0
        self._endpoint, self._session, self._prompt, self._trie = endpoint, session, prompt, trie
        self._end = end
        self._bounds: set[int] = set()  # nodes whose scores are bounds
        self._known: set[int] = set()  # nodes whose children have scores

    def look_below(self, number: int) -> None:
        """Score the children of a node; where one way leads on, all that are on it."""
        if number in self._known:
            return
        children = self._trie[number].children
        if len(children) == 1:
            self._follow(number)
            return
        # one is taken by force: of a token that is half a letter nothing would be told
        forced = next(iter(children))
        options = {"n_predict": 1, "n_probs": _TOLD, "grammar": self._forcing([forced])}
        (entry,) = self._ask(number, options)
        told = {int(one["id"]): _chance(one) for one in entry["top_logprobs"]}
        least = min(told.values())
        told[forced] = _chance(entry)
        for token, child in children.items():
            self.found[child] = self.found[number] + told.get(token, least)
            if token not in told:
                self._bounds.add(child)
        self._known.add(number)

    def settle(self, number: int) -> bool:
        """Put a score in place of a bound; return whether it was one."""
        if number not in self._bounds:
            return False
        self._bounds.discard(number)
        self._run([number])
        return True

    def _follow(self, number: int) -> None:
        path = []
        while len(children := self._trie[number].children) == 1:
            self._known.add(number)
            (number,) = children.values()
            path.append(number)
        self._run(path)

    def _run(self, path: Sequence[int]) -> None:
        """Score nodes that follow each other; the first one's parent has its score."""
        parent = self._trie[path[0]].parent
        grammar = self._forcing([self._trie[number].token for number in path])
        options = {"n_predict": len(path), "n_probs": 1, "grammar": grammar}
        score = self.found[parent]
        for number, entry in zip(path, self._ask(parent, options), strict=False):
            score += _chance(entry)
            self.found[number] = score

    def _forcing(self, tokens: Sequence[int]) -> str:
        """Return the grammar of these tokens alone; the end of an answer is what follows them."""
        words = [f"<[{token}]>" for token in tokens if token != self._end]
        return f"root ::= {' '.join(words) or _EMPTY}"

    def _ask(self, number: int, options: dict[str, Any]) -> list[dict[str, Any]]:
        """Return what is told of the tokens after a node."""
        path = [self._trie[one].token for one in path_to(self._trie, number)]
        body = {
            "prompt": [*self._prompt, *path],
            "model": self._endpoint.model,
            "temperature": 0.0,
            "cache_prompt": True,
            **options,
        }
        exchange = self._session.ask("planner", self._endpoint, "../completion", body)
        self.requests += 1
        self.seconds += exchange.seconds
        entries = (exchange.reply.answer or {}).get("completion_probabilities")
        if not isinstance(entries, list) or len(entries) < options["n_predict"]:
            raise _odd(self._endpoint, "no log-probabilities")
        return entries[: options["n_predict"]]


def _chance(entry: dict[str, Any]) -> float:
    return min(max(float(entry["logprob"]), _LEAST), 0.0)


def _odd(endpoint: Endpoint, what: str) -> ModelError:
    return ModelError(
        f"{endpoint.model} at {endpoint.host}: its answer holds {what}"
        "\n  To fix: take a GGUF file, or the row lota.generate"
    )
