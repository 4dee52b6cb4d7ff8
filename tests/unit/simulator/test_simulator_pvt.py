"""PVT: the manual's vectors, the buffer's bookkeeping, and every way out of the mode."""

from __future__ import annotations

import numpy as np
import pytest

MANUAL_MOVES = (57, 151, 214, 245, 245, 214, 151, 57)
MANUAL_VELOCITIES = (437, 750, 937, 1000, 937, 750, 437, 0)
SECOND_VECTOR = {
    "A": ((1000, 4000, 1200), (1000, 4000, 750), (800, 10000, 250), (4000, 0, 1000), (0, 0, 0)),
    "B": (
        *((500, 5000, 500), (4500, 0, 1200), (-1000, 1000, 750)),
        *((200, 1000, 250), (-900, 0, 1000), (0, 0, 0)),
    ),
}


def queue(console, letter, segments):
    for p, v, t in segments:
        console.good(f"PV{letter}={p},{v},{t}")


def walk(console, samples):
    """Positions of axis A after each sample."""
    positions = []
    for _ in range(samples):
        console.controller.advance(1)
        positions.append(console.state.axes[0].encoder_counts)
    return positions


def test_the_manuals_parabola_ends_at_1334_counts_after_exactly_2_s(console):
    queue(console, "A", [(p, v, 256) for p, v in zip(MANUAL_MOVES, MANUAL_VELOCITIES, strict=True)])
    console.good("PVA=0,0,0", "BT A")
    console.controller.advance(2047)
    assert console.number("_BGA") == 1
    console.controller.advance(1)
    assert (console("TPA"), console("SCA"), console.number("_BGA")) == ("1334\r\n:", "31\r\n:", 0)
    assert console.number("_BTA") == 9
    assert console.state.sample == 2048


def test_the_manuals_parabola_is_the_parabola_at_every_sample(console):
    queue(console, "A", [(p, v, 256) for p, v in zip(MANUAL_MOVES, MANUAL_VELOCITIES, strict=True)])
    console.good("PVA=0,0,0", "BT A")
    time_s = np.arange(1, 2049) / 1024
    parabola = 1000 * time_s**2 - 1000 / 3 * time_s**3
    # The vector's rounded moves add up to 1126 where the parabola passes 1125; the encoder adds half a count.
    assert np.abs(np.array(walk(console, 2048)) - parabola).max() < 1.5


def test_the_second_vector_moves_each_axis_on_times_of_its_own(console):
    for letter, segments in SECOND_VECTOR.items():
        queue(console, letter, segments)
    console.good("BT AB")
    seen = {}
    for sample in range(1, 3701):
        console.controller.advance(1)
        seen[sample] = [axis.encoder_counts for axis in console.state.axes]
    assert [seen[sample][0] for sample in (1200, 1950, 2200, 3200, 3700)] == [1000, 2000, 2800, 6800, 6800]
    assert [seen[sample][1] for sample in (500, 1700, 2450, 2700, 3700)] == [500, 5000, 4000, 4200, 3300]
    assert console("SC") == "31, 31\r\n:"
    assert (console.number("_BTA"), console.number("_BTB")) == (5, 6)


def test_segments_may_be_added_after_begin(console):
    queue(console, "A", [(100, 500, 256)])
    console.good("BTA")
    console.controller.advance(200)
    queue(console, "A", [(100, 0, 256), (0, 0, 0)])
    console.controller.advance(312)
    assert (console("TPA"), console("SCA")) == ("200\r\n:", "31\r\n:")


def test_the_active_segment_is_not_counted_as_waiting(console):
    queue(console, "A", [(10, 0, 4)] * 3)
    assert console.number("_PVA") == 252
    console.good("BTA")
    console.controller.advance(1)
    assert (console.number("_PVA"), console.number("_BTA")) == (253, 0)
    console.controller.advance(4)
    assert (console.number("_PVA"), console.number("_BTA")) == (254, 1)


