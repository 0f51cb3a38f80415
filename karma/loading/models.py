"""The models of a run: what is said of them, and how each is opened, once."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any, Literal, Self

import msgspec
from msgspec.structs import force_setattr

from karma import registry
from karma.agent.planning.prompt import TOOLS, program_profile, render
from karma.agent.seeing.eyes import METADATA
from karma.errors import KarmaError, ModelError, RequestRefused, did_you_mean
from karma.loading.names import MODELS, check_models, whole_name
from karma.loading.planner_files import (
    EXAMPLES,
    examples_for,
    may_refuse,
    reader_for,
)
from karma.models.endpoint import Endpoint, Hosted
from karma.models.llama.opening import LlamaOptions
from karma.models.manifest import default_planner, resolve_planner
from karma.models.session import Session
from karma.types.completion import Constraint, Decoding, Thinking
from karma.types.planning import PlanRequest
from karma.types.roles import Embedder, LanguageModel, Recall, Resources, VisionModel, World


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """One setting of the agent."""

    recall: str  # which units come into the prompt, and after ":" how they are put in words
    options: Mapping[str, Any] = field(default_factory=dict)  # of the row, where not the default


PRESETS = {
    "": Preset(recall=""),  # `default_recall`: what the tables measure
    "paper": Preset(  # §3.5; it gives no K, so all units
        recall="cosine:listing",
        options={"recall_k": 10, "paper_prompt": True},
    ),
}


def default_recall() -> str:
    """Return the recall of small planners where its plug-in is installed, else the paper's."""
    return "stateful" if "stateful" in registry.names("recalls") else "cosine"


def preset(name: str) -> Preset:
    """Return a preset; ValueError where there is none of that name."""
    if name not in PRESETS:
        there = [*filter(None, PRESETS)]
        hint = did_you_mean(name, there)
        raise ValueError(f"preset = {name!r}; there is {', '.join(there)!r}.{hint}")
    return PRESETS[name]


OPENAI = "openai"  # the name of the hosted implementation in every role


class Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of the table."""

    name: str
    method: str = "karma"
    preset: str = ""  # "paper": recall, query and K as in the paper; `options` go before it
    vision: str = ""  # in place of the one in [models]
    recall: str = ""  # likewise
    answer_seconds: float | None = None  # of an answer, by the clock; None: tokens alone bound it
    mode: Literal["", "program", "goals", "tools"] = ""  # of answers; "": as [models] says
    options: dict[str, Any] = {}

    def __post_init__(self) -> None:
        """Refuse an unknown preset, and a hosted model: its host is in [models]. Name all whole."""
        _ = preset(self.preset)
        if self.answer_seconds is not None and not self.answer_seconds > 0:
            raise ValueError(f"answer_seconds = {self.answer_seconds:g}: more than 0, or left out")
        if self.vision:
            force_setattr(self, "vision", whole_name("vision", self.vision))
        if self.vision.partition(":")[0] == OPENAI:
            raise ValueError(f"a row's vision = {OPENAI!r}: it stands in [models]")

    @property
    def all_options(self) -> dict[str, Any]:
        """What its method is built from."""
        return {**preset(self.preset).options, **self.options}


class Models(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which models fill the roles."""

    planner: str = "karma-nano"  # of models/manifest.toml, a GGUF's path, "openai", "default"
    profile: str = ""  # "compact", "full", "goals" or "tools"; "": as in the manifest
    chat: bool | None = None  # through the GGUF's own chat template; None: if it has one
    refusing: bool | None = None  # requests may be refused; None: by who has learnt it (manifest)
    thinking: Thinking = "off"  # whether a model that can think first may
    embedder: str = "minilm"  # or "sentence:MODEL", "clip:MODEL", of the manifest or a folder
    recall: str = ""  # "": `default_recall`
    vision: str = "metadata"
    constraint: Constraint = "types"  # what answers may say; a server must prove that it holds them
    examples: int | None = None  # told, 0 to 8; None: 4 to a local planner with the full prompt
    threads: int = 1
    gpu_layers: int | Literal["auto"] = "auto"  # of a GGUF; 0: all models on the CPU
    n_ctx: int | None = None  # context of a GGUF; None: as its prompts need, to what it learnt
    hosted: Hosted = Hosted()  # where the roles are that have "openai"

    def __post_init__(self) -> None:
        """Refuse a hosted role without a place, and a place without its role; name roles whole."""
        for key, usual in (("embedder", "minilm"), ("vision", "metadata")):
            if getattr(self, key) != usual:
                force_setattr(self, key, whole_name(key, getattr(self, key)))
        if not self.recall:
            force_setattr(self, "recall", default_recall())
        if self.planner == "default":  # what `karma run` takes: the best of ours that is here
            force_setattr(self, "planner", default_planner())
        if self.examples is not None and not 0 <= self.examples <= 8:
            raise ValueError(f"examples = {self.examples}: 0 to 8")
        for role in ("planner", "vision", "embedder"):
            hosted = getattr(self, role).partition(":")[0] == OPENAI
            if hosted != (getattr(self.hosted, role) is not None):
                raise ValueError(f"{role} = {OPENAI!r} and [models.hosted.{role}] go together")
        try:
            _ = self.llama
        except ModelError as error:
            raise ValueError(str(error)) from error

    def computed_by(self, options: Mapping[str, Any]) -> Self:
        """Return the same with some keys said otherwise; KarmaError for a value it may not have."""
        try:
            return msgspec.convert({**msgspec.structs.asdict(self), **options}, type(self))
        except (msgspec.ValidationError, ValueError) as error:
            raise KarmaError(str(error)) from error

    @property
    def llama(self) -> LlamaOptions:
        """How a GGUF is opened."""
        return LlamaOptions(gpu_layers=self.gpu_layers, n_ctx=self.n_ctx, threads=self.threads)

    @property
    def device(self) -> str:
        """Where torch models are computed: "cpu", or "auto", a GPU where there is one."""
        return "cpu" if self.gpu_layers == 0 else "auto"


def load_resources(
    models: Models,
    *,
    maps: Path | None,
    seed: int,
    learn: bool = False,
    session: Session | None = None,
) -> Resources:
    """Load the models of a run, each once.

    Raises:
        ModelError: a model is missing, damaged or of the wrong kind, or a hosted one out of reach.
        UnknownNameError: a role has no such implementation.
    """
    check_models({key: getattr(models, key) for key in MODELS})
    session = session or Session()
    model, profile = language_model(models, session, seed)
    check_asked(model, profile)
    is_hosted = models.hosted.planner is not None
    asked = models.refusing
    refusing = bool(asked) if is_hosted else may_refuse(models.planner, asked)
    decoding = Decoding(
        refusing=refusing,
        constraint="free" if is_hosted and profile == TOOLS else models.constraint,
        seed=seed,
    )
    embedder = filled("embedders", models.embedder, models.hosted.embedder, session, models)
    return Resources(
        model=model,
        profile=profile,
        decoding=decoding,
        reader=None if is_hosted else reader_for(models.planner, embedder),
        examples=examples_for(_count(models, profile), embedder),
        recall=_recall(models.recall, embedder, maps),
        vision=filled("vision_models", models.vision, models.hosted.vision, session, models),
        maps=maps,
        learn=learn,
        embedder=embedder,
    )


def _count(models: Models, profile: str) -> int:
    """Return how many examples a planner is told; the compact prompt has no room for any.

    Hosted ones are told none unless asked: what was recorded of them is found by its prompt.
    """
    if profile == "compact":
        return 0
    usual = 0 if models.hosted.planner is not None else EXAMPLES
    return usual if models.examples is None else models.examples


