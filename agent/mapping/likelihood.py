"""Log-likelihood of a corner scan given a wireframe and a pose (paper III-B; equations ours).

Predicted against measured corners and walls, labels, missing and extra features, and free space seen through a
wall. It reads a particle and changes nothing, so it also judges maps that are not the robot's own. Each weight below
is the log-odds, in nats, of what a scan shows if the particle is right against if it is wrong.
"""

from agent.corner_scan import NOMINAL, OCCLUSION, TELLING_HITS
from agent.geometry.lines import Record, along
from agent.kernels import kernel
from agent.mapping.association import Gates, cost
from agent.mapping.edges import WALL, tip_at
from agent.mapping.views import END_SKIP_M, ON, STEP_M, THROUGH, View, in_reach, look_at_wall, samples_along
from protocol.arrays import Ints, Records

MATCH_ODDS = 2.0  # a piece on its wall: it is e^2 times as likely as a chance hit. Half its chi-square is taken off
EXTRA_ODDS = 1.0  # a piece that no wall predicts. Weak, as new ground brings many, for all particles alike
MISSING_ODDS = 2.0  # a wall in view that was not hit
THROUGH_ODDS = 4.0  # a wall that was seen through: the strongest, as a scan seldom shows free space where there is none
CORNER_ODDS = 1.0  # a corner between two walls as predicted, or against the prediction
LABEL_ODDS = 1.0  # an end of a wall against the prediction


@kernel
def log_likelihood(edges: Records, count: int, view: View, walls: Ints, gates: Gates) -> float:
    """Log-likelihood, up to a constant, of a scan whose pieces are associated with `walls` (k,), or with -1."""
    total = 0.0
    for k in range(len(walls)):
        if walls[k] < 0:
            total -= EXTRA_ODDS
            continue
        chi2 = cost(edges[walls[k]], view.pieces[k], gates)
        total += MATCH_ODDS - 0.5 * min(chi2, 2 * MATCH_ODDS + 2 * EXTRA_ODDS)
        total += _corner_odds(edges, view.pieces, walls, k)
        total -= LABEL_ODDS * _wrong_ends(edges[walls[k]], view.pieces[k], view.margin + END_SKIP_M)
    for e in range(count):
        if edges[e].kind == WALL and in_reach(edges[e], view):
            total -= _odds_against(e, edges[e], view, walls)
    return total


@kernel
def _corner_odds(edges: Records, pieces: Records, walls: Ints, k: int) -> float:
    """What the corner at the head of piece k says for or against the corner of its wall."""
    if pieces[k].label[1] != NOMINAL or walls[pieces[k].link[1]] < 0:
        return 0.0
    e, f = walls[k], walls[pieces[k].link[1]]
    if edges[e].link[1] == f:
        return CORNER_ODDS
    return -CORNER_ODDS if edges[e].link[1] >= 0 or edges[f].link[0] >= 0 else 0.0


@kernel
def _wrong_ends(wall: Record, piece: Record, margin: float) -> int:
    """How many ends of a piece go on behind a corner of the wall, or end before the wall does."""
    wrong, t, tells = 0, along(wall, piece.x, piece.y), piece.hits >= TELLING_HITS
    for side in range(2):
        outward = 1.0 if side == 1 else -1.0
        beyond = outward * (t + piece.end[side] - tip_at(wall, side))
        wrong += wall.label[side] == NOMINAL and beyond > margin
        wrong += tells and piece.label[side] == OCCLUSION and beyond + piece.slack[side] < -margin
    return wrong


@kernel
def _odds_against(e: int, wall: Record, view: View, walls: Ints) -> float:
    """What the samples of a wall say against it: seen through, or another wall in its place."""
    samples = samples_along(wall, 3 * STEP_M)
    through, missing, on = 0, 0, 0
    for j in range(samples.number):
        saw, piece, faces = look_at_wall(wall, samples.first + j * samples.spacing, view)
        through += saw == THROUGH
        if saw == ON and faces:
            on += walls[piece] == e
            missing += walls[piece] != e
    return (THROUGH_ODDS if through > 0 else 0.0) + (MISSING_ODDS if missing > on else 0.0)
