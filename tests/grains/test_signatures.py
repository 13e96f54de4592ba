"""A part of a law with an incomplete signature is answered with the right one, when it is defined."""

import numpy as np
import pytest

import labkit as lk


def test_a_tangent_without_its_default_is_refused():
    with pytest.raises(lk.InputError, match=r"write tangent\(stiffness, overlap, mass=1.0\)$"):

        class Spring(lk.laws.LinearSpring):
            @staticmethod
            def tangent(stiffness, overlap, mass):
                return mass * stiffness


def test_a_function_that_lacks_an_argument_is_refused():
    with pytest.raises(lk.InputError, match=r"Spring.force\(overlap\) .* write force\(stiffness, overlap\)$"):

        class Spring(lk.laws.HertzSpring):
            @staticmethod
            def force(overlap):
                return overlap


def test_a_method_with_self_is_told_to_be_static():
    with pytest.raises(lk.InputError, match=r"write force\(stiffness, overlap\), a @staticmethod without self$"):

        class Spring(lk.laws.LinearSpring):
            def force(self, stiffness, overlap):
                return stiffness * overlap


def test_other_names_and_further_defaults_are_accepted():
    class Spring(lk.laws.LinearSpring):
        @staticmethod
        def tangent(k, depth, m=1.0, extra=0.0):
            return m * k + 0.0 * depth + extra

    assert np.isclose(Spring.tangent(2.0, 1e-6), 2.0)


@pytest.mark.parametrize("parts", [lk.laws.LinearSpring, (lk.laws.LinearSpring(),), 5])
def test_a_law_whose_parts_are_no_parts_is_refused(parts):
    with pytest.raises(lk.InputError, match="is no part of a contact law"):
        type("Own", (lk.ContactLaw,), {"name": "no_parts", "parts": parts})