def for_row(
    resources: Resources, row: Row, loaded: dict[str, VisionModel], models: Models
) -> Resources:
    """Return what a row's method is built from: the run's, save for what the row names itself.

    `loaded` takes the vision models that rows add, so that each is loaded once.
    """
    recall, vision = resources.recall, resources.vision
    named = row.recall or (preset(row.preset).recall if row.preset else "")
    if named:
        recall = _recall(named, resources.embedder, resources.maps)
    if row.vision:
        if row.vision not in loaded:
            loaded[row.vision] = filled("vision_models", row.vision, None, Session(), models)
        vision = loaded[row.vision]
    return replace(
        resources,
        recall=recall,
        vision=vision,
        profile=_profile(row.mode, resources.profile),
        decoding=replace(resources.decoding, answer_seconds=row.answer_seconds),
    )


def _profile(mode: str, of_run: str) -> str:
    """Return a row's prompt profile; programs are asked for by the run's own, or the full one."""
    return program_profile(of_run) if mode == "program" else mode or of_run


def _recall(name: str, embedder: Embedder | None, maps: Path | None) -> Recall:
    """Return a recall; one that looks at kept pictures is told the run folder, which has `maps`."""
    name, _, text = name.partition(":")
    kind = registry.load("recalls", name)
    folder = {"folder": maps.parent if maps else None}
    looks = folder if "folder" in signature(kind).parameters else {}
    made: Recall = kind(embedder, text=text or "sentence", **looks)
    return made


def filled(
    role: str, name: str, endpoint: Endpoint | None, session: Session, models: Models
) -> Any:
    """Return a role's implementation: "minilm", or with its model, "sentence:all-mpnet-base-v2".

    One that is hosted is told where, others on what they are computed, if they take it.
    """
    kind, _, model = name.partition(":")
    made = registry.load(role, kind)
    if endpoint is not None:
        return made(endpoint, session=session)
    known = signature(made).parameters
    wanted = {"device": models.device, "llama_options": models.llama}
    options = {name: value for name, value in wanted.items() if name in known}
    return made(model, **options) if model else made(**options)


def check_asked(model: LanguageModel, profile: str) -> None:
    """Refuse, as a ModelError, a local model that no prompt of a profile can be put to."""
    from karma.models.llama.model import LlamaModel

    if not isinstance(model, LlamaModel):
        return  # a server says so itself
    smallest = render(profile, PlanRequest(instruction="Open the fridge."))
    try:
        model.check(smallest.prompt)
    except RequestRefused as error:
        another = "" if profile == "compact" else 'profile = "compact", '
        raise ModelError(
            f"{error}; so no request can be asked in the {profile} profile\n"
            f"  To fix: {another}a longer n_ctx (--n-ctx), or another model"
        ) from error


def language_model(models: Models, session: Session, seed: int) -> tuple[LanguageModel, str]:
    """Return the planner's model and its prompt profile.

    Raises:
        ModelError: it is missing, damaged or of the wrong kind, or a hosted one out of reach.
    """
    if models.hosted.planner is not None:
        hosted = registry.load("planners", OPENAI)(
            models.hosted.planner,
            session=session,
            constrained=models.constraint != "free" and models.profile != TOOLS,
            thinking=models.thinking,
            seed=seed,
        )
        return hosted, models.profile or "full"
    file = resolve_planner(models.planner)
    local = registry.load("language_models", "llama")(
        file.path,
        options=models.llama,
        name=file.name,
        sha256=file.sha256,
        restore=file.fix,
        chat=file.chat if models.chat is None else models.chat,
        thinking=models.thinking,
    )
    return local, models.profile or file.prompt_profile


PICTURES = {"renderDepthImage": True, "renderInstanceSegmentation": True}  # AI2-THOR's flags


def world_maker(name: str, options: Iterable[Mapping[str, Any]]) -> Callable[[], World]:
    """Return what makes a run's worlds: with depth and instance masks where a row looks at them."""
    make: Callable[..., World] = registry.load("worlds", name)
    looks = any(one.get("perception", METADATA) != METADATA for one in options)
    return partial(make, **PICTURES) if looks else make
