"""Who of a team does which task: an auction that each robot holds for itself, on what it knows (ours).

Tasks are given away one by one, to whoever's tour with it is shortest then: the sequential single-item auction with the
MiniMax rule (Lagoudakis et al., RSS 2005). So of two robots side by side one leaves for what the other would do last,
where a rule of the nearest has both drive to the same end. A teammate that even in a straight line is nearer to no task
does not bid, as of a crowd most are far off. Nor does one that was not heard for a while, as it knows nothing of new
tasks: it has what it is nearer to.
"""

import math

import numpy as np

from agent.exploration.agenda import Agenda, with_extra
from agent.exploration.planning import Roads
from agent.kernels import kernel
from protocol.arrays import Floats, Ints


@kernel
def auction(starts: Floats, between: Floats) -> Ints:
    """Who of m robots does each of n tasks (n,).

    starts: (m, n) costs of paths to the tasks; between: (n, n) of paths from task to task; metres, finite. A robot bids
    the length of its tour with the task, put in where it lengthens the tour least; the lowest bid of all robots and
    tasks wins. Of equal bids the first robot's counts, and of its bids that for the first task.
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


def own_share(agenda: Agenda, roads: Roads, partners: Floats, silent: Floats) -> Agenda:
    """Tasks that the robot does itself; none where its teammates do them all.

    partners (k, 3), silent (j, 3): places of teammates that share the work, heard lately or not, and metres by which
    each must be nearer to a task.
    """
    silent, partners = (_that_may_be_nearer(some, agenda) for some in (silent, partners))
    if len(silent):
        theirs = roads.of_teammates.costs_from(silent[:, :2], agenda.stands) + silent[:, 2:]
        agenda = agenda.of(np.flatnonzero((agenda.costs <= theirs).all(0)))
    if not agenda.tasks or not len(partners):
        return agenda
    theirs = roads.of_teammates.costs_from(partners[:, :2], agenda.stands) + partners[:, 2:]
    owner = auction(with_extra(np.vstack((agenda.costs, theirs)), agenda.tasks), agenda.between)
    return agenda.of(np.flatnonzero(owner == 0))


def _that_may_be_nearer(teammates: Floats, agenda: Agenda) -> Floats:
    """Those of teammates (k, 3) that may be nearer to one of the tasks at all: of a crowd most are far off."""
    if not len(teammates):
        return teammates
    straight = np.hypot(*(teammates[:, None, :2] - agenda.stands).transpose(2, 0, 1))
    return np.asarray(teammates[(agenda.costs > straight + teammates[:, 2:]).any(1)])
