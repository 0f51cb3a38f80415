"""Random programs of a spec."""

from karma.types.grammars import forms
from karma.types.planning import RefusedRequest, SkillCall


def random_program(spec, generator, lines):
    """Return a program of so many lines, or a refusal, each choice made uniformly."""
    form_of = {skill: form for form in forms(spec) for skill in form.skills}
    begins = [skill.name for skill in spec.skills if skill.name in form_of]

    def one_of(choices):
        return choices[int(generator.integers(len(choices)))]

    def call(skill):
        form, objects, positions = form_of[skill], [], []
        for argument in form.arguments[: generator.integers(form.needed, len(form.arguments) + 1)]:
            if argument.most:
                count = 1 + int(generator.integers(argument.most))
                positions = [one_of(argument.names) for _ in range(count)]
            else:
                objects.append(one_of(argument.names))
        return str(SkillCall(skill=skill, objects=(*objects,), positions=(*positions,)))

    first = one_of([*begins, *(str(RefusedRequest(kind=kind)) for kind in spec.refusals)])
    if first not in form_of:
        return f"{first}\n"
    skills = [first, *(one_of(begins) for _ in range(lines - 1))]
    return "".join(f"{call(skill)}\n" for skill in skills)
