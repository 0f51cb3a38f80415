"""Answers of language models: decoding, completions, scores."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Constraint = Literal["free", "syntax", "types"]
"""Any text; programs; programs with names that fit the skill by their types."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoding:
    """How a planner's answers are drawn."""

    constraint: Constraint = "types"  # what an answer may say
    temperature: float = 0.0
    retry_temperature: float = 0.6  # once a program has failed, the same again will not help
    seed: int = 0
    max_tokens: int = 512
    answer_seconds: float | None = None  # by the clock, reading the prompt counted; None: no bound
    attempts: int = 4  # per request; later ones quote the error
    inspected: bool = True  # see `karma.agent.planning.inspector`
    refusing: bool = False  # the planner has learnt to refuse requests, or is told how to


@dataclass(frozen=True, slots=True, kw_only=True)
class Engine:
    """What a local model was computed by; answers may depend on it in their last bits."""

    device: str  # as llama.cpp names it: "CPU", "CUDA0", "Metal"
    gpu_layers: int  # of the model, that lie on it; 0 on the CPU
    n_ctx: int  # tokens
    threads: int
    batch: int  # tokens per call of the prompt
    kv: str  # type of the kept keys and values, e.g. "f16"
    flash_attention: bool


Thinking = Literal["off", "on"]  # of a model that can think before it answers


KvState = Literal["kept", "evaluated"]  # of a prompt's stable part


@dataclass(frozen=True, slots=True, kw_only=True)
class Certainty:
    """How sure a model was of its own answer, by what it would have said without any grammar."""

    mean_logprob: float  # natural logarithm of the chance of a token, over those of the answer
    least_logprob: float  # of the token that it was least sure of
    refusing: float | None = None  # chance that the answer refuses; None where it may not


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """A model's answer and what it cost; None where a hosted model does not tell."""

    text: str
    finish: Literal["stop", "length", "time", "cycle", "filter"]  # all but the first have a fault
    prompt_tokens: int | None
    reused_tokens: int | None  # of the prompt, taken from kept KV state
    completion_tokens: int | None
    first_token_s: float | None
    total_s: float
    cost: float | None = None  # in the currency of the user's price table
    reasoning: str = ""  # what a thinking model said before its answer
    constrained: bool | None = None  # a grammar held; None where it is not known
    fault: str = ""  # why it cannot be a program, whatever it says: cut off, or not held
    engine: Engine | None = None  # None where it is not ours to know
    state: KvState | None = None  # where that of the stable part came from, likewise
    certainty: Certainty | None = None  # None where a model does not tell


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """What has come of an answer while the model is still at it."""

    text: str  # since it was heard last, a thought's too
    tokens: int | None  # so far; None where a hosted model does not tell
    seconds: float  # since it was asked


Listener = Callable[[Heard], None]


Scoring = Literal["sum", "average"]  # of the log-probabilities of a text's tokens


END = ""  # as a text to be scored: the answer ends here


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The likeliest text of a closed list, and what it cost to find."""

    number: int  # in the list given; the first of equals
    score: float
    prompt_tokens: int
    reused_tokens: int  # of the prompt, taken from kept KV state
    completion_tokens: int  # of the text that was chosen
    run_tokens: int  # of all texts, that had to be decoded to be sure
    total_s: float
    engine: Engine | None = None  # None where it is not ours to know
