"""Partitions of one input space, each the one before with one box split; made as far as they are asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from models.network.partition import Partition


@dataclass
class Growing:
    """Ever larger partitions, each the one before with one box split; made as far as they are asked for."""

    source: Iterator[Partition]
    made: list[Partition] = field(default_factory=list)

    def of(self, n_models: int) -> Partition:
        """Return the partition with as many boxes, or the largest that the data allow."""
        while not self.made or self.made[-1].n_models < n_models:
            larger = next(self.source, None)
            if larger is None:
                break
            self.made.append(larger)
        fitting = [partition for partition in self.made if partition.n_models <= n_models]
        return fitting[-1] if fitting else self.made[0]
