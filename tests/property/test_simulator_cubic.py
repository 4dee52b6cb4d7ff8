"""The emulated position against the analytic cubic, in exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given, settings
from hypothesis import strategies as st
from ibfctl_simulator.galil.pvt import PvtBuffer, PvtProfile, Segment

SEGMENTS = st.lists(
    st.builds(
        Segment,
        st.integers(-100_000, 100_000),
        st.integers(-2_000_000, 2_000_000),
        st.integers(1, 200),
    ),
    min_size=1,
    max_size=12,
)


def exact_positions(segments: list[Segment], start: int) -> list[Fraction]:
    """Hermite form of each cubic, at each sample of 1/1024 s."""
    positions, base, v0 = [], Fraction(start), Fraction(0)
    for p, v, samples in segments:
        duration = Fraction(samples, 1024)
        for k in range(1, samples + 1):
            u = Fraction(k, samples)
            hermite = (u**3 - 2 * u**2 + u) * duration * v0 + (u**3 - u**2) * duration * v
            positions.append(base + (3 * u**2 - 2 * u**3) * p + hermite)
        base, v0 = base + p, Fraction(v)
    return positions


@given(
    segments=SEGMENTS, start=st.integers(-1_000_000, 1_000_000), cuts=st.lists(st.integers(1, 500), max_size=20)
)
@settings(deadline=None)
def test_every_sample_is_within_half_a_count_of_the_analytic_cubic(segments, start, cuts):
    buffer = PvtBuffer(255)
    buffer.waiting.extend([*segments, Segment(0, 0, 0)])
    profile = PvtProfile(buffer, float(start), 1 / 1024)
    seen: list[float] = []
    remaining = iter(cuts)
    while profile.end_code is None:
        positions = profile.look(next(remaining, 1000))
        seen.extend(positions)
        profile.take(len(positions))
        assert profile.position_counts == positions[-1]
    exact = exact_positions(segments, start)
    assert len(seen) == len(exact)
    # Half a count for the rounding to integers, and for the doubles nothing that a count could notice.
    most = Fraction(1, 2) + Fraction(1, 10**6)
    assert all(abs(round(got) - want) <= most for got, want in zip(seen, exact, strict=True))
    assert profile.end_code == 31
    assert buffer.executed == len(segments) + 1
    assert profile.position_counts == start + sum(segment.move_counts for segment in segments)
