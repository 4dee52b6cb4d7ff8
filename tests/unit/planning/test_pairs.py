"""Integers that bring a sum of squares down."""

from __future__ import annotations

import itertools

import numpy as np

from ibfctl.planning.pairs import descended


def worth(columns: np.ndarray, wanted: np.ndarray, q: np.ndarray) -> float:
    return float(np.sum((wanted - columns @ q) ** 2))


def test_no_single_change_and_no_exchange_would_be_better() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        columns, wanted = random.normal(size=(9, 6)), 3 * random.normal(size=9)
        least, most = np.full(6, -2.0), np.full(6, np.inf)
        q = descended(columns.T @ columns, columns.T @ wanted, least, most)
        assert np.all(q >= least)
        reached = worth(columns, wanted, q)
        assert reached <= worth(columns, wanted, np.zeros(6))
        for i, j in itertools.product(range(6), repeat=2):
            for change in (np.eye(6)[i], -np.eye(6)[i], np.eye(6)[i] - np.eye(6)[j]):
                if np.all(q + change >= least):
                    assert worth(columns, wanted, q + change) >= reached - 1e-9


def test_what_whole_numbers_can_reach_is_reached() -> None:
    columns = np.array([[1.0, 0.0], [0.0, 1.0], [0.2, 0.2]])
    q = descended(columns.T @ columns, columns.T @ (columns @ [4, -3]), np.full(2, -9.0), np.full(2, 9.0))
    assert q.tolist() == [4, -3]


def test_one_segment_alone_is_no_trouble() -> None:
    assert descended(np.eye(1), np.array([2.2]), np.array([-np.inf]), np.array([1.0])).tolist() == [1]
