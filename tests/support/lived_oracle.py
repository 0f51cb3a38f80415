"""What a request means, worked out from its words, the start and the log alone.

It shares nothing with `karma.plugins.homes.lived` but the sentences' data: words are matched
against the forms, times are computed anew, and where things are is replayed from the start.
"""

import re

from karma.household.types import in_words, object_types
from karma.plugins.homes.lived.request import request_forms
from tests.support.lived import DAY_S, HOUR_S

DAY_NAMES = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")
PART_HOURS = {"morning": (5, 12), "afternoon": (12, 18), "evening": (18, 24)}
ROOM_NAMES = ("living room", "kitchen", "bedroom", "bathroom")
MOVES = ("PickupObject", "PutObject")
SPAN = rf"this \w+|yesterday \w+|on (?:{'|'.join(DAY_NAMES)}) \w+"


# ----------------------------------------------------------------- replay


def places_at(start, log, time_s):
    """Return where each thing is at a time, by the start and the log."""
    where = {key: one.place_id for key, one in start.items()}
    for deed in log:
        if deed.time_s <= time_s and deed.action in MOVES:
            where[deed.object_id] = deed.place_id if deed.action == "PutObject" else "hand"
    return where


def dirty_at(start, log, time_s):
    """Return which things are dirty at a time."""
    dirty = {key: "dirty" in one.states for key, one in start.items()}
    for deed in log:
        if deed.time_s <= time_s and deed.action in ("DirtyObject", "CleanObject"):
            dirty[deed.object_id] = deed.action == "DirtyObject"
    return dirty


# ----------------------------------------------------------------- words


class WordsOracle:
    """What words mean in a home at a time.

    Args:
        view: of the home, with things called by their plain names.
        log: of the home, any deeds of after are left out.
    """

    def __init__(self, view, log, time_s):
        self._view, self._time_s = view, time_s
        self._log = [deed for deed in log if deed.time_s <= time_s]
        self.where = places_at(view.start, self._log, time_s)
        self._dirty = dirty_at(view.start, self._log, time_s)

    def meaning(self, request):
        """Return (form, its words) of a request, by the first form that its text has."""
        for name in ("count", "time", "who", "place_then", "errand", "place"):
            for form in getattr(request_forms(), name).forms:
                found = re.fullmatch(_pattern(form, name), request.text, re.I)
                if found:
                    return name, found.groupdict()
        raise AssertionError(f"no form has {request.text!r}")

    def things(self, phrase, speaker):
        """Return the ids of all things that a noun phrase fits."""
        phrase = re.sub("^the ", "", phrase, flags=re.I)
        deed = re.fullmatch(rf"(.+?) that (\w+) (.+?) ({SPAN})", phrase)
        if deed:
            who = speaker if deed[2] == "I" else deed[2]
            return self.things(deed[1], speaker) & self._handled(who, deed[3], deed[4])
        place = re.fullmatch(r"(.+?) ((?:on|in) the .+)", phrase)
        if place:
            ids = self.place_ids(place[2])
            return {key for key in self.things(place[1], speaker) if self.where[key] in ids}
        state = re.fullmatch(r"(dirty|clean) (.+)", phrase)
        if state:
            wanted = state[1] == "dirty"
            return {key for key in self.things(state[2], speaker) if self._dirty[key] == wanted}
        return {
            key
            for key, one in self._view.start.items()
            if in_words(one.object_type) == phrase.lower()
        }

    def place_ids(self, words):
        """Return the ids of all furniture that words mean."""
        words = re.sub("^(?:on |in )?(?:the )?", "", words)
        beside = re.fullmatch(r"where the (.+) is", words)
        if beside:
            return {self.where[key] for key in self.things(beside[1], "")}
        kind, _, room = words.rpartition(" in the ")
        if not room or (not kind and room not in ROOM_NAMES):
            kind, room = words, ""
        if words in ROOM_NAMES:
            kind, room = "", words
        return {
            one.place_id
            for one in self._view.places.values()
            if kind in ("", in_words(one.place_type))
            and room in ("", {"living": "living room"}.get(one.room_kind, one.room_kind))
        }

    def places_during(self, key, span):
        """Return all places where a thing was in a span of time."""
        after_s, before_s = self.span(span)
        before_s = min(before_s, self._time_s)
        times = [one.time_s for one in self._log if after_s <= one.time_s <= before_s]
        every = (after_s, *times, before_s)
        return {places_at(self._view.start, self._log, time_s)[key] for time_s in every}

    def span(self, words):
        """Return when a span begins and ends, by going back through the days."""
        *day, part = (words[0].lower() + words[1:]).split()  # it may begin a sentence
        today = int(self._time_s // DAY_S)
        first, last = PART_HOURS[part]
        if day in (["this"], ["yesterday"]):
            back = len(day[0]) > 4
        else:
            back = next(n for n in range(1, 8) if DAY_NAMES[(today - n) % 7] == day[1])
        return ((today - back) * DAY_S + hour * HOUR_S for hour in (first, last))

    def deeds(self, key, who="", verb="", table="do"):
        """Return the deeds with a thing, of somebody, by a verb."""
        return [
            deed
            for deed in self._log
            if deed.object_id == key
            and (not who or deed.who == who)
            and (not verb or verb in getattr(request_forms(), table).get(deed.action, ()))
        ]

    def _handled(self, who, verb, span):
        after_s, before_s = self.span(span)
        return {
            key
            for key in self._view.start
            for deed in self.deeds(key, who, verb, "did")
            if after_s <= deed.time_s <= before_s
        }


def _pattern(form, name):
    """Return a form as a pattern with its words by name."""
    text = re.escape(form)
    verbs = sorted({verb for all_ in request_forms().do.values() for verb in all_}, key=len)
    rooms = "|".join(ROOM_NAMES)
    kinds = "|".join(
        in_words(one) for one, kind in object_types().items() if kind.can("receptacle")
    )
    spots = {
        "thing": "(?P<thing>.+?)", "things": "(?P<things>.+?)", "at": "(?P<at>(?:on|in) the .+)",
        "to": f"(?P<to>(?:on|in) the (?:{kinds})(?: in the (?:{rooms}))?|where the .+? is)",
        "span": f"(?P<span>{SPAN})",
        "who": r"(?P<who>\w+)", "do": f"(?P<do>{'|'.join(reversed(verbs))})",
    }  # fmt: skip
    for spot, pattern in spots.items():
        text = text.replace(re.escape("{" + spot + "}"), pattern)
    return text
