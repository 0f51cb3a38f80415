"""A text as it was meant: without fillers, doubled words, list marks and what was taken back.

"Put the tomato, no wait, the apple in the bowl" is about the apple. Words for things are the text's
own; a form of speech may be said plainly, or stand in the order in which it is to be done.
"""

import re
from collections.abc import Callable, Sequence

_SIGNS = str.maketrans(
    {"‘": "'", "’": "'", "“": '"', "”": '"', "…": ".", "–": "-", "—": "-", "\t": " "}
)
_FILLERS = (
    "u+m+", "u+h+", "so{2,}", "e+r+m?", "hm+", "pls", "plz", "please", "kindly",
    "thanks(?: a lot| so much)?",
    "thank you(?: so much| very much)?", "thx", "ta", "cheers", "mate", "dear", "buddy", "pal",
    "hey", "hi", "hello", "ok", "okay", "alright", "listen", "well then", "you know",
    "i mean,? like", "yeah", "good (?:morning|evening|day|afternoon)", "excuse me",
    "pardon(?: me| the interruption)?",
    "sorry(?: to (?:bother|ask|trouble|disturb)(?: you)?| about (?:this|that))?",
    "at your (?:earliest )?convenience", "if you (?:don't|do not|wouldn't) mind",
    "if (?:it's|it is) no(?:t too much)? trouble", "if possible", "if you (?:can|could)",
    "(?:when|if) you (?:have|get) (?:time|a (?:moment|minute|second|chance))", "no need to hurry",
    "for me", "one more thing:?",
)  # fmt: skip
_FILLER = re.compile(
    rf"(?<![\w'])(?:{'|'.join(_FILLERS)})(?![\w'])[,!.]*(?:\s*\bbut\b)?", re.IGNORECASE
)
_SPOKEN = (
    (r"\bgimme\b", "give me"), (r"\blemme\b", "let me"), (r"\bwanna\b", "want to"),
    (r"\bgotta\b", "have to"),
    (r"\b(?:teh|hte|th|thw)\b(?= \w)", "the"), (r"\bn\b", "and"), (r"\bu\b", "you"),
    (r"\b(on|in|to|at|into|onto|from)(the|my)\b", r"\1 \2"), (r"\s*-+>\s*", " to the "),
    (r"(?:(?<=^)|(?<=[,.;] )|(?<=and ))(turn|switch|pick|put|throw|shut|take)"
     r"(on|off|up|out|away|down)\b", r"\1 \2"),
    (r"\bas well as\b(?! (?:you|possible|it|ever))", "and"), (r",? after which\b", ", then"),
    (r"\bdo (?:so|(?:just )?the same)(?: thing)? (?:with|to|for) ([\w ]+)", r"\1 likewise"),
    (r"\bi(?:'m| am| was)? hop(?:e|ing) (?:that )?you (?:could|can|would|will|might)\b",
     "could you"), (r"\bget rid of\b", "throw away"),
    (r"\b(?:and )?(?:when|once|after) (?:that|this|it)(?:'s| is| has been)"
     r" (?:done|finished|over|ready)\b,?", "then"),
    (r"(?:^|(?<=[.;] ))(?P<at>(?:on|in|into|onto|inside|under|near|next to|beside)"
     r" (?:the|my|a|that) [\w ]+?),? (?P<verb>put|place|set|lay|leave|drop|stand)"
     r" (?P<rest>[^,.;]+)",
     r"\g<verb> \g<rest> \g<at>"),
    (r"^\W*(?:(?:just )?(?:one|two|three|four|a few|a couple of|some) (?:more )?"
     r"(?:things?|wishes|jobs|tasks|requests|favou?rs)"
     r"|(?:your|the|my) (?:jobs?|tasks?|orders?|list)(?: (?:today|now))?(?: (?:is|are))?"
     r"|do the following|here(?: is|'s) what to do"
     r"|the following(?: (?:needs?|has|have) (?:doing|to be done))?)(?: for you)?\s*[:.,]\s+"
     r"(?P<noun>the |a |my |all )?", lambda led: f"I want {led['noun']}" if led["noun"] else ""),
    (r"(?:and )?only if it(?:'s| is) (?:no|not too much) trouble,?", ""),
    (r"\bthanks for [^.!?]*[.!]", ""), (r"\bwith your permission,?", ""),
    (r"\b(?:don't|dont|do not) worry about [^,.;]*[,.;]", ""),
    (r"\b(?:don't|dont|do not) hesitate to\b", ""),
    (r"\b(?:unless|if) i(?:'m| am) (?:not )?(?:wrong|mistaken),?", ""),
    (r"\b(?:has|have|ought) to (?=(?:go|be|stand)\b)", "should "),
    (r"\b(?:pronto|asap|right away|at once)\b", ""),
    (r"\b(?:could|would|can) ya\b", "could you"),
    (r"\b(?:nip|pop|hop|run|go|head|come) (?:over |across |along |in )?(?:there )?and\b", ""),
    (r"\b(?:do not|don't|dont|never) (?:you )?forget (?:to )?(?=\w)", ""),
    (r"\bdo me (?:a|the) (?:favou?r|kindness)(?: and| of)\b", ""),
    (r"(?P<a>[^.;!?]+)[.;,]\s*(?:but (?:first|before that)|(?:first|before that),? though),?\s*"
     r"(?P<b>[^.;!?]+)", r"\g<b>, then \g<a>"),
    (r"\bbefore (?:doing )?anything else,?", ""),
    (r"(?:(?<=[;,.])\s*|\band )(?:later(?: on)?|next),? (?=[a-z]+ (?:the|a|an|my|some|it|them)\b)",
     " then "),
    (r"\bi(?:'d| would) (?:also |really |very much )*(?:appreciate it|love it|like it"
     r"|be (?:so |very |ever so |really |most )*(?:grateful|glad|happy|thankful|obliged|pleased))"
     r"(?: very much| so much)? if you (?:(?:could|would|can|might) )?", ""),
    (r"\bif (?:it's|it is|that's|that is|it isn't|it is not|it's not)(?: not)? (?:all right|alright"
     r"|ok(?:ay)?|too much(?: trouble| to ask)?|a bother|convenient)(?: with you)?,?", ""),
    (r"\bwhen(?:ever)? it suits you,?", ""),
    (r"\bi (?:wouldn't|would not) (?:mind|say no to)\b|\bi could do with\b", "I'd like"),
    (r"^\W*(?:do you )?fancy (?=\w+ing\b)", ""), (r"\bi(?:'m| am) looking for\b", "bring me"),
    (r"^\W*is there any chance of (?P<what>(?:the|my) [\w ]+?) being (?P<deed>\w+)",
     r"I want \g<what> \g<deed>"),
    (r"\bmay i ask (?:you )?(?:for )?(?:a |one )?(?:small |big |little )?favou?r(?: of you)?\W*",
     ""),
    (r"\bwould(?:n't| not)? it be (?:so |very )?(?:nice|great|lovely|good) if (?=the|my|a\b|all)",
     "I want "),
    (r",? or wherever (?:it|they) (?:may|might) be,?", ""),
    (r"\b(?:out of|from) wherever (?:it|they) (?:is|are|may be)\b", ""),
    (r"\blook (?:on|in|under|behind|inside|around) (?:the|my) [\w ]+? and (?=\w+ (?:it|them)\b)",
     ""), (r"^(I want [^?]*)\?+$", r"\1."),
    (r"\bshelve (?P<what>(?:the|a|my|that|this|every) [\w ]+?)(?=[,.;!?]| and\b|$)",
     r"put \g<what> on the shelf"),
    (r"\b(?:take your time|keep calm|calm down|take care|have a look(?: a?round)?|turn around"
     r"|hurry(?: up)?|be (?:quick|careful)|wait a (?:second|moment|minute)|do it again)"
     r"\b(?:,|:| and| but)", ""),
    (r"^(?P<lead>\W*before you [^,]+, )i(?:'d| would)? (?:need|want|like) (?P<what>[^,.]+?) "
     r"(?P<deed>opened|closed|washed|rinsed|cleaned|sliced|heated|warmed|chilled|cooled|filled)\b",
     r"\g<lead>\g<deed> \g<what>"),
    (r"(?P<told>\b(?:i|i'm|i've|it|it's|the|my|we|we're|he|she|there|there's)\b[^,.?!;:]*),\s*"
     r"(?:(?:but|so|and) )?(?=(?:could|can|would|will) you\b)", r"\g<told>. "),
    (r"\b(like|need|want):\s", r"\1 "),
    (r"\bdo the (?:dishes|washing[- ]up)\b", "wash the dishes"),
    (r"\b(?:it|that)(?:'d| would) be (?:so |very |really )?(?:nice|great|lovely|good|kind|helpful)"
     r"(?: of you)? if you (?:(?:could|would|can|might) )?", ""),
    (r"\bno need to\b", "don't"), (r"\b(?:a (?:little )?bit|a little|slightly)\b(?! of)", ""),
    (r"\b(?:make sure|ensure|see to it)(?: that)? (?P<what>(?:the|my|both|all|every|each)\b"
     r" [^,.;]*?) (?:is|are)\b(?!n't| not)", r"I want \g<what>"),
    (r"\bgive (?P<what>(?:the|a|my|that|this|every) [\w ]+?|it|them) a (?:good |quick |proper )?"
     r"(?P<deed>wash|rinse|scrub|clean|polish)\b", r"\g<deed> \g<what>"),
    (r"\b(?:until|till) (?:it|they)(?: is| are|'s|'re) (?:done|hot|warm|cold|clean|cooked|ready)\b",
     ""),
    (r",\s*(?:love|darling|sweetie|honey|my friend)\b", ""),
    (r"\bwould you mind (?:\w+ly )?(?=\w+ing\b)", ""),
    (r"\buse (the [\w ]+?) (?:and|to) (?=\w+ the)", ""),
    (r"\b(?:when|once) you(?:'re| are|'ve| have) (?:done|finished|ready|found)(?: so| it| that)?,?",
     "then"),
    (r"\b(?:and|then|,) (?:then )?(?P<p>on|off) again\b", r", then turn it \g<p>"),
)  # fmt: skip
_POLITE = (
    "would", "could", "can", "will", "might", "may", "is it", "is there", "be", "i was wondering",
    "i wonder", "i'd be", "i would be", "i'd appreciate", "i would appreciate", "it'd be",
    "it would be", "fancy", "how about", "what about", "any chance",
)  # fmt: skip
_LEADS = (
    r"\bto", r"\band", r"\bif you (?:could|would|might|can)?",
    r"\bwhether you (?:could|would|might|can)", r"\bthat you", r"\bof you", r"\bfor you to",
    r"\babout", r"\bfancy",
)  # fmt: skip
_ASKING = re.compile(
    rf"^(?:[^.?!]{{0,60}}?[,:;\s-])??(?:{'|'.join(_POLITE)})\b[^.?!]{{0,90}}?"
    rf"(?:{'|'.join(_LEADS)}) (?P<rest>\w+\b.*)$",
    re.IGNORECASE,
)
_ROBOT = re.compile(r"^\W*(?:robot|karma)\b(?: listen)?\s*[,:!]*\s*|,\s*robot\b", re.IGNORECASE)
_OTHERWISE = re.compile(
    r"[\s,;.]+(?:otherwise|if not|or else),? (?:just )?(?:leave|keep|let) (?:it|them|that)\b"
    r"[^.;,]*",
    re.IGNORECASE,
)
_DOUBLED = re.compile(r"\b(the|a|an|and|put|it|in|on|to|my|of)(?:\s+\1\b)+", re.IGNORECASE)
_MARK = re.compile(r"(?:^|(?<=[\s.;]))(?:[-*•]|\(?(?:\d{1,2}|[a-h])[.)])\s+(?=[A-Za-z])")
_ORDER = re.compile(
    r"(?:(?<=^)|(?<=[.;,]\s)|(?<=\band\s))(?:first(?:ly)?(?: of all)?|second(?:ly)?|third(?:ly)?"
    r"|last(?:ly)?(?: of all)?|finally|in the end|at the end|afterwards|after that)\b,?\s+",
    re.IGNORECASE,
)
_BACK = (
    "no[, ]+(?:wait|sorry|not that|actually)", "no", "wait", "sorry", "oops", "i mean", "or rather",
    "rather", "i meant", "scratch that", "correction", r"actually,?\s+make (?:that|it)",
    "make (?:that|it)", r"actually,?\s+no",
)  # fmt: skip
_TAKEN_BACK = re.compile(
    rf"[\s,.;:-]*[,.;:-]\s*(?:(?:oh|er)[, ]+)?(?:{'|'.join(_BACK)})\b[\s,:.-]*", re.IGNORECASE
)
_PREPOSITION = r"(?:in|on|into|onto|to|at|under|near|from|beside|next to|inside|behind|off)"
_DETERMINER = r"(?:the|a|an|my|your|our|his|her|both|all|every|each|one|two|three|four|that|this)"


