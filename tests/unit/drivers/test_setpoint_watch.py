from drivers.setpoint_watch import SetPointWatch


def test_nothing_is_expected_before_the_first_set_point():
    assert SetPointWatch(exact=True).check(3.0, 1) is None


def test_in_lock_step_the_next_sample_must_show_it():
    watch = SetPointWatch(exact=True)
    watch.written(2.5, 0.0, 7)
    assert watch.check(2.5, 8) is None
    assert watch.check(2.5000002, 9) == 2.5
    assert watch.check(float("nan"), 9) == 2.5


def test_on_the_wall_clock_the_old_one_stands_until_a_whole_device_tick_has_passed():
    watch = SetPointWatch(exact=False)
    watch.written(1.0, 0.0, 10)
    assert watch.check(0.0, 10) is None
    assert watch.check(0.0, 11) is None
    assert watch.check(0.0, 12) == 1.0
    assert watch.check(1.0, 12) is None


def test_a_device_may_lag_behind_set_points_that_change_each_tick_but_not_for_ever():
    watch = SetPointWatch(exact=False)
    for k in range(10):
        watch.written(float(k), 0.0, k)
        assert watch.check(float(k - 1) if k else 5.0, k + 1) is None
    assert watch.check(3.0, 11) == 9.0


def test_a_set_point_that_was_lost_later_is_seen():
    watch = SetPointWatch(exact=False)
    watch.written(4.0, 0.0, 1)
    assert watch.check(4.0, 3) is None
    assert watch.check(0.0, 400) == 4.0


def test_rounding_between_two_registers_is_allowed_for():
    watch = SetPointWatch(exact=True)
    watch.written(4.0, 0.01, 1)
    assert watch.check(3.995, 2) is None
    assert watch.check(3.98, 2) == 4.0


def test_the_sequence_may_wrap():
    watch = SetPointWatch(exact=False)
    watch.written(4.0, 0.0, 2**32 - 1)
    assert watch.check(0.0, 0) is None
    assert watch.check(0.0, 1) == 4.0
