import numpy as np
import pytest

from vision.geometry.small_systems import factorise, invert, solve


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_solutions_and_inverses_are_those_of_lapack(n):
    rng = np.random.default_rng(n)
    factor, right = rng.normal(size=(2 * n, n)), rng.normal(size=n)
    matrix = factor.T @ factor
    lower, solution = np.tril(matrix), right.copy()
    assert factorise(lower)
    solve(lower, solution)
    assert np.allclose(solution, np.linalg.solve(matrix, right))
    assert np.allclose(invert(lower), np.linalg.inv(matrix))


def test_what_is_not_positive_definite_has_no_factors():
    assert not factorise(np.diag([1.0, -1.0]))
    assert not factorise(np.ones((3, 3)))
    assert not factorise(np.full((2, 2), np.nan))


def test_unknowns_that_the_equations_leave_open_stay_zero():
    normal, right = np.zeros((3, 3)), np.array([2.0, 5.0, 3.0])
    normal[0, 0], normal[2, 0], normal[2, 2] = 2.0, 1.0, 2.0
    assert not factorise(normal)
    solve(normal, right)
    assert np.allclose(right, [1 / 3, 0, 4 / 3])