_SENTENCE_END = re.compile(r"(?<!\bMr)(?<!\bMrs)(?<!\bMs)(?<!\bDr)[.?!;]+(?=\s)", re.IGNORECASE)


def as_meant(text: str) -> str:
    r"""Return a text without what people did not mean to say.

    >>> as_meant("put the tomato, no wait, the apple into the fridge")
    'put the apple into the fridge'
    >>> as_meant("um could you uh take the the mug, please")
    'could you take the mug'
    >>> as_meant("1) wash the plate\n2) put it on the table")
    'wash the plate. put it on the table'
    """
    said = text.translate(_SIGNS).replace("...", ", ")
    if said.upper() == said:
        said = said.lower()
    said = re.sub(r"\s*[\r\n\v\f\x85\u2028\u2029]+\s*", ". ", said.strip())
    said = _MARK.sub(lambda mark: "" if mark.start() == 0 else ". ", said)
    for form, instead in _SPOKEN:
        said = re.sub(form, instead, said, flags=re.IGNORECASE)
    said = _OTHERWISE.sub("", _corrected(said))
    said = _ROBOT.sub("", _FILLER.sub(" ", said).strip())
    said = _DOUBLED.sub(r"\1", said)
    said = _ORDER.sub(lambda found: "" if found.start() == 0 else "then ", said)
    said = re.sub(r"\s+", " ", said)
    said = re.sub(r"\s+([,.;:!?])", r"\1", said)
    said = re.sub(r"([.;])(?:\s*[.,;])+", r"\1", said)
    said = (
        re.sub(r"\b(?:would|could|will|can) (?:you|ya)\s*[.?!]*$|,\s*will (?:you|ya)\b", "", said)
        if len(said.split()) > 3
        else said
    )
    said = re.sub(r"[\s,]+(?:and|but)([.!?]*)$", r"\1", said).strip(" ,;-")
    return _beforehand(said)