def test_the_result_does_not_depend_on_how_time_is_cut(make_console):
    steps = [1, 2, 3, 5, 8, 13, 400, 1000]
    tracks = []
    for cut in ([1] * sum(steps), steps):
        console = make_console()
        console.good("SH")
        queue(console, "A", SECOND_VECTOR["A"])
        console.good("BTA")
        track, sample = {}, 0
        for samples in cut:
            console.controller.advance(samples)
            sample += samples
            axis = console.state.axes[0]
            track[sample] = (axis.commanded_counts, axis.velocity_counts_s, axis.buffer.executed)
        tracks.append(track)
    assert {sample: tracks[0][sample] for sample in tracks[1]} == tracks[1]


def test_an_empty_buffer_stops_with_code_32_and_no_error(console):
    queue(console, "A", [(100, 1000, 128)])
    console.good("DCA=10240", "BTA")
    console.controller.advance(128)
    assert (console("SCA"), console.number("_BGA")) == ("30\r\n:", 1)
    console.controller.advance(1)
    assert (console("SCA"), console.number("_BGA")) == ("32\r\n:", 1)
    console.controller.advance(100)
    assert (console("SCA"), console.number("_BGA"), console("TC")) == ("32\r\n:", 0, "0\r\n:")
    # From 1000 counts/s with 10240 counts/s^2 it takes 48.8 counts to stop.
    assert console("TPA") == "149\r\n:"


def test_an_empty_buffer_at_rest_also_gives_32(console):
    queue(console, "A", [(100, 0, 128)])
    console.good("BTA")
    console.controller.advance(129)
    assert (console("SCA"), console("TPA"), console.number("_BGA")) == ("32\r\n:", "100\r\n:", 0)


def test_an_underrun_can_be_set_to_stop_at_once(make_console):
    console = make_console(underrun_deceleration="instant")
    console.good("SH")
    queue(console, "A", [(100, 1000, 128)])
    console.good("BTA")
    console.controller.advance(129)
    assert (console("SCA"), console("TPA"), console.number("_BGA")) == ("32\r\n:", "100\r\n:", 0)


def test_new_segments_after_an_underrun_wait_for_a_new_begin(console):
    queue(console, "A", [(100, 0, 128)])
    console.good("BTA")
    console.controller.advance(200)
    queue(console, "A", [(50, 0, 128), (0, 0, 0)])
    console.controller.advance(200)
    assert console("TPA") == "100\r\n:"
    console.good("BTA")
    console.controller.advance(128)
    assert (console("TPA"), console("SCA"), console.number("_BTA")) == ("150\r\n:", "31\r\n:", 2)


def test_the_end_marker_discards_what_is_behind_it(console):
    queue(console, "A", [(10, 0, 8), (0, 0, 0), (500, 0, 8)])
    console.good("BTA")
    console.controller.advance(100)
    assert (console("TPA"), console.number("_PVA"), console.number("_BTA")) == ("10\r\n:", 255, 2)


def test_the_end_marker_at_speed_stops_at_once(console):
    queue(console, "A", [(100, 1000, 128), (0, 0, 0)])
    console.good("BTA")
    console.controller.advance(200)
    assert (console("TPA"), console("SCA")) == ("100\r\n:", "31\r\n:")


def test_a_dwell_holds(console):
    queue(console, "A", [(100, 0, 128), (0, 0, 512), (0, 0, 0)])
    console.good("BTA")
    assert set(walk(console, 640)[128:]) == {100}
    assert console("SCA") == "31\r\n:"


def test_the_clear_form_empties_the_buffer(console):
    queue(console, "A", [(100, 0, 128)] * 5)
    console.good("PVA=0,0,-1")
    assert console.number("_PVA") == 255
    assert console.code("BTA") == 24


def test_the_buffer_takes_255_segments_and_rejects_the_next(console):
    queue(console, "A", [(1, 0, 2)] * 255)
    assert console.number("_PVA") == 0
    assert console.code("PVA=1,0,2") == 32
    assert console.number("_PVB") == 255


