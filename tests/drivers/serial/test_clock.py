"""Device clock → host clock: offset and drift from exchanges with honest and with late answers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armd.drivers.serial.clock import ENOUGH, ClockMapping, can_promise

BOOT_NS = 5_000_000_000_000  # host instant of the device's zero


def exchange(clock, host_ns, out_ns, back_ns, drift=0.0):
    """A PING that takes *out_ns* to the arm and its PONG *back_ns* back, sent at *host_ns*."""
    stamped_ns = host_ns + out_ns
    device_ns = round((stamped_ns - BOOT_NS) / (1 + drift))
    clock.add(host_ns, stamped_ns + back_ns, device_ns // 1000 * 1000)


def error_ns(clock, host_ns, drift=0.0):
    return clock.to_host(round((host_ns - BOOT_NS) / (1 + drift))) - host_ns


def run(clock, seconds, delays, drift=0.0, start_ns=BOOT_NS + 3_000_000_000):
    now = start_ns
    while now < start_ns + seconds * 1e9:
        exchange(clock, now, *delays(), drift)
        now += clock.ping_interval_ns
    return now


def test_it_is_mapped_within_half_a_second_of_good_exchanges():
    clock = ClockMapping()
    assert not clock.mapped
    run(clock, ENOUGH * 0.05 + 0.01, lambda: (30_000, 30_000))
    assert clock.mapped


@pytest.mark.parametrize("drift", [0.0, 100e-6, -200e-6])
@pytest.mark.parametrize("seconds", [0.5, 3, 20])
def test_error_with_a_drifting_crystal_and_a_busy_host(drift, seconds):
    rng = np.random.default_rng(3)

    def delays():
        out, back = rng.exponential(60_000, 2) + 20_000
        if rng.random() < 0.2:  # now and then somebody else has the processor
            back += rng.uniform(0, 10_000_000)
        return round(out), round(back)

    clock = ClockMapping()
    now = run(clock, seconds, delays, drift)
    errors = [abs(error_ns(clock, now + ahead, drift)) for ahead in range(0, 500_000_000, 10**7)]
    assert np.median(errors) < 200_000 and max(errors) < 500_000


def test_an_adapter_that_waits_sixteen_milliseconds():
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)

        def delays(rng=rng):
            return 100_000, round(rng.uniform(0.2e6, 16e6))

        clock = ClockMapping()
        errors.append(abs(error_ns(clock, run(clock, 3, delays))))
    assert np.median(errors) < 500_000  # a plain mean of the middles is 4 ms off
    assert max(errors) < 5_000_000


@given(st.integers(0, 2**62), st.integers(0, 2**53 * 1000))
def test_any_exchange_is_survived(host_ns, device_ns):
    clock = ClockMapping()
    for i in range(ENOUGH):
        clock.add(host_ns + i, host_ns + i + 5, device_ns)
    for instant_ns in (0, device_ns):
        clock.to_host(instant_ns)


def test_an_answer_before_its_question_is_ignored():
    clock = ClockMapping()
    for _ in range(ENOUGH):
        clock.add(1000, 900, 0)
    assert not clock.mapped


def test_a_reset_forgets_the_mapping():
    clock = ClockMapping()
    run(clock, 2, lambda: (30_000, 30_000))
    clock.reset()
    assert not clock.mapped and clock.line["drift"][0] == 0.0


def test_a_clock_that_jumps_is_flagged_with_the_next_answer_and_mapped_anew():
    clock = ClockMapping()
    now = run(clock, 5, lambda: (30_000, 30_000))
    jump_ns = 3_600_000_000_000
    for answer in range(ENOUGH):
        assert clock.mapped is (answer == 0)
        stamped_ns = now + 30_000 - BOOT_NS + jump_ns
        assert clock.add(now, now + 60_000, stamped_ns) is (answer > 0)
        now += clock.ping_interval_ns
    assert clock.mapped
    assert abs(clock.to_host(now - BOOT_NS + jump_ns) - now) < 100_000


def test_a_false_answer_among_true_ones_is_flagged():
    clock = ClockMapping()
    now = run(clock, 5, lambda: (30_000, 30_000))
    assert not clock.add(now, now + 60_000, now - BOOT_NS + 20_000_000)
    assert not clock.mapped
    run(clock, 1, lambda: (30_000, 30_000), start_ns=now + 50_000_000)
    assert clock.mapped


@pytest.mark.parametrize("drift", [0.01, -0.01, 2e-3])
def test_what_drifts_like_no_crystal_is_never_mapped_for_long(drift):
    clock, now = ClockMapping(), BOOT_NS + 3_000_000_000
    worst = 0.0
    for _ in range(200):
        exchange(clock, now, 30_000, 30_000, drift)
        if clock.mapped:
            worst = max(worst, abs(error_ns(clock, now + clock.ping_interval_ns, drift)))
        now += clock.ping_interval_ns
    assert worst < 5_000_000


def test_answers_that_take_too_long_map_nothing():
    clock = ClockMapping()
    run(clock, 5, lambda: (6_000_000, 6_000_000))
    assert not clock.mapped


def test_a_sample_from_the_future_or_long_after_the_last_answer_is_not_promised():
    clock = ClockMapping()
    now = run(clock, 5, lambda: (30_000, 30_000))
    device_ns = now - BOOT_NS
    assert can_promise(device_ns, clock.to_host(device_ns), now + 1_000_000, clock.line)
    assert not can_promise(device_ns, clock.to_host(device_ns), now - 6_000_000, clock.line)
    later = device_ns + 31_000_000_000
    assert not can_promise(later, clock.to_host(later), now + 32_000_000_000, clock.line)
