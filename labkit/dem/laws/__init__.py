"""Contact laws: each one subclass of ContactLaw in a file of its own.

base                what a law says of itself
vectors             three-vectors as tuples, for the formulas
rolling_resistance  YADE's rolling-resistance law
spring_dashpot      Eqs. 1-3 of He et al.
"""

from labkit.dem.laws.base import Contact, ContactLaw, Features, Response
from labkit.extensions import Registry

LAWS: Registry = Registry(
    "contact law",
    {
        "rolling_resistance": "labkit.dem.laws.rolling_resistance:RollingResistance",
        "spring_dashpot": "labkit.dem.laws.spring_dashpot:SpringDashpot",
    },
    aliases={"yade": "rolling_resistance", "paper": "spring_dashpot"},  # names of version 0.1.0
)


def register_law(kind: type[ContactLaw]) -> type[ContactLaw]:
    """A decorator that makes a subclass of ContactLaw known under its `name`."""
    return LAWS.register(kind)


__all__ = ["LAWS", "Contact", "ContactLaw", "Features", "Response", "register_law"]