def _beforehand(text: str) -> str:
    """Return "bring me the mug; I want it washed first" in the order in which it is to be done."""
    found = re.fullmatch(
        r"(?P<then>[^.;!?]+)[.;,]\s*(?P<first>[^.;!?,]+?),? (?:beforehand|before that|first)[.!]*",
        text, re.IGNORECASE,
    )  # fmt: skip
    if found is None:
        return text
    thing = _NAMED.search(found["then"])
    first = (
        re.sub(r"\b(?:it|them)\b", thing[0], found["first"], count=1) if thing else found["first"]
    )
    return f"{first}, then {found['then'][0].lower()}{found['then'][1:]}"


def _corrected(text: str) -> str:
    """Return a text without what is taken back in it."""
    for _ in range(4):
        found = _TAKEN_BACK.search(text)
        if found is None or found.start() == 0:
            return text
        before, after = text[: found.start()], text[found.end() :]
        cut = _cut_back(before, after)
        if cut is None:
            return text
        after = re.sub(rf"^([^,.;]*),\s*(?={_PREPOSITION}\b)", r"\1 ", after)
        text = f"{before[:cut].rstrip()} {after}"
    return text


def _cut_back(before: str, after: str) -> int | None:
    """Return where what is taken back begins: at the word of the kind that the correction has."""
    for kind in (_PREPOSITION, _DETERMINER):
        if re.match(rf"{kind}\b", after, re.IGNORECASE):
            places = [one.start() for one in re.finditer(rf"\b{kind}\b", before, re.IGNORECASE)]
            return places[-1] if places else None
    clause = re.search(r"[.;]\s*[^.;]*$", before)
    return clause.start() + 1 if clause else 0


