"""KPIs that a declaration has computed from the rows of a case."""

import math

import numpy as np
import pytest

from schemas.kinds.kpi import KpiKind
from twin.kpi.computed import computed_column, computed_scalars


class Rows:
    rows = 3

    def column(self, name):
        assert name == "x_m"
        return np.array([1.0, 2.0, 4.0])

    def valid(self, _name):
        return np.ones(3, np.bool_)


def steps(rows):
    return np.append(np.nan, np.diff(rows.column("x_m")))


def too_few(rows):
    return np.diff(rows.column("x_m"))


def largest(rows):
    return rows.column("x_m").max()


def endless(_rows):
    return math.inf


def nothing(_rows):
    return None


def kind(function, place="column"):
    reference = f"{__name__}:{function.__name__}" if function else ""
    return KpiKind(name="k", place=place, type="float64", nullable=True, implementation=reference)


def test_a_column_has_a_value_per_row():
    np.testing.assert_array_equal(computed_column(kind(steps), Rows()), [np.nan, 1.0, 2.0])


def test_a_column_of_another_length_is_refused_in_one_line():
    with pytest.raises(ValueError, match=r"'k': .*too_few gives values of shape \(2,\), allowed"):
        computed_column(kind(too_few), Rows())


@pytest.mark.parametrize(("function", "value"), [(largest, 4.0), (endless, None), (nothing, None)])
def test_a_scalar_that_is_no_number_is_missing(function, value):
    assert computed_scalars([kind(function, "scalar")], Rows()) == {"k": value}


def test_what_a_family_gives_is_not_computed():
    assert computed_scalars([kind(None, "scalar")], Rows()) == {}
