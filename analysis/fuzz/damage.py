"""Random damage of files, and random campaign files, each from a seed."""

from __future__ import annotations

import random
from collections.abc import Callable

Damage = Callable[[bytearray, random.Random], None]


def flip_bits(content: bytearray, chance: random.Random) -> None:
    """Change one to four bits."""
    for _ in range(chance.randint(1, 4)):
        content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)


def overwrite(content: bytearray, chance: random.Random) -> None:
    """Replace a block by zeros, ones or noise."""
    at, size = chance.randrange(len(content)), chance.choice([1, 8, 512, 4096])
    fill = chance.choice([bytes(size), b"\xff" * size, chance.randbytes(size)])
    content[at : at + size] = fill[: len(content) - at]


def cut(content: bytearray, chance: random.Random) -> None:
    """Remove the end."""
    del content[chance.randrange(len(content)) :]


def drop(content: bytearray, chance: random.Random) -> None:
    """Remove a part in the middle."""
    at = chance.randrange(len(content))
    del content[at : at + chance.choice([1, 512, 4096])]


def insert(content: bytearray, chance: random.Random) -> None:
    """Insert noise, or append it."""
    at = chance.choice([chance.randrange(len(content)), len(content)])
    content[at:at] = chance.randbytes(chance.choice([1, 100, 4096]))


def exchange(content: bytearray, chance: random.Random) -> None:
    """Exchange two blocks."""
    size = chance.choice([8, 512, 4096])
    a, b = (chance.randrange(max(len(content) - size, 1)) for _ in range(2))
    first, second = content[a : a + size], content[b : b + size]
    content[b : b + len(first)], content[a : a + len(second)] = first, second


def mutate(content: bytearray, chance: random.Random) -> None:
    """Change a text in one to five places."""
    content[:] = mutated(content.decode(), chance).encode(errors="surrogatepass")


DAMAGES: dict[str, Damage] = {
    "bits flipped": flip_bits,
    "block overwritten": overwrite,
    "end missing": cut,
    "part missing": drop,
    "bytes inserted": insert,
    "blocks exchanged": exchange,
}
DAMAGES_OF_TEXT: dict[str, Damage] = {**DAMAGES, "text changed": mutate}


def damaged(content: bytes, kind: str, seed: int) -> bytes:
    """The content of a file with damage of this kind; always different from the original."""
    chance = random.Random(f"{kind} {seed}")
    while True:
        changed = bytearray(content)
        DAMAGES_OF_TEXT[kind](changed, chance)
        if bytes(changed) != content:
            return bytes(changed)


CAMPAIGN = """\
name: fuzzed
settings: quick
engine: fused
specimens:
  dense: {void_ratio: 0.606, step1_friction: 0.0405, grains: 120, seed: [1, 2]}
  stiff: {void_ratio: 0.62, grains: 120, young_modulus: 0.3 GPa}
  dense_1MPa: {from: dense, pressure: 1 MPa}
runs:
  cv: {path: cv, specimen: [dense, stiff], strain: 0.01}
  cp: {path: cp, specimen: dense_1MPa, pressure: [0.5 MPa, 1 MPa], engine: [yade, fused]}
  shear: {path: simple_shear, specimen: stiff, strain: 0.1, snapshots: 3}
"""
PIECES = (
    *"{}[]:,&*#|>-?!%@\"'`\n\t \\",
    *(
        "$(touch x)",
        "; rm x",
        "../..",
        "/dev/zero",
        "\x00",
        "\u202e",
        "é",
        "9" * 400,
        "1e999",
        "-1",
        "nan",
        "0x10",
        "~",
    ),
    *("&a [*a]", "*a", "<<: *a", "!!python/object:os.system x", "!!binary x", "from: dense", "seed: [1, 1]", "? x"),
    *(
        "void_ratio: 0.5\n",
        "  dense: {}\n",
        "runs:\n",
        "pressure: 1e300 MPa",
        "grains: 1e12",
        "engine: none",
        "[" * 300,
    ),
)


def mutated(text: str, chance: random.Random) -> str:
    """A text with one to five random changes."""
    for _ in range(chance.randint(1, 5)):
        at, kind = chance.randrange(len(text) + 1), chance.randrange(4)
        lines = text.splitlines(keepends=True)
        if kind == 0:
            text = text[:at] + chance.choice(PIECES) + text[at:]
        elif kind == 1:
            text = text[:at] + text[at + chance.randint(1, 20) :]
        elif kind == 2 and lines:
            lines.insert(chance.randrange(len(lines) + 1), chance.choice(lines))
            text = "".join(lines)
        else:
            text = text[:at] + chance.choice(PIECES) + text[at + chance.randint(1, 8) :]
    return text