def sentences_of(text: str) -> list[str]:
    """Return the sentences of a text, each with its end.

    >>> sentences_of("put Mr. Smith's mug in the sink. open the fridge!")
    ["put Mr. Smith's mug in the sink.", 'open the fridge!']
    """
    ends = [found.end() for found in _SENTENCE_END.finditer(text)]
    parts = (text[a:b].strip() for a, b in zip([0, *ends], [*ends, len(text)], strict=True))
    return [part for part in parts if part]


def without_courtesy(
    sentence: str, is_deed: Callable[[str], bool], names: Callable[[str], bool]
) -> str:
    """Return what is asked for so politely that it looks like a question or a wish.

    Args:
        sentence: one.
        is_deed: whether a word, in any form of a verb, is something that can be done.
        names: whether words name a thing or a deed, so that they may not be left out.

    >>> is_wash = lambda words: "wash" in words
    >>> without_courtesy("would it be possible for you to wash the mug?", is_wash, is_wash)
    'wash the mug'
    """
    found = _ASKING.match(sentence)
    if found is None:
        return sentence
    start = found.start("rest")
    for verb in re.finditer(r"\w+", sentence[start:]):
        begin = start + verb.start()
        led = re.search(r"\b(?:to|and|you|fancy|about|of)\s+$", sentence[:begin], re.IGNORECASE)
        if is_deed(verb[0].lower()) and (led or verb.start() == 0):
            left_out = re.sub(r"^\W*(?:would|could|can|will)\b", "", sentence[:begin])
            return sentence if names(left_out) else sentence[begin:].rstrip(" ?")
    return sentence


