"""Docstrings are plain text: escape what reStructuredText would read as markup, and link the numbers of equations."""

import re

from sphinx.ext import autosummary

EQUATION = re.compile(r"\b(Eqs?\. )((?:\d+|C\d)(?:(?:, | and | to |-)(?:\d+|C\d))*)|\b(C[0-5])\b(?!:)")
NUMBER = re.compile(r"\d+|C\d")
CODE = re.compile(r"(``.+?``|`[^`]+`)")
NUMBERS = {*map(str, range(1, 35)), *(f"C{k}" for k in range(6))}  # of the paper, each an anchor of theory.md


def _number(match):
    text = match[0]
    return f":ref:`{text} <eq-{text.lower()}>`" if text in NUMBERS else text


def _link(text):
    def equation(match):
        return (
            NUMBER.sub(_number, match[3])
            if match[3]
            else match[1].rstrip() + "\N{NO-BREAK SPACE}" + NUMBER.sub(_number, match[2])
        )

    return EQUATION.sub(equation, text)


def _escape(text):
    return re.sub(r"([\\*|]|_(?=\W|$))", r"\\\1", text)


def plain(line):
    """One line of a docstring as reStructuredText that shows the same text."""
    parts = CODE.split(line)
    return "".join(f"``{part.strip('`')}``" if part[:1] == "`" else _link(_escape(part)) for part in parts)


def convert(lines):
    """A docstring as reStructuredText: paragraphs of text, and indented blocks as code."""
    result, code = [], False
    for line in lines:
        indented = line.startswith("    ")
        if indented and not code:
            result += ["", ".. code-block:: text", ""]
        elif code and not indented and line:
            result.append("")
        code = indented or (code and not line)
        result.append(line if indented else plain(line.strip()))
    return result


def process(app, what, name, obj, options, lines):
    """Convert the docstring of an object in place."""
    lines[:] = convert(lines)


def setup(app):
    """Convert all docstrings that autodoc reads; a first sentence does not end at the full stop of "Eq. 3"."""
    autosummary.WELL_KNOWN_ABBREVIATIONS += ("Eq.", "Eqs.", "Fig.")
    app.connect("autodoc-process-docstring", process)
