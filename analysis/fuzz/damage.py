"""Hypothesis' strategies for damaged files, hostile command lines and damaged campaign files."""

from __future__ import annotations

from typing import AnyStr

from hypothesis import assume
from hypothesis import strategies as st

from analysis.fuzz.inputs import COMMANDS, GIVEN, NEVER_STARTS, VALUES

SIZES = (0, 1, 8, 512, 4096, 10**9)  # length of a part that is replaced
CAMPAIGN: str = GIVEN["campaign"]
PIECES = (*GIVEN["pieces"], "9" * 400, "[" * 300)  # pieces of text


@st.composite
def edited(draw: st.DrawFn, original: AnyStr, pieces: st.SearchStrategy[AnyStr], most: int = 5) -> AnyStr:
    """Bytes or text in which one to `most` parts were replaced; always different from the original."""
    changed = original
    for _ in range(draw(st.integers(1, most))):
        at, size = draw(st.integers(0, len(changed))), draw(st.sampled_from(SIZES))
        changed = changed[:at] + draw(pieces) + changed[at + size :]
    assume(changed != original)
    return changed


def damaged(content: bytes) -> st.SearchStrategy[bytes]:
    """The content of a file with parts that are missing, inserted, or replaced by noise or by another part of it."""
    fills = [st.binary(max_size=size) for size in (1, 8, 512)] + [st.sampled_from([bytes(512), b"\xff" * 512])]
    parts = st.tuples(st.integers(0, len(content)), st.sampled_from(SIZES[:-1])).map(lambda x: content[x[0] : sum(x)])
    return edited(content, st.one_of(*fills, parts))


def damaged_campaigns() -> st.SearchStrategy[str]:
    """The text of a campaign file with one to five changes."""
    return edited(CAMPAIGN, st.sampled_from([*PIECES, *CAMPAIGN.splitlines(keepends=True)]) | st.text(max_size=5))


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    """A command with one to three hostile values."""
    values = st.sampled_from(VALUES) | st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=20)
    name = draw(st.sampled_from(sorted(COMMANDS)))
    words, options = COMMANDS[name]
    choices = {"VALUE": values, "FILE": st.sampled_from(["s.state.nc", "r.run.nc"]) | values}
    made = [draw(choices[word]) if word in choices else word for word in words]
    for option in draw(st.lists(st.sampled_from(options), max_size=3, unique=True)) if options else []:
        made += [option, draw(values)]
    return [name, *made, *(["-o", "missing/x.nc"] if name in NEVER_STARTS else [])]
