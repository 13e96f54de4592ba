"""What the driver requires of a constitutive law, so that any law can be loaded along any path.

A law is one class, derived from RateLaw: parameters with bounds, internal variables, and the rate of its state vector

    y = e, stress (6), internal variables, strain (6)

as a static function in the part of Python that Numba compiles. Tensors are six numbers (labkit.model.tensors);
compression is positive, stresses are in Pa. labkit's own model is a ConstitutiveLaw with another state vector, whose
stress follows from C0. Compiled code finds the functions of a law by the type of its constants, a NamedTuple.
"""

from __future__ import annotations

import abc
import collections
import functools
import json
import math
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np

from labkit.engines.kernel.frozen import Function
from labkit.errors import InputError, instead_of
from labkit.grains.scene import Scene
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import to_six, to_tensor
from labkit.model.compiled import Constants, Pointer, address, constants_at, entry, instead, numbers_at
from labkit.model.tensors import Six, put_six, six_at

STRESS = 1  # index of the stress in the state vector of a RateLaw
INTERNAL = 7  # index of the first internal variable in this state vector


class Functions(NamedTuple):
    """Functions of a law; `compressing` selects the branch, for laws that behave differently in dilation.

    Args:
        rates: (y, D, compressing, c, out) -> status (labkit.model.rates): writes dy/dt for the strain rate D to `out`.
        stress: (y, c) -> stress, Pa.
        stress_rate: (y, dy/dt, c) -> stress rate, Pa/s.
        settle: (y, c): called after each accepted step to change variables that jump, for example at a reversal.
    """

    rates: Function
    stress: Function
    stress_rate: Function
    settle: Function


FUNCTIONS: dict[type, Functions] = {}  # type of the constants -> functions of the law


def _of_law(name: str, place: int) -> Function:
    """Return a function that calls the function `name` of a law; its argument number `place` is the law's constants."""

    def call(*arguments: Any) -> Any:
        return getattr(FUNCTIONS[type(arguments[place])], name)(*arguments)

    return instead(lambda kind: getattr(FUNCTIONS[kind], name))(call)


law_rates, law_stress = _of_law("rates", 3), _of_law("stress", 1)
law_stress_rate, law_settle = _of_law("stress_rate", 2), _of_law("settle", 1)


def _stored_stress(y, c):
    return six_at(y, STRESS)


def _stored_stress_rate(y, v, c):
    return six_at(v, STRESS)


class ConstitutiveLaw(abc.ABC):
    """A constitutive law with the values of its constants. Its state vector begins with e and ends with the strain."""

    name: ClassVar[str]
    leading: ClassVar[tuple[str, ...]]  # names of the first variables of the state vector, for messages
    young_modulus: float = Scene().young_modulus

    @property
    @abc.abstractmethod
    def constants(self) -> Constants:
        """Constants for compiled code, an instance of the NamedTuple that is a key of FUNCTIONS."""

    @abc.abstractmethod
    def variables(self, vector: np.ndarray, stress: np.ndarray) -> dict[str, np.ndarray]:
        """Return the variables of a simulation that the law also has, name -> values.

        Args:
            vector: States, (..., n).
            stress: Stresses, (..., 3, 3), Pa.
        """

    @abc.abstractmethod
    def require_start(self, y: np.ndarray) -> None:
        """Raise InputError if the equations are undefined at the state y."""

    @abc.abstractmethod
    def floor(self, y: np.ndarray) -> np.ndarray:
        """Return the size of each variable below which its error is treated as absolute; y is the initial state."""

    @abc.abstractmethod
    def to_json(self) -> str:
        """Return the constants as JSON."""

    @functools.cached_property
    def numbers(self) -> np.ndarray:
        """Constants as an array of numbers, for compiled code."""
        return np.array(self.constants, float)

    def stress(self, y: np.ndarray) -> np.ndarray:
        """Stress at a state y, (3, 3), Pa."""
        state, stress = y.astype(float), np.empty(6)
        _stress.of(type(self.constants))(address(state), address(self.numbers), address(stress), y.size)
        return to_tensor(stress)


@entry
def _stress(y: Pointer, c: Pointer, stress: Pointer, n: int) -> int:
    put_six(numbers_at(stress, 6), 0, law_stress(numbers_at(y, n), constants_at(c)))
    return 0