def test_a_full_buffer_can_be_set_to_drop_silently(make_console):
    console = make_console(pvt_full_error=0)
    queue(console, "A", [(1, 0, 2)] * 256)
    assert console.number("_PVA") == 0


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("PVA=44000001,0,2", 6),
        ("PVA=0,-22000001,2", 6),
        ("PVA=0,0,2049", 6),
        ("PVA=1,0,0", 6),
        ("PVA=1,0,-1", 6),
        ("PVA=1,2", 50),
        ("PVA=1,,3", 50),
        ("PVA=1,2,3,4", 4),
        ("PVC=1,2,3", 4),
        ("PV 1,2,3", 4),
        ("PVA=a,2,3", 9),
    ],
)
def test_bad_segments_are_rejected_and_not_queued(console, command, code):
    assert console.code(command) == code
    assert console.number("_PVA") == 255


def test_the_largest_values_are_taken(console):
    console.good("PVA=44000000,22000000,2048", "PVA=-44000000,-22000000,1")


def test_strict_times_are_a_setting(make_console):
    console = make_console(pvt_minimum_samples=2, pvt_even_samples=True)
    console.good("PVA=1,0,2", "PVA=0,0,0")
    assert [console.code(f"PVA=1,0,{time}") for time in (1, 3)] == [6, 6]


def test_begin_needs_the_motor_on_segments_and_standstill(console):
    assert console.code("BTA") == 24
    queue(console, "A", [(100, 0, 128)])
    console.good("MOA")
    queue(console, "A", [(100, 0, 128)])
    assert console.code("BTA") == 20
    console.good("SHA", "BTA")
    assert console.code("BTA") == 21


def test_begin_starts_all_listed_axes_or_none(console):
    queue(console, "A", [(100, 0, 128)])
    assert console.code("BT AB") == 24
    assert console.number("_BGA") == 0


def test_bare_begin_starts_the_axes_that_have_segments(console):
    assert console.code("BT") == 24
    queue(console, "B", [(100, 0, 128)])
    console.good("BT")
    assert (console.number("_BGA"), console.number("_BGB")) == (0, 1)


def test_stop_leaves_pvt_decelerates_with_dc_and_keeps_nothing(console):
    queue(console, "A", [(125, 1000, 256), (1000, 1000, 1024)])
    console.good("DCA=10240", "BTA")
    console.controller.advance(512)
    console.good("STA")
    assert (console("SCA"), console.number("_PVA"), console.number("_BGA")) == ("4\r\n:", 255, 1)
    console.controller.advance(100)
    # 125 counts, then 0.25 s at 1000 counts/s, then 1000^2/(2 * 10240) counts to stop.
    assert (console("TPA"), console.number("_BGA"), console("SCA")) == ("424\r\n:", 0, "4\r\n:")


def test_abort_stops_at_once_with_code_7(console):
    queue(console, "A", [(125, 1000, 256), (1000, 1000, 1024)])
    console.good("BTA")
    console.controller.advance(512)
    console.good("AB1")
    assert (console("TPA"), console("SCA"), console.number("_BGA")) == ("375\r\n:", "7\r\n:", 0)


def test_motor_off_empties_the_buffer(console):
    queue(console, "A", [(100, 0, 128)] * 3)
    console.good("BTA")
    console.controller.advance(10)
    console.good("MOA")
    assert (console.number("_PVA"), console.number("_MOA"), console.number("_BGA")) == (255, 1, 0)
    console.controller.advance(100)
    assert console.number("_BGA") == 0


def test_positions_go_on_counting_over_a_profile(console):
    console.good("DPA=1000")
    queue(console, "A", [(100, 0, 128), (0, 0, 0)])
    console.good("BTA")
    console.controller.advance(128)
    assert (console("TPA"), console("RPA"), console("TEA")) == ("1100\r\n:", "1100\r\n:", "0\r\n:")
