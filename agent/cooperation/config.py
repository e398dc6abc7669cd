"""What of cooperation may be switched off, and how sure a robot must be. All ours; the paper gives no numbers."""

from protocol.settings import Config, Positive


class VerificationConfig(Config):
    """The sequential test of a proposal: which evidence counts, and what suffices."""

    ground: bool = True
    """Count walls of the received map that the robot finds, or does not find, where it had not looked (paper IV).
    Without it, own scans neither hide received walls nor undo a merge."""
    discs: bool = True
    """Count whether the teammate's disc is seen where the transform puts the teammate. Without it, walls alone may
    decide, and no empty place undoes a merge."""
    heard: bool = True
    """Count messages that, under the transform, came from beyond the radio's range."""
    thirds: bool = True
    """Count what merged peers say of the frame of another one that they have merged, too. Without it, their word
    proposes nothing, and transforms are not compared around circles."""
    later_maps: bool = True
    """Count alignments of later maps: they must give the same transform."""

    accept: Positive = 5.0
    """Log-odds, in nats, at which a proposal is accepted. Wald's bound for one wrong acceptance among 150 wrong
    proposals, and few proposals are wrong to begin with."""
    reject: Positive = 4.0
    """Log-odds, in nats, of being wrong at which a proposal is rejected: lower, as rejecting a right one costs only a
    second try."""
    time_out_s: Positive = 120.0
    """Simulated seconds of driving after which a proposal is rejected: 13 m of way at full speed, and as long to look
    around."""


class CooperationConfig(Config):
    """What a robot does with the maps of others."""

    sharing: bool = True
    """Align, verify and merge the maps of others. Without it every robot maps for itself, though it tells its map."""
    division: bool = True
    """Divide frontiers and sweeps among merged teammates, leave what these have swept, and tell them where the frames
    of others lie. Without it, cooperation is the paper's."""
    verification: VerificationConfig = VerificationConfig()
