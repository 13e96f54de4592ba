"""Contact laws; each is a subclass of ContactLaw in a separate file.

base                interface of a contact law
vectors             three-component vectors as tuples, for the formulas
rolling_resistance  rolling-resistance law of YADE
spring_dashpot      spring-dashpot law of He et al. (Eqs. 1-3)
springs_in_series   the same with the stiffness of PFC
hertz_mindlin       Hertz-Mindlin law of YADE; hertz_mindlin_dashpot: with its dashpots
"""

from labkit.dem.laws.base import Contact, ContactLaw, Features, Response, Tangents
from labkit.extensions import Registry

LAWS: Registry = Registry(
    "contact law",
    {
        "rolling_resistance": "labkit.dem.laws.rolling_resistance:RollingResistance",
        "spring_dashpot": "labkit.dem.laws.spring_dashpot:SpringDashpot",
        "springs_in_series": "labkit.dem.laws.springs_in_series:SpringsInSeries",
        "hertz_mindlin": "labkit.dem.laws.hertz_mindlin:HertzMindlin",
        "hertz_mindlin_dashpot": "labkit.dem.laws.hertz_mindlin_dashpot:HertzMindlinDashpot",
    },
    aliases={"yade": "rolling_resistance", "paper": "spring_dashpot"},  # names of version 0.1.0
)


def register_law(kind: type[ContactLaw]) -> type[ContactLaw]:
    """Register a subclass of ContactLaw under its `name` and return it; a decorator."""
    return LAWS.register(kind)


__all__ = ["LAWS", "Contact", "ContactLaw", "Features", "Response", "Tangents", "register_law"]
