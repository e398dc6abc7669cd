"""What a step costs and how fast whole runs are: no worse than after the filter, by the filter's own measures."""

from deploy.bench.cases import Case
from deploy.bench.filter.cost import speed_cases, speed_table, stages_table


def cases(quick: bool) -> list[Case]:
    """Alone each: their figures are times."""
    return speed_cases("speed/stages", "speed/run", quick)


TABLES = [stages_table("speed/stages"), speed_table("speed/run")]
