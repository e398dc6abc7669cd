"""One robot's mind: scan to corners, wireframe, filter, alignment, exploration, driving."""

from agent.kernel_cache import use_own_cache

use_own_cache()
