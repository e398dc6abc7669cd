"""When merged maps are laid anew."""

import pytest

from agent.mapping.laying import Laying


@pytest.mark.parametrize(("rate_hz", "maps", "ticks"), [(5.0, 2, 3), (5.0, 12, 13), (2.0, 12, 5), (0.5, 12, 1)])
def test_many_maps_wait_as_long_with_a_slow_lidar(rate_hz: float, maps: int, ticks: int) -> None:
    """0.6 s, and 0.2 s more for each map beyond two, where own walls are new in each tick."""
    laying = Laying(rate_hz)
    due = [laying.take_due(tick, maps, own_changed=True, merged_changed=False, rests=False) for tick in range(60)]
    times = [tick for tick, is_due in enumerate(due) if is_due]
    assert times[1] - times[0] == ticks
