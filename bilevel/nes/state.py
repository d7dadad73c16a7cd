"""The state of an NES run between generations."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from bilevel.evaluation import EvaluationResult, scores_of
from bilevel.hyperparameters import NESHyperparameters
from bilevel.nes.archive import Finalist
from bilevel.nes.confirmation import Confirmation
from bilevel.nes.records import GenerationRecord
from bilevel.nes.start import StartRace
from bilevel.synthetic_env import SE, SEDistribution, StoredSE
from bilevel.synthetic_env.coordinates import Theta
from bilevel.tasks import ObservationScale, Task


@dataclass(frozen=True)
class NESState:
    """The run after `generation` generations."""

    task: Task
    se: SEDistribution
    scale: ObservationScale
    # Hyperparameters, seed and version of the run, which its SE files hold.
    provenance: Mapping[str, Any] = field(default_factory=dict)
    generation: int = 0
    attempt: int = 0  # how often the run has begun again from other random SEs
    attempt_began: int = 0  # the generation in which it did last
    race: StartRace | None = None  # while the start of the attempt is being chosen
    judged: int = 0  # generation of the last confirmation, or in which the attempt began
    real_env_steps: int = 0  # steps on the real task so far
    cost: float = 0.0  # core seconds of all evaluations so far, estimated (`bilevel.cost`)
    confirmation: Confirmation | None = None  # while one is under way
    confirmed: bool = False  # solved for long enough, and confirmed by fresh agents
    refuted: int = 0  # confirmations that failed, in this attempt
    finished: bool = False  # confirmed (solved, where nothing confirms), or out of generations
    finalists: tuple[Finalist, ...] = ()  # best first
    records: tuple[GenerationRecord, ...] = ()

    @property
    def started(self) -> bool:
        """Whether the start is chosen."""
        return self.race is None

    @property
    def best(self) -> StoredSE:
        """The SE to hand over: the current one if it is confirmed, else the one whose agents scored
        highest (before the first generation the current one)."""
        if self.confirmed or not self.finalists:
            return self.current
        return self.candidates[0]

    @property
    def current(self) -> StoredSE:
        """The unperturbed SE as it is now, after the last step."""
        return self._stored(self.se.centre, generation=self.generation, confirmed=self.confirmed)

    @property
    def candidates(self) -> list[StoredSE]:
        """The SEs whose agents scored highest, best first."""
        return [
            self._stored(
                self.se.at(f.theta),
                generation=f.generation,
                confirmed=False,
                score_mean=f.score_mean,
                perturbed_score_mean=f.perturbed_score_mean,
                train_steps_mean=self.records[f.generation].train_steps_mean,
            )
            for f in self.finalists
        ]

    def _stored(self, se: SE, **info: object) -> StoredSE:
        task, facts = self.task, {**self.provenance, "real_env_steps": self.real_env_steps, **info}
        return StoredSE(se, task.id, task.step_limit, task.solved_reward, facts)

    @property
    def best_score(self) -> float:
        """Highest mean score of a generation so far (-inf before the first)."""
        return max((record.score_mean for record in self.records), default=-math.inf)

    def record_of(
        self, results: Sequence[EvaluationResult], centre_agents: int, step: Theta
    ) -> GenerationRecord:
        """The record of a generation's `results`, in the order of their requests, and of its update
        `step` (D,)."""
        scores = scores_of(results)
        centre, on_centre = scores[:centre_agents], results[:centre_agents]
        seconds = sum(result.seconds for result in results)
        train_steps = sum(result.train_steps for result in results)
        return GenerationRecord(
            generation=self.generation,
            attempt=self.attempt,
            score_mean=float(centre.mean()),
            score_std=float(centre.std()),
            score_best=float(centre.max()),
            perturbed_score_mean=float(scores[centre_agents:].mean()),
            train_steps_mean=float(np.mean([r.train_steps for r in on_centre])),
            train_episodes_mean=float(np.mean([r.train_episodes for r in on_centre])),
            solved_fraction=float((centre >= self.task.solved_reward).mean()),
            non_finite=sum(not r.finite for r in results),
            real_env_steps=self.real_env_steps,
            cost=self.cost,
            psi_norm=float(np.linalg.norm(self.se.centre.psi)),
            update_norm=float(np.linalg.norm(step)),
            std_dev=float(np.sqrt(np.mean(np.square(self.se.std_dev)))),
            evaluation_seconds=seconds,
            env_steps_per_second=train_steps / max(seconds, 1e-9),
        )

    def solved_for_long(self, nes: NESHyperparameters) -> bool:
        """Whether the last `nes.solved_for` generations, none of which a confirmation has judged,
        solve the task on average."""
        if not 0 < nes.solved_for <= self.generation - self.judged:
            return False
        recent = [record.score_mean for record in self.records[-nes.solved_for :]]
        return float(np.mean(recent)) >= self.task.solved_reward

    def timed(self, seconds: float, cores: int, finished: float) -> Self:
        """With the measured times of the last generation (`GenerationRecord.timed`)."""
        *before, last = self.records
        return replace(self, records=(*before, last.timed(seconds, cores, finished)))
