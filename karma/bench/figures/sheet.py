"""A table in words, and how it is written as Markdown or LaTeX."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A table in words."""

    title: str
    caption: str
    head: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]


def to_markdown(tables: Sequence[Sheet]) -> str:
    """Write sheets as Markdown."""
    return "\n".join(_markdown(sheet) for sheet in tables)


def _markdown(sheet: Sheet) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    rows = [line(sheet.head), "|" + "---|" * len(sheet.head), *map(line, sheet.lines)]
    return f"### {sheet.title}\n\n" + "\n".join(rows) + f"\n\n{sheet.caption}\n"


def to_latex(tables: Sequence[Sheet]) -> str:
    """Write sheets as LaTeX tables; they need the packages booktabs and graphicx."""
    return "% \\usepackage{booktabs,graphicx}\n" + "\n".join(_latex(sheet) for sheet in tables)


def _latex(sheet: Sheet) -> str:
    def line(cells: Sequence[str]) -> str:
        return " & ".join(map(_escaped, cells)) + r" \\"

    return "\n".join(
        (
            r"\begin{table}[t]",
            r"\centering",
            rf"\caption{{{_escaped(sheet.title)}. {_escaped(sheet.caption)}}}",
            r"\resizebox{\linewidth}{!}{%",
            rf"\begin{{tabular}}{{l{'r' * (len(sheet.head) - 1)}}}",
            r"\toprule",
            line(sheet.head),
            r"\midrule",
            *map(line, sheet.lines),
            r"\bottomrule",
            r"\end{tabular}}",
            r"\end{table}",
            "",
        )
    )


_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "–": "--", "×": r"$\times$", "<": r"$<$", ">": r"$>$", "[": "{[}", "]": "{]}",
}  # fmt: skip


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(letter, letter) for letter in text)
