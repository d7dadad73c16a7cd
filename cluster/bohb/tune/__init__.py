"""Ray Tune for a study: Tune places trials, reuses their actors, and notices when one dies.

Disabled features of Tune:
- schedulers and Tune's own BOHB (`TuneBOHB` with `HyperBandForBOHB`): they lose the result of a
  trial that is stopped at its last rung, and cannot be restored after a crash;
- retries (`max_failures`): Tune fails a trial at once if a reused actor dies before its first step.
  `BohbSearcher` suggests the job again;
- `max_concurrent_trials`: the number of trials follows the size of the cluster;
- checkpoints, log files, progress output and signal handling: other modules do this.

This module imports nothing, so that the processes of trials do not load hpbandster.
"""