class RateLaw(ConstitutiveLaw):
    """A law that defines the rates of stress and internal variables under a strain rate.

    `parameters` is name -> (default, low, high), and `internal` is name -> (1 or 6 components, typical size).
    Raises InputError for an unknown parameter or one outside its bounds.
    """

    parameters: ClassVar[dict[str, tuple[float, float, float]]]
    internal: ClassVar[dict[str, tuple[int, float]]] = {}
    leading = ("e", "sigma_xx", "sigma_yy", "sigma_zz")
    _type: ClassVar[Constants]

    @staticmethod
    @abc.abstractmethod
    def rates(y: np.ndarray, D: Six, compressing: bool, c: Constants, out: np.ndarray) -> int:
        """Write dy/dt for the strain rate D to `out`, except for the strain; return FINE, or why it is undefined."""

    @staticmethod
    def settle(y: np.ndarray, c: Constants) -> None:
        """Change variables of y that jump after a step; the default changes nothing."""

    def begin(self, y: np.ndarray) -> None:
        """Set the internal variables of a state y whose e and stress are known; the default leaves them zero."""

    def __init_subclass__(cls) -> None:
        """Register the functions of the law by the type of its constants."""
        make: Callable[..., Constants] = collections.namedtuple
        cls._type = make(f"{cls.__name__}Constants", cls.parameters, module=cls.__module__)
        FUNCTIONS[cls._type] = Functions(cls.rates, _stored_stress, _stored_stress_rate, cls.settle)

    def __init__(self, **values: float) -> None:
        """Set the named parameters; the others have their default values. Raises InputError."""
        for name, value in values.items():
            if name not in self.parameters:
                text = instead_of(self.parameters, name)
                raise InputError(f"is not a parameter of {self.name}", field=name, value=value, allowed=text)
            _, low, high = self.parameters[name]
            if not (math.isfinite(value) and low <= value <= high):
                raise InputError(field=name, value=value, allowed=f"{low:g} to {high:g}")
        self.values = {name: float(values.get(name, default)) for name, (default, _, _) in self.parameters.items()}

    @property
    def constants(self) -> Constants:
        return self._type(**self.values)

    def slices(self) -> dict[str, slice]:
        """Return the slice of each internal variable in the state vector, name -> slice."""
        slices, at = {}, INTERNAL
        for name, (components, _) in self.internal.items():
            slices[name] = slice(at, at + components)
            at += components
        return slices

    def start(self, e: float, stress: np.ndarray, **internal: float | np.ndarray) -> np.ndarray:
        """Return the state vector for a void ratio and a stress.

        Raises InputError for a state in which the law is undefined, or an internal variable that the law does not have.

        Args:
            e: Void ratio.
            stress: Stress, (3, 3), Pa.
            internal: Internal variables, numbers or (3, 3); variables that are not given follow from e and the stress.
        """
        places = self.slices()
        y = np.zeros(INTERNAL + sum(components for components, _ in self.internal.values()) + 6)
        y[0], y[STRESS:INTERNAL] = e, to_six(np.asarray(stress, dtype=float))
        self.require_start(y)
        self.begin(y)
        for name, value in internal.items():
            if name not in places:
                text = instead_of(places, name)
                raise InputError(f"is not an internal variable of {self.name}", field=name, allowed=text)
            y[places[name]] = to_six(np.asarray(value)) if np.ndim(value) == 2 else value
        return y

    def variables(self, vector: np.ndarray, stress: np.ndarray) -> dict[str, np.ndarray]:
        e, strain = vector[..., 0], to_tensor(vector[..., -6:])
        variables = {"axial_strain": vector[..., -4], "strain": strain, "stress": stress}
        return {**variables, "void_ratio": e, "void_ratio_nominal": e}

    def require_start(self, y: np.ndarray) -> None:
        p = mean_stress(to_tensor(y[STRESS:INTERNAL]))
        if not (p > 0.0 and np.isfinite(y).all()):
            raise InputError(field="pressure", value=float(p), allowed="a positive number in Pa, e.g. 0.5e6")
        if not y[0] > 0.0:
            raise InputError(field="void_ratio", value=float(y[0]), allowed="a positive number, e.g. 0.67")

    def floor(self, y: np.ndarray) -> np.ndarray:
        size = [np.full(components, 0.1 * typical) for components, typical in self.internal.values()]
        stress = 0.1 * float(mean_stress(to_tensor(y[STRESS:INTERNAL])))
        return np.concatenate([[0.1], np.full(6, stress), *size, np.full(6, 0.1)])

    def to_json(self) -> str:
        return json.dumps({"law": self.name, "parameters": self.values})
