"""Measures of agreement against values computed by hand."""

import numpy as np
import pytest

from validation.agreement import kappa, ranks, spearman


def test_kappa_is_agreement_beyond_chance() -> None:
    """20 and 15 of 50 are equal, 25 and 30 of 50 positive: 0.7 observed, 0.5 by chance (Cohen's own example)."""
    first = np.array([True] * 25 + [False] * 25)
    second = np.array([True] * 20 + [False] * 5 + [True] * 10 + [False] * 15)
    assert kappa(first, second) == pytest.approx(0.4)
    assert kappa(first, first) == 1.0
    assert kappa(first, ~first) == -1.0
    assert kappa(np.ones(3, dtype=bool), np.ones(3, dtype=bool)) == 1.0


def test_equal_values_share_their_ranks() -> None:
    np.testing.assert_array_equal(ranks([0.5, 0.1, 0.5, 0.9, 0.5]), [3, 1, 3, 5, 3])


def test_spearman_sees_order_alone() -> None:
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert spearman(x, np.exp(x)) == pytest.approx(1.0)
    assert spearman(x, -(x**3)) == pytest.approx(-1.0)
    # 1 - 6 sum d^2 / (n (n^2 - 1)) without ties: d = 1, 1, 0, 1, 1.
    assert spearman(x, [2, 1, 3, 5, 4]) == pytest.approx(0.8)
    assert np.isnan(spearman(x, np.ones(5)))
