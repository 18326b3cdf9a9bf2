"""Run campaigns: ``python -m idic_studies.evidence.hostile forged 2000 damaged 5000 [--seed 0] [--seconds 600]``."""

from __future__ import annotations

import argparse
import math
import sys
from functools import partial

from idic_studies.evidence.hostile.campaigns import CAMPAIGNS, case_of
from idic_studies.evidence.hostile.counting import run_campaign

say = partial(print, flush=True)


def main() -> int:
    """Exit code 1 where a case ended neither well nor with one message."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("words", nargs="+", metavar="CAMPAIGN NUMBER", help=", ".join(CAMPAIGNS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=math.inf, help="of a campaign, after which it ends early")
    options = parser.parse_args()
    pairs = zip(options.words[::2], options.words[1::2], strict=True)
    tallies = [run_campaign(name, case_of(name), int(number), options.seed, say, options.seconds)
               for name, number in pairs]
    for tally in tallies:
        say(tally.line())
    return int(any(tally.bad for tally in tallies))


if __name__ == "__main__":
    sys.exit(main())
