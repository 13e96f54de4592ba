"""Contact laws; each is a subclass of ContactLaw in a separate file.

base                interface of a contact law
vectors             three-component vectors as tuples, for the formulas
rolling_resistance  rolling-resistance law of YADE
spring_dashpot      spring-dashpot law of He et al. (Eqs. 1-3)
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
    """Register a subclass of ContactLaw under its `name` and return it; a decorator."""
    return LAWS.register(kind)


__all__ = ["LAWS", "Contact", "ContactLaw", "Features", "Response", "register_law"]