def spelt(
    text: str, is_known: Callable[[str], bool], words: Sequence[str], verbs: Sequence[str] = ()
) -> str:
    """Return a text with words that nobody knows spelt as one that is one slip away.

    Args:
        text: what is said.
        is_known: whether a word, in small letters, is one of the language.
        words: that may be meant.
        verbs: of them, those that a sentence may begin with; they are meant rather there.

    >>> spelt("trun on the lamp", lambda word: word != "trun", ["turn", "tap"])
    'turn on the lamp'
    """

    def right(found: re.Match[str]) -> str:
        word = found[0]
        if len(word) < 3 or "'" in word or word[0].isupper() or is_known(word.lower()):
            return word
        begins = re.search(r"(?:^|[.;!?,]\s*)$", text[: found.start()]) is not None
        likely = [*verbs, *words] if begins else words
        return next((one for one in likely if _is_a_slip(word.lower(), one)), word)

    return re.sub(r"[A-Za-z]+(?:'[A-Za-z]+)*", right, text)  # "doesn't" is one word


def _is_a_slip(word: str, right: str) -> bool:
    """Return whether a word is another with one letter too many, missing, wrong or out of order."""
    if abs(len(word) - len(right)) > 1 or word[0] != right[0]:
        return False
    same = next((n for n, (a, b) in enumerate(zip(word, right, strict=False)) if a != b), None)
    if same is None:
        return len(word) != len(right)
    rest, wanted = word[same:], right[same:]
    swapped = rest[1:2] + rest[:1] + rest[2:]
    return wanted in (swapped, rest[1:]) or rest == wanted[1:] or rest[1:] == wanted[1:]


_NAMED = re.compile(r"\b(?:the|a|an|my)\s+[\w' -]+?(?=$|,| (?:in|on|into|onto|to|from|and|off)\b)")
_FIRST, _LATER = r"(?P<first>[^,.;!?]+?)", r"(?P<later>[^,.;!?]+?)"
_REST = {"first": r"(?P<first>\w+\b[^.;!?]*)", "later": r"(?P<later>\w+\b[^.;!?]*)"}
_HAVING = r"(?:you(?:'ve| have)? |having )?"
_ORDERS = tuple(
    re.compile(form, re.IGNORECASE)
    for form in (
        rf"^before you (?:go and )?{_LATER},\s*{_REST['first']}",
        rf"^(?P<first>[^.;!?]+?),?\s+before (?:you )?{_REST['later']}",
        rf"^(?:after|once|when|as soon as) {_HAVING}{_FIRST},\s*{_REST['later']}",
        rf"^having {_FIRST},\s*{_REST['later']}",
        rf"^(?P<later>[^.;!?]+?),?\s+(?:after|once|when) {_HAVING}{_REST['first']}",
    )
)


def in_order(sentence: str, base_of: Callable[[str], str]) -> str:
    """Return a sentence with its deeds as they are to be done: what comes first stands first.

    Args:
        sentence: one.
        base_of: the base form of a verb that asks for something, "" for any other word.

    >>> bases = {"heat": "heat", "wash": "wash", "washing": "wash"}
    >>> in_order("before you heat the potato, wash it", lambda word: bases.get(word, ""))
    'wash the potato, then heat the potato'
    >>> in_order("heat the potato after washing it", lambda word: bases.get(word, ""))
    'wash the potato, then heat the potato'
    """
    for form in _ORDERS:
        found = form.match(sentence)
        if found is None:
            continue
        first, later = found["first"].strip(), found["later"].strip()
        said = (first, later) if found.start("first") < found.start("later") else (later, first)
        heads = [base_of(text.split()[0].lower()) for text in (first, later)]
        if not all(heads):
            continue
        named = _NAMED.search(said[0])
        parts = [
            " ".join((head, *text.split()[1:]))
            for head, text in zip(heads, (first, later), strict=True)
        ]
        if named is not None:
            parts = [re.sub(r"\b(?:it|them)\b", named[0], part, count=1) for part in parts]
        place = re.search(r"\b(?:in|on|into|onto|to|at|under) (?:the|a|my) [\w' -]+$", parts[1])
        if place is not None and parts[0].endswith(" there"):
            parts[0] = f"{parts[0].removesuffix('there')}{place[0]}"
        end = sentence[found.end() :]
        return f"{parts[0]}, then {parts[1]}{end}"
    return sentence
