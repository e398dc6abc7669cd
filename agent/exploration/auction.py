"""Who of a team does which task: an auction that each robot holds for itself, on what it knows (ours).

Tasks are given away one by one, to whoever's tour with it is shortest then: the sequential single-item auction with the
MiniMax rule (Lagoudakis et al., RSS 2005). So of two robots side by side one leaves for what the other would do last,
where a rule of the nearest has both drive to the same end. A teammate that is nearer to no task does not bid, as of a
crowd most are far off. Nor does one that was not heard for a while, as it knows nothing of new tasks: it has what it is
nearer to.
"""

import math

import numpy as np

from agent.exploration.agenda import FAR_M, TOUR_TASKS, Task
from agent.exploration.planning import Roads
from agent.kernels import kernel
from protocol.arrays import Floats, Ints


@kernel
def auction(starts: Floats, between: Floats) -> Ints:
    """Who of m robots does each of n tasks (n,).

    starts: (m, n) costs of ways to the tasks; between: (n, n) costs of ways from task to task; metres, finite. A robot
    bids the length of its tour with the task, put in where it lengthens the tour least; the lowest bid of all robots
    and tasks wins. Of equal bids the first robot's counts, and of its bids that for the first task.
    """
    m, n = starts.shape
    owner = np.full(n, -1)
    tours, counts = np.zeros((m, n), np.int64), np.zeros(m, np.int64)
    bids, places = starts.copy(), np.zeros((m, n), np.int64)
    for _ in range(n):
        best, who, task = math.inf, -1, -1
        for r in range(m):
            for t in range(n):
                if owner[t] < 0 and bids[r, t] < best:
                    best, who, task = bids[r, t], r, t
        owner[task] = who
        tour, count = tours[who], counts[who]
        for k in range(count, places[who, task], -1):
            tour[k] = tour[k - 1]
        tour[places[who, task]] = task
        counts[who] = count = count + 1
        for t in range(n):
            bids[who, t] = math.inf
            for k in range(count + 1):
                before = starts[who] if k == 0 else between[tour[k - 1]]
                longer = best + before[t]
                if k < count:
                    longer += between[t, tour[k]] - before[tour[k]]
                if longer < bids[who, t]:
                    bids[who, t], places[who, t] = longer, k
    return owner


def own_share(tasks: list[Task], roads: Roads, partners: Floats, silent: Floats) -> list[Task]:
    """Tasks that the robot does itself, the nearest ones; none where its teammates do them all.

    partners (k, 3), silent (j, 3): places of teammates that share the work, heard lately or not, and metres by which
    each must be nearer to a task.
    """
    if not tasks or not len(partners) + len(silent):
        return tasks
    stands = np.array([task.stand for task in tasks])
    mine = roads.costs(stands)
    partners, silent = (some[_may_be_nearer(some, stands, mine)] for some in (partners, silent))
    if len(silent):
        theirs = roads.costs_from(silent[:, :2], stands) + silent[:, 2:]
        left = np.flatnonzero((mine <= theirs).all(0))
        tasks, stands, mine = [tasks[k] for k in left], stands[left], mine[left]
    if not tasks or not len(partners):
        return tasks
    near = np.lexsort((mine, np.array([not task.begun for task in tasks])))[:TOUR_TASKS]
    theirs = roads.costs_from(partners[:, :2], stands[near]) + partners[:, 2:]
    extra = np.array([tasks[k].extra_m for k in near])
    starts = np.minimum(np.vstack((mine[near], theirs)) + extra, FAR_M)
    owner = auction(starts, np.minimum(roads.costs_from(stands[near], stands[near]), FAR_M))
    return [tasks[k] for k in np.sort(near[owner == 0])]


def _may_be_nearer(teammates: Floats, stands: Floats, mine: Floats) -> Ints:
    """Rows of teammates (k, 3) that may be nearer to one of stands (n, 2) at all: of a crowd most are far off."""
    straight = np.hypot(*(teammates[:, None, :2] - stands).transpose(2, 0, 1))
    return np.flatnonzero((mine > straight + teammates[:, 2:]).any(1))
