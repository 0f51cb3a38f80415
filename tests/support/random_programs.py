"""Random programs of a spec."""

from karma.models.automaton import CLOSINGS


def random_program(automaton, generator, lines):
    """Return a program of so many lines, or a refusal, each choice made uniformly."""
    text, frame, done = [], automaton.start().frame, 0
    while done < lines and not frame.ends:
        choices = len(frame.words) - (len(CLOSINGS) if frame.line_start else 0)
        word = int(generator.integers(choices))
        text.append(frame.words[word])
        frame = frame.follow[word]()
        done += frame.line_end
    return "".join([*text, "\n"])
